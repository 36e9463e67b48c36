"""The command line: parse, call the library, print."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys

from iceg.cli import ending

TYPE_CHECKING = False  # typing takes 12 ms to load, all that is needed before signals are handled 11
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import NoReturn

_COLLECTION = (500_000, 20, 20)
"""Thresholds of the garbage collector: hardly anything here forms cycles, and looking for them takes 0.15 of
2.8 s of the embedded log's run."""
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""The matrices here are small: BLAS threads would wait for each other, busily, and the last digits of the results would
depend on the number of cores."""
_DEBUG = "--debug"
_FAILED, _USAGE = 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: what follows the program's name; the process's own when left out.

    Returns:
        The exit code: 0, 1 for an error in the data, 2 in the arguments or settings, 70 for an error of iceg itself,
        128 and the signal's number when a signal ended it: 130 for Ctrl-C.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = _DEBUG in words
    _open_closed_streams()
    _never_fail_to_print()
    for name in _ONE_THREAD:  # looked at when NumPy is loaded
        os.environ.setdefault(name, "1")
    gc.set_threshold(*_COLLECTION)
    atexit.register(gc.freeze)  # nothing to look for at the end either
    try:
        return _main([word for word in words if word != _DEBUG])
    except KeyboardInterrupt as err:
        return _interrupted(err)
    except BrokenPipeError:
        # Whoever read our output has seen enough; keep the interpreter from flushing into the closed pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED
    except Exception as err:  # noqa: BLE001 what nobody foresaw is told, too
        if ending.is_told_to_end() or _comes_of_interrupt(err):
            return _interrupted()
        from iceg.cli.unexpected import tell_unexpected

        return tell_unexpected(err, debug=debug)


def command() -> NoReturn:
    """The program `iceg`: `main`, and out.

    After a run the process ends as it is: to take apart all that the run has made and loaded, object by object, takes
    0.06 s, as long as to read its log.
    """
    ending.install()
    code = main()
    ending.end_at_once()
    if sys.argv[1:2] == ["run"]:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _open_closed_streams() -> None:
    """Where the caller has closed our output (`>&-`), what is printed goes nowhere."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115


def _never_fail_to_print() -> None:
    """What the encoding of our output lacks is printed as a question mark."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _main(words: list[str]) -> int:
    if words == ["--version"]:
        from iceg.cli.versions import versions

        print(versions())
        return 0
    from graph.errors import IcegError, reason
    from iceg.cli.usage_error import UsageError

    try:
        if words[:1] == ["--completion"]:
            from iceg.cli.completion import completion

            print(completion(words[1:]), end="")
            return 0
        command = _parse(words)
    except (IcegError, UsageError) as err:
        return _complain(err, _USAGE)
    ending.interrupt_instead()
    try:
        command()
        sys.stdout.flush()
    except UsageError as err:
        return _complain(err, _USAGE)
    except IcegError as err:
        return _complain(err, _FAILED)
    except BrokenPipeError:
        raise
    except OSError as err:  # a folder that must not be written to, a full disk
        return _complain(f"{err.filename or 'standard output'}: {reason(err)}", _FAILED)
    except MemoryError as err:
        return _complain(f"this takes more memory than there is ({err or 'no size is known'})", _FAILED)
    return 0


def _parse(words: list[str]) -> Callable[[], None]:
    from iceg.cli.parsing import parse

    return parse(words)


def _comes_of_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error, as where compiled libraries were interrupted while they were loaded."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _interrupted(told: KeyboardInterrupt | None = None) -> int:
    return ending.say_interrupted(told.args if told else ())


def _complain(error: Exception | str, code: int) -> int:
    print(f"iceg: {' '.join(str(error).split())}", file=sys.stderr)
    return code

"""The command line: parse, call the library, print."""

import atexit
import gc
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

_COLLECTION = (500_000, 20, 20)
"""Thresholds of the garbage collector: hardly anything here forms cycles, and looking for them takes time."""
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""The matrices here are small: BLAS threads would wait for each other, busily, for a fifth of a run's CPU time, and the
last digits of its results would depend on the number of cores."""
_FAILED, _USAGE, _INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: what follows the program's name; the process's own when left out.

    Returns:
        The exit code: 0, 1 for an error in the data, 2 in the arguments or settings, 130 when interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    _open_closed_streams()
    _never_fail_to_print()
    for name in _ONE_THREAD:  # looked at when NumPy is loaded
        os.environ.setdefault(name, "1")
    gc.set_threshold(*_COLLECTION)
    atexit.register(gc.freeze)  # nothing to look for at the end either
    try:
        return _main(words)
    except KeyboardInterrupt as err:
        return _interrupted(err)
    except ImportError as err:  # what compiled libraries make of Ctrl-C while they are loaded
        if not isinstance(err.__cause__ or err.__context__, KeyboardInterrupt):
            raise
        return _interrupted()
    except BrokenPipeError:
        # Whoever read our output has seen enough; keep the interpreter from flushing into the closed pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED


def command() -> NoReturn:
    """The program `iceg`: `main`, and out.

    After a run the process ends as it is: to take apart all that the run has made and loaded, object by object, takes
    as long as to read its log.
    """
    code = main()
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
        from iceg import __version__

        print(f"iceg {__version__}")
        return 0
    from graph.errors import IcegError, reason
    from iceg.cli.usage_error import UsageError

    try:
        command = _parse(words)
    except IcegError as err:
        return _complain(err, _USAGE)
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
    return 0


def _parse(words: list[str]) -> Callable[[], None]:
    from iceg.cli.plain_run import plain_run

    command = plain_run(words)
    if command is not None:
        return command
    from iceg.cli.parsing import parse

    return parse(words)


def _interrupted(told: KeyboardInterrupt | None = None) -> int:
    print("\niceg: " + ", ".join(["interrupted", *map(str, told.args if told else ())]), file=sys.stderr)
    return _INTERRUPTED


def _complain(error: Exception | str, code: int) -> int:
    print(f"iceg: {' '.join(str(error).split())}", file=sys.stderr)
    return code

"""One input, read and used as the command line would, and what is wrong with what came of it."""

import contextlib
import io
import resource
import signal
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from graph.errors import IcegError
from tests.fuzz.sandbox import MOST_BYTES, MOST_SECONDS
from tests.fuzz.targets import Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What came of an input.

    Attributes:
        accepted: whether it was read to its end.
        finding: what is wrong, with its place; empty for nothing.
    """

    accepted: bool
    finding: str = ""


class TooLongError(BaseException):
    """An input that takes longer than allowed."""


def attempt(target: Target, folder: Path, content: bytes, *, use: bool = True, seconds: float = MOST_SECONDS) -> Trial:
    """Read an input, and use it.

    Args:
        target: what kind it is.
        folder: where it is written to; what it belongs to is there.
        content: the input.
        use: whether to go on to what takes longer.
        seconds: how long it may take.
    """
    path = target.write(folder, content)
    accepted = False
    try:
        with _no_longer_than(seconds), warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            result = target.read(path)
            accepted = True
            if use and target.use is not None:
                target.use(result)
    except IcegError as error:
        return Trial(accepted=accepted, finding=_wordy(error))
    except TooLongError:
        return Trial(accepted=accepted, finding=f"took more than {seconds:g} s")
    except Exception as error:  # noqa: BLE001 (whatever it is, it is what is looked for)
        return Trial(accepted=accepted, finding=_place(error))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Trial(accepted=accepted, finding=f"took {peak / 1e9:.1f} GB" if peak > MOST_BYTES else "")


def _wordy(error: IcegError) -> str:
    """An error must be one that a person can read."""
    text = str(error)
    return f"an error of {len(text)} characters: {type(error).__name__}" if len(text) > 3000 or not text else ""


def _place(error: Exception) -> str:
    """The kind of the error and where in the project it arose."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "site-packages" not in frame.filename]
    own = [f for f in frames if any(f"/{part}/" in f.filename for part in ("graph", "frontends", "iceg", "fuzz"))]
    last = (own or frames)[-1]
    return f"{type(error).__name__} at {Path(last.filename).name}:{last.lineno} in {last.name}: {str(error)[:120]}"


@contextlib.contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    def end(_signal: int, _frame: FrameType | None) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)

"""What the program says of an error that nobody foresaw: that it is one of iceg, where, and how to report it."""

import sys
import traceback
from pathlib import Path

UNEXPECTED = 70
"""Exit code of an error of the program itself (EX_SOFTWARE of sysexits.h)."""
_HOME = Path(__file__).resolve().parents[2]
_OURS = ("iceg", "graph", "frontends")


def tell_unexpected(error: Exception, *, debug: bool) -> int:
    """Print one line, or the traceback and the line.

    Args:
        error: what was raised.
        debug: whether the traceback is wanted.

    Returns:
        The exit code.
    """
    if debug:
        traceback.print_exception(error)
    what = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    wanted = "what is above" if debug else "the output of the same command with --debug"
    print(
        f"iceg: this is a bug of iceg: {what} ({_place(error)}); please report it with the log and {wanted}",
        file=sys.stderr,
    )
    return UNEXPECTED


def _place(error: Exception) -> str:
    """The innermost line of iceg that the error passed."""
    frames = traceback.extract_tb(error.__traceback__)
    for frame in reversed(frames):
        path = Path(frame.filename)
        if path.is_relative_to(_HOME) and path.relative_to(_HOME).parts[0] in _OURS:
            return f"{path.relative_to(_HOME).as_posix()}:{frame.lineno}"
    return f"{frames[-1].filename}:{frames[-1].lineno}" if frames else "place unknown"

"""Numbers of a text line, exactly as `float` reads them and many times as fast."""

import numpy as np
from numpy.typing import NDArray

from frontends.logs._number_kernels import scan_numbers
from frontends.logs.errors import MalformedLineError
from frontends.logs.text import Line
from graph.limits import LIMITS

_MOST, _MOST_HEADING = LIMITS.coordinate, LIMITS.heading


def read_numbers(line: Line, position: int, out: NDArray[np.float64], what: str) -> int:
    """Fill `out` with the numbers that begin at `position`.

    Args:
        line: where they stand.
        position: in the block of the line.
        out: (n,) filled in place.
        what: what the numbers are, for the message when they are not there.

    Returns:
        The position behind the last one.

    Raises:
        MalformedLineError: the line ends early or a token is no number.
    """
    done, position = scan_numbers(line.bytes_of_block, position, line.stop, out)
    while done < len(out):
        token = line.block[position : line.stop].split(None, 1)[:1]
        expected = f"number {done + 1} of {len(out)} {what}" if len(out) > 1 else what
        if not token:
            raise MalformedLineError("the end of the line", expected)
        out[done] = _number(token[0], expected)
        position = line.block.index(token[0], position) + len(token[0])
        more, position = scan_numbers(line.bytes_of_block, position, line.stop, out[done + 1 :])
        done += 1 + more
    return position


def checked_pose(x: float, y: float, heading: float) -> tuple[float, float, float]:
    """x, y [m] and heading [rad] of a line, if they can be a pose.

    Raises:
        MalformedLineError: a number that is not finite or beyond the limits.
    """
    if -_MOST <= x <= _MOST and -_MOST <= y <= _MOST and -_MOST_HEADING <= heading <= _MOST_HEADING:
        return x, y, heading
    raise MalformedLineError(
        f"the pose {x} {y} {heading}",
        f"a finite pose within {_MOST:g} m of the origin, its heading within {_MOST_HEADING:g} rad",
    )


def _number(token: bytes, expected: str) -> float:
    """One token by Python's rules, without its digit grouping."""
    try:
        if b"_" in token:
            raise ValueError  # noqa: TRY301
        return float(token)
    except ValueError:
        shown = token[:40].decode("ascii", "backslashreplace")
        raise MalformedLineError(f"'{shown}'", expected) from None

"""One pass through the lines of a text log, and what becomes of those that break its format."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from frontends.logs.errors import LogError, MalformedLineError
from frontends.logs.text import Block, Line, TextLog
from graph.limits import LIMITS, at_most


@dataclass(slots=True)
class LineTroubles:
    """What went wrong line by line without ending the reading.

    Attributes:
        skipped: malformed lines passed over.
        first_skipped: what was wrong with the first of them, and where.
        warnings: what else a person should know.
    """

    skipped: int = 0
    first_skipped: str = ""
    warnings: list[str] = field(default_factory=list)

    def skip(self, what: LogError) -> None:
        """Count one more line passed over."""
        self.skipped += 1
        self.first_skipped = self.first_skipped or str(what)

    def told(self) -> list[str]:
        """All of it, as warnings."""
        if not self.skipped:
            return self.warnings
        return [f"{self.skipped} malformed lines passed over, the first: {self.first_skipped}", *self.warnings]


def read_lines(
    path: Path,
    read: Callable[[Line], None],
    troubles: LineTroubles,
    *,
    skip_bad_lines: bool,
    read_many: Callable[[Block, int], tuple[int, int]] | None = None,
) -> None:
    """Give every line of a log to `read`, in file order.

    A last line without its newline may have been cut off: when it is malformed it is left out with a warning.

    Args:
        path: the log, plain or compressed.
        read: takes a line; raises MalformedLineError for one that breaks the format.
        troubles: what went wrong is added here.
        skip_bad_lines: pass over malformed lines and count them.
        read_many: takes as many whole lines as it can from a place in a block on, and returns how many, and where the
            first one begins that it leaves to `read`.

    Raises:
        LogError: the file cannot be read; or a line is malformed, with its place.
    """
    source, number = TextLog(path), 0
    with np.errstate(over="ignore"):  # a reading too long for float32 becomes infinite: no return
        for block in source.blocks():
            if number > LIMITS.lines:
                raise LogError(f"{path}: found more than {LIMITS.lines} lines, expected {at_most('lines')}")
            start = 0
            while start < len(block.text):
                if read_many is not None and block.terminated:
                    lines, start = read_many(block, start)
                    number += lines
                    if start == len(block.text):
                        break
                number += 1
                line = block.line(number, start)
                start = line.stop + 1
                try:
                    read(line)
                except MalformedLineError as error:
                    _pass_over(line, error, path, troubles, skip_bad_lines=skip_bad_lines)
    if source.cut_off:
        troubles.warnings.append("the compressed file is cut off; all that could be unpacked is used")


def _pass_over(
    line: Line, error: MalformedLineError, path: Path, troubles: LineTroubles, *, skip_bad_lines: bool
) -> None:
    """Note a malformed line, if it may be passed over."""
    if not line.terminated:
        troubles.warnings.append(f"the last line is cut off and left out (line {line.number}: {error})")
    elif skip_bad_lines:
        troubles.skip(error.at(path, line.number))
    else:
        raise error.at(path, line.number) from None

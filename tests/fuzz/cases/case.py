"""Rows of the collection of hostile files."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Make = Callable[[Path], None]
"""Writes the files of a case into a folder."""

LONG = "9" * 5000
"""More digits than Python reads as a whole number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One hostile file, or some that belong together.

    Attributes:
        name: of the case.
        words: after the program's name; the folder of the files is the current one.
        make: writes the files into a folder.
    """

    name: str
    words: tuple[str, ...]
    make: Make


def text_file(name: str, content: str | bytes) -> Make:
    """Writes one file."""

    def make(folder: Path) -> None:
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    return make

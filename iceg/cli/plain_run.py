"""`iceg run LOG -o DIR` without settings, as most runs are: read before the library that reads all others is loaded."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from iceg.cli.run_log import run_log
from iceg.config import Config

_SWITCHES = {"--overwrite": "overwrite", "--skip-bad-lines": "skip_bad_lines"}


@dataclass(frozen=True, kw_only=True)
class PlainRun:
    """A run with the default settings."""

    log: Path
    output: Path
    overwrite: bool = False
    skip_bad_lines: bool = False

    def __call__(self) -> None:
        """Read, run, write."""
        run_log(self.log, self.output, Config(), overwrite=self.overwrite, skip_bad_lines=self.skip_bad_lines)


def plain_run(words: Sequence[str]) -> PlainRun | None:
    """The run that the words after the program's name ask for in the plainest way.

    Returns:
        The run; None where anything else is asked for, or asked for otherwise, which is the parser's to judge.
    """
    name, *rest = words or [""]
    switches = [word for word in rest if word in _SWITCHES]
    others = [word for word in rest if word not in _SWITCHES]
    if name != "run" or len(others) != 3 or len(set(switches)) < len(switches):
        return None
    place = next((place for place in (0, 1) if others[place] in ("-o", "--output")), None)
    if place is None:
        return None
    output = others.pop(place + 1)
    del others[place]
    if any(word.startswith("-") for word in (output, *others)):
        return None
    return PlainRun(log=Path(others[0]), output=Path(output), **{_SWITCHES[word]: True for word in switches})

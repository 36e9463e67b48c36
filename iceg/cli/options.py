"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Optional

import tyro

from iceg.cli.usage_error import UsageError

__all__ = [
    "ConfigFile",
    "CorrectionsFile",
    "GivenPath",
    "Json",
    "Overwrite",
    "Report",
    "SkipBadLines",
    "UsageError",
]


GivenPath = Optional[Path]  # noqa: UP045
"""A path or nothing; tyro looks at `Path | None` with typeguard, which loads asyncio and unittest for it."""

ConfigFile = Annotated[
    GivenPath,
    tyro.conf.arg(metavar="FILE", help="TOML file of settings; flags given here override it.", help_behavior_hint=""),
]


CorrectionsFile = Annotated[
    GivenPath,
    tyro.conf.arg(
        metavar="FILE",
        help="What a person corrects: corrections.toml, or a closures.csv with other verdicts.",
        help_behavior_hint="(optional)",
    ),
]


Overwrite = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Replace earlier results; they stay until the new are complete.", help_behavior_hint=""),
]


Report = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Leave out report.html, the page that shows the run.", help_behavior_hint=""),
]


SkipBadLines = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Go on after malformed lines and count them.", help_behavior_hint=""),
]


Json = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Print the figures as JSON, and nothing else.", help_behavior_hint=""),
]

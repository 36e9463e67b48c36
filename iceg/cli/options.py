"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import tyro

from iceg.config import Config


class UsageError(Exception):
    """Arguments that do not belong together."""


ConfigFile = Annotated[
    Path | None, tyro.conf.arg(metavar="FILE", help="TOML file of settings; flags given here override it.")
]


Settings = Annotated[Config, tyro.conf.arg(name="")]


Overwrite = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Replace earlier results; they stay until the new are complete."),
]


SkipBadLines = Annotated[
    tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="Go on after malformed lines and count them.")
]

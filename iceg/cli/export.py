"""`iceg export`: a run's results for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a run's results for other programs: its floor plan, walls as straight lines in metres."""

    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="The folder of a run.")]
    to: Annotated[
        Literal["floorplan.svg", "floorplan.pdf", "floorplan.dxf"],
        tyro.conf.arg(help="What to write; walls seen with doubt have a layer of their own."),
    ]
    output: Annotated[
        Path | None,
        tyro.conf.arg(
            aliases=["-o"],
            metavar="FILE",
            help="Where, replaced if it is there; in DIR under its own name when left out.",
            help_behavior_hint="",
        ),
    ] = None

    def __call__(self) -> None:
        """Read, write, name the file."""
        from iceg.export.formats import export

        print(export(self.results, self.to, self.output))

"""`iceg export`: a run's results for other programs."""

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from iceg.cli.options import UsageError

_WITH_SCANS = ("carmen", "bag", "mcap", "rerun")
_NEED_SCANS = ("carmen", "bag")


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write results for other programs: trajectory, log, graph, tables, floor plan, recordings for viewers."""

    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="The folder of a run.")]
    to: Annotated[
        Literal[
            "tum",
            "euroc",
            "kitti",
            "carmen",
            "bag",
            "g2o",
            "gtsam",
            "csv",
            "parquet",
            "floorplan.svg",
            "floorplan.pdf",
            "floorplan.dxf",
            "mcap",
            "rerun",
        ],
        tyro.conf.arg(
            help="Trajectory as tum, euroc or kitti; the log with corrected poses as carmen; a copy of the bag with "
            "map, path and map → odom as bag; the graph as g2o or serialised by gtsam; trajectory, key poses, "
            "closures, landmarks and factors as tables in csv or parquet; walls as straight lines as floorplan; all of "
            "it to replay in Foxglove as mcap, in Rerun as rerun."
        ),
    ]
    output: Annotated[
        Path | None,
        tyro.conf.arg(
            aliases=["-o"],
            metavar="OUT",
            help="File, for bag, gtsam, csv, mcap and parquet a folder; replaced if it is there; in DIR when left out.",
            help_behavior_hint="",
        ),
    ] = None
    log: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="LOG",
            help="carmen, bag: the recorded log; mcap, rerun: likewise, where DIR lacks run.npz.",
            help_behavior_hint="",
        ),
    ] = None
    stamps: Annotated[
        Literal["recorded", "repaired"],
        tyro.conf.arg(help="tum, euroc: as in trajectory.tum, or repaired so that they increase from scan to scan."),
    ] = "recorded"

    def __call__(self) -> None:
        """Read, write, name the file."""
        from iceg.export.formats import export_results
        from iceg.export.options import ExportOptions
        from iceg.export.recorded_run import holds_scans

        if self.log is None and self.to in _NEED_SCANS:
            raise UsageError(f"--to {self.to} needs the recorded --log")
        if self.log is not None and self.to not in _WITH_SCANS:
            raise UsageError(f"--log goes with {', '.join(_WITH_SCANS)}, found --to {self.to}")
        if self.stamps != "recorded" and self.to not in ("tum", "euroc"):
            raise UsageError(f"--stamps repaired goes with tum and euroc, found --to {self.to}")
        options = ExportOptions(log=self.log, stamps=self.stamps, tell=partial(print, file=sys.stderr))
        path = export_results(self.results, self.to, self.output, options)
        if self.log is None and self.to in _WITH_SCANS and not holds_scans(self.results):
            print(f"{self.results} has not kept its scans: without --log the recording holds none", file=sys.stderr)
        print(path)

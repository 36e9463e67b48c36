"""Commands that tell what is in a log, and how good a result is."""

import dataclasses
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from iceg.cli.options import Json, SkipBadLines, UsageError
from iceg.config import LogConfig

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from iceg.evaluation.judge import Judgement
    from iceg.show.run_plots import PictureName

_PICTURES_OF_A_RUN = "map,trajectory,uncertainty"
"""All that are drawn unless asked otherwise; of DP-SLAM, those that it has."""


@dataclass(frozen=True, kw_only=True)
class Info:
    """Tell what is in a log."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log.")]
    skip_bad_lines: SkipBadLines = False
    json: Json = False
    settings: LogConfig = field(default_factory=LogConfig)

    def __call__(self) -> None:
        """Read as `iceg run` does with the same settings, and describe."""
        from frontends.logs import describe_log, read_log
        from iceg.show.progress import reading_bar

        with reading_bar(self.log) as progress:
            log = read_log(
                self.log, skip_bad_lines=self.skip_bad_lines, progress=progress, **dataclasses.asdict(self.settings)
            )
        info = describe_log(log)
        if self.json:
            from iceg.plain_json import format_json

            print(format_json(info.figures()))
        else:
            print(info)


@dataclass(frozen=True, kw_only=True)
class Eval:
    """Judge a trajectory by the truth or relations, or a run's factors by each other."""

    trajectory: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY", help="A trajectory.tum or the folder of a run.")
    ]
    truth: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="True poses: TUM, EuRoC, a CSV t_s,x_m,y_m,theta_rad or scan,x_m,y_m,theta_rad, or a log that holds "
            "them. A run folder also gets its NEES.",
            help_behavior_hint="",
        ),
    ] = None
    by: Annotated[
        Literal["auto", "scan", "stamp"],
        tyro.conf.arg(
            help="How poses are paired with the truth; auto: by scan where there are as many, else by stamp."
        ),
    ] = "auto"
    relations: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="Relative poses known: a CSV by scan, or the benchmark's .relations by stamp (needs --log).",
            help_behavior_hint="",
        ),
    ] = None
    log: Annotated[
        Path | None, tyro.conf.arg(metavar="LOG", help="The log, to tie stamps to scans.", help_behavior_hint="")
    ] = None
    reference: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="The same as --truth.", help_behavior_hint="")
    ] = None
    consistency: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(
            help="Judge each factor of a graph, that of a run's folder or a g2o file, by all the others.",
            help_behavior_hint="",
        ),
    ] = False
    json: Json = False

    def __call__(self) -> None:
        """Compare and print."""
        truth = self._checked()
        if truth is not None:
            from iceg.evaluation.judge import judge_trajectory

            tell_judgement(
                self.trajectory,
                judge_trajectory(self.trajectory, truth, None if self.by == "auto" else self.by),
                as_json=self.json,
            )
            return
        from iceg.evaluation.report import format_json, format_table

        report, title = self._relative()
        print(format_json(report) if self.json else format_table(report, title))

    def _checked(self) -> Path | None:
        """The file of true poses, if that is what is asked for."""
        given = [path for path in (self.relations, self.reference, self.truth) if path is not None]
        n_given = len(given) + self.consistency
        if n_given != 1:
            found = n_given or "none"
            raise UsageError(f"found {found} of --truth, --reference, --relations and --consistency, expected one")
        if self.log is not None and (self.relations is None or _is_csv(self.relations)):
            raise UsageError("--log is only needed with relations by stamp")
        truth = self.truth or self.reference
        if self.by != "auto" and truth is None:
            raise UsageError("--by needs --truth")
        return truth

    def _relative(self) -> tuple[dict[str, float], str]:
        if self.consistency:
            from iceg.evaluation.cross_validation import cross_validation_report

            return cross_validation_report(self.trajectory), f"{self.trajectory}, each factor against all the others:"
        from iceg.evaluation.judge import relations_by_stamp_report, relations_csv_report

        assert self.relations is not None
        title = f"{self.trajectory} against {self.relations}:"
        if _is_csv(self.relations):
            return relations_csv_report(self.trajectory, self.relations), title
        if self.log is None:
            raise UsageError(
                f"{self.relations.name} names scans by their stamps: give the log they are from with --log"
            )
        return relations_by_stamp_report(self.trajectory, self.relations, self.log), title


def tell_judgement(trajectory: Path, judgement: "Judgement", *, as_json: bool) -> None:
    """Print figures against the truth, how poses were paired, and what the NEES says in words."""
    from iceg.evaluation.report import format_json, format_table

    truth, pairing = judgement.truth, judgement.pairing
    if judgement.warning:
        print(f"warning: {judgement.warning}", file=sys.stderr)
    if as_json:
        told = {"truth_format": truth.form, "paired_by": pairing.by, "verdict": judgement.verdict}
        print(format_json({**judgement.figures, **told}))
        return
    paired = f"{truth.form}, {len(pairing.scans)} of {len(truth)} poses paired by {pairing.by}"
    print(format_table(judgement.figures, f"{trajectory} against {truth.path.name} ({paired}):"))
    if judgement.verdict:
        print(f"  {judgement.verdict}")


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Draw pictures of a run from the files in its folder, into it."""

    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="The folder of a run.")]
    what: Annotated[
        str, tyro.conf.arg(metavar="NAMES", help="Any of map, trajectory, uncertainty and closures, with commas.")
    ] = _PICTURES_OF_A_RUN
    format: Annotated[Literal["png", "svg", "pdf"], tyro.conf.arg(help="In svg and pdf all is drawn as vectors.")] = (
        "png"
    )
    truth: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="True pose of every scan, as for eval: the trajectory is drawn with its errors.",
            help_behavior_hint="",
        ),
    ] = None

    def __call__(self) -> None:
        """Read the folder, draw, name the pictures."""
        from iceg.show.run_plots import plot_results

        for path in plot_results(self.results, self._names(), self.format, self._truth()):
            print(path)

    def _names(self) -> "list[PictureName] | None":
        if self.what == _PICTURES_OF_A_RUN:
            return None
        names = [name.strip() for name in self.what.split(",")]
        known: tuple[PictureName, ...] = ("map", "trajectory", "uncertainty", "closures")
        wrong = next((name for name in names if name not in known), None)
        if wrong is not None:
            raise UsageError(f"--what: found '{wrong[:40]}', expected any of {', '.join(known)}")
        return [name for name in known if name in names]

    def _truth(self) -> "NDArray[np.float64] | None":
        if self.truth is None:
            return None
        from iceg.evaluation.judge import read_poses
        from iceg.evaluation.trajectory import check_one_row_per_scan
        from iceg.evaluation.truth import read_truth

        truth = read_truth(self.truth).poses
        check_one_row_per_scan(read_poses(self.results), truth, self.truth)
        return truth


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == ".csv"

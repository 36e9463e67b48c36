"""Commands that turn a log into results."""

import dataclasses
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from frontends.dp_slam.config import DpSlamConfig
from iceg.cli.options import ConfigFile, GivenPath, Overwrite, Settings, SkipBadLines
from iceg.cli.quick_start import load_numba_without_scipy
from iceg.config import Config

if TYPE_CHECKING:
    from frontends.scan import Log
    from iceg.slam.pipeline import SlamResult
    from iceg.slam.progress import Progress

_MANY_CARRIED = 0.02
"""More than this share of scans without a match is worth a warning."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What a run is asked for besides its settings."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results, made if missing.")
    ]
    config: ConfigFile = None
    closures: Annotated[
        GivenPath,
        tyro.conf.arg(
            metavar="FILE",
            help="Loops closed by hand: a CSV scan_i,scan_j,x_m,y_m,theta_rad[,sigma_m,sigma_rad].",
        ),
    ] = None
    overwrite: Overwrite = False
    skip_bad_lines: SkipBadLines = False


@dataclass(frozen=True, kw_only=True)
class Run(RunOptions):
    """Recorded log in; trajectory, graph, feature map, occupancy grid and pictures out."""

    settings: Settings = field(default_factory=Config)

    def __call__(self) -> None:
        """Read, run, write."""
        _run_log(
            self.log,
            self.output,
            self.settings,
            closures=self.closures,
            overwrite=self.overwrite,
            skip_bad_lines=self.skip_bad_lines,
        )


@dataclass(frozen=True, kw_only=True)
class DpSlam:
    """The same by DP-SLAM, a particle filter over whole maps, to compare: trajectory, map and summary."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log, with odometry.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results, made if missing.")
    ]
    config: ConfigFile = None
    overwrite: Overwrite = False
    skip_bad_lines: SkipBadLines = False
    settings: Annotated[DpSlamConfig, tyro.conf.arg(name="")] = field(default_factory=DpSlamConfig)

    def __call__(self) -> None:
        """Read, filter, write."""
        _run_dp_slam(self.log, self.output, self.settings, overwrite=self.overwrite, skip_bad_lines=self.skip_bad_lines)


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Run the embedded log and compare the result with its truth."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results.")] = Path(
        "demo-output"
    )
    overwrite: Overwrite = False

    def __call__(self) -> None:
        """Run, evaluate, say where the map is."""
        from iceg.demo import demo_log_path, demo_truth_path
        from iceg.evaluation.judge import truth_report
        from iceg.evaluation.report import format_table

        _run_log(demo_log_path(), self.output, Config(), overwrite=self.overwrite, skip_bad_lines=False)
        truth = demo_truth_path()
        print(format_table(truth_report(self.output, truth), f"Against the truth, {truth.name}:"))
        print(f"The map is {(self.output / 'map.png').resolve()}")


def _run_log(
    path: Path,
    directory: Path,
    config: Config,
    *,
    overwrite: bool,
    skip_bad_lines: bool,
    closures: Path | None = None,
) -> None:
    from iceg.results import check_directory, write_results
    from iceg.show.progress import ProgressBar, compile_note

    load_numba_without_scipy()
    check_directory(directory, overwrite=overwrite)
    before = _written_at(directory)
    started = time.perf_counter()
    try:
        with compile_note():
            from frontends.logs import read_log

            log = read_log(path, skip_bad_lines=skip_bad_lines, **dataclasses.asdict(config.log))
            _tell_warnings(log)
            from iceg.slam.manual_closures import read_manual_closures
            from iceg.slam.pipeline import run

            by_hand = read_manual_closures(closures) if closures else ()
            with ProgressBar(log) as progress:
                result = run(log, config, progress, closures=by_hand)
            write_results(result, directory, overwrite=overwrite)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_what_was_kept(directory, before)) from None
    _tell_results(result, progress.matching, time.perf_counter() - started, directory)


def _run_dp_slam(path: Path, directory: Path, config: DpSlamConfig, *, overwrite: bool, skip_bad_lines: bool) -> None:
    from iceg.results import check_directory
    from iceg.show.progress import ProgressBar, compile_note

    check_directory(directory, overwrite=overwrite)
    before = _written_at(directory)
    try:
        with compile_note():
            from frontends.dp_slam import dp_slam
            from frontends.logs import read_log
            from iceg.dp_slam_results import write_dp_slam_results
            from iceg.slam.progress import Progress

            log = read_log(path, skip_bad_lines=skip_bad_lines)
            _tell_warnings(log)
            with ProgressBar(log, "filtering") as bar:
                result = dp_slam(
                    log, config, lambda done, _: bar(Progress(scans=done, tried=0, accepted=0, stage="filtering"))
                )
            write_dp_slam_results(result, log, config, directory, overwrite=overwrite)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_what_was_kept(directory, before)) from None
    print(f"{len(log)} scans in {result.summary['seconds']:.1f} s, {config.particles} particles at most")
    print(f"Results are in {directory}: map.png, map.pgm, map.yaml, trajectory.tum, config.toml and summary.json")


def _tell_warnings(log: "Log") -> None:
    for warning in log.warnings:
        print(f"warning: {warning}", file=sys.stderr)


def _tell_results(result: "SlamResult", progress: "Progress", seconds: float, directory: Path) -> None:
    from iceg.show.progress import real_time_factor

    factor = real_time_factor(result.log.stamps, seconds)
    speed = f", {factor:.0f}x real time" if factor else ""
    print(f"{len(result.log)} scans in {seconds:.1f} s{speed}, everything included")
    matched = f", {100 * progress.accepted / progress.tried:.1f} % of the matches accepted" if progress.tried else ""
    print(f"{len(result.key_scans)} key poses, {len(result.landmarks)} landmarks{matched}")
    _tell_finish(result)
    _tell_doubts(result)
    print(f"Results are in {directory}: map.png, map.pgm, trajectory.tum, graph.g2o, summary.json and more")


def _tell_finish(result: "SlamResult") -> None:
    """What the offline finish did."""
    rounds = result.summary["finish"]
    if not rounds:
        return
    joint = f", {1000 * rounds[-1]['mean_move']:.0f} mm by poses and map together" if rounds[-1]["residual"] else ""
    rematched = f"{1000 * sum(done['mean_move'] for done in rounds if done['stage'] != 'joint'):.0f} mm by factors"
    print(f"finish: {rounds[-1]['closures']} closures in force; key poses moved by {rematched}{joint}")


def _tell_doubts(result: "SlamResult") -> None:
    """Say where the map may be wrong, and where only odometry carried it."""
    carried, lost = result.summary["scans_carried_by_odometry"], result.summary["lost_at_scans"]
    told = {found["scan"] for found in result.summary["breaks"]}
    untold = [scan for scan in lost if scan not in told]
    if untold:
        places = ", ".join(str(scan) for scan in untold[:8]) + (
            f" and {len(untold) - 8} more" if len(untold) > 8 else ""
        )
        print(
            f"warning: from scan {places} on nothing matched what was known before; loop closures tie it to the rest",
            file=sys.stderr,
        )
    if carried > _MANY_CARRIED * len(result.log):
        print(f"warning: odometry alone carried {carried} of {len(result.log)} scans", file=sys.stderr)
    for warning in result.summary["warnings"]:
        if warning not in result.log.warnings:
            print(f"warning: {warning}", file=sys.stderr)


def _written_at(directory: Path) -> int | None:
    """When the results in a folder were completed; None when there are none."""
    summary = directory / "summary.json"
    return summary.stat().st_mtime_ns if summary.exists() else None


def _what_was_kept(directory: Path, before: int | None) -> str:
    now = _written_at(directory)
    if now is None:
        return f"nothing was written to {directory}"
    return (
        f"the earlier results in {directory} are untouched"
        if now == before
        else f"the results in {directory} are complete"
    )

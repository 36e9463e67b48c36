"""Commands that turn a log into results."""

import sys
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from frontends.dp_slam.config import DpSlamConfig
from iceg.cli.judge import tell_judgement
from iceg.cli.options import ConfigFile, CorrectionsFile, GivenPath, Json, Overwrite, Report, SkipBadLines
from iceg.cli.run_log import run_log, tell_stale_files, tell_warnings, what_was_kept, written_at
from iceg.cli.telling import Telling
from iceg.config import Config


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
            help_behavior_hint="",
        ),
    ] = None
    corrections: CorrectionsFile = None
    overwrite: Overwrite = False
    skip_bad_lines: SkipBadLines = False
    report: Report = True
    truth: Annotated[
        GivenPath,
        tyro.conf.arg(
            metavar="FILE",
            help="The true pose of every scan, which the report judges the run by: a CSV t_s,x_m,y_m,theta_rad.",
            help_behavior_hint="(optional)",
        ),
    ] = None
    json: Json = False


@dataclass(frozen=True, kw_only=True)
class Run(RunOptions):
    """Recorded log in; trajectory, graph, feature map, occupancy grid and pictures out."""

    settings: Config = field(default_factory=Config)

    def __call__(self) -> None:
        """Read, run, write."""
        run_log(
            self.log,
            self.output,
            self.settings,
            closures=self.closures,
            corrections=self.corrections,
            overwrite=self.overwrite,
            skip_bad_lines=self.skip_bad_lines,
            report=self.report,
            truth=self.truth,
            as_json=self.json,
        )


@dataclass(frozen=True, kw_only=True)
class DpSlam:
    """The same by DP-SLAM, a particle filter over whole maps, to compare."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log, with odometry.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results, made if missing.")
    ]
    config: ConfigFile = None
    overwrite: Overwrite = False
    skip_bad_lines: SkipBadLines = False
    json: Json = False
    settings: DpSlamConfig = field(default_factory=DpSlamConfig)

    def __call__(self) -> None:
        """Read, filter, write."""
        with Telling(as_json=self.json) as telling:
            _run_dp_slam(self, telling)


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Run the embedded log and compare the result with its truth."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results.")] = Path(
        "demo-output"
    )
    overwrite: Overwrite = False
    json: Json = False

    def __call__(self) -> None:
        """Run, evaluate, say where the map is."""
        from iceg.demo import demo_log_path, demo_truth_path
        from iceg.evaluation.judge import judge_trajectory

        with redirect_stdout(sys.stderr if self.json else sys.stdout):
            run_log(
                demo_log_path(),
                self.output,
                Config(),
                overwrite=self.overwrite,
                skip_bad_lines=False,
                truth=demo_truth_path(),
            )
        tell_judgement(self.output, judge_trajectory(self.output, demo_truth_path()), as_json=self.json)
        if not self.json:
            print(f"The map is {(self.output / 'map.png').resolve()}")
            print(f"The whole run is {(self.output / 'report.html').resolve()}")


def _run_dp_slam(asked: DpSlam, telling: Telling) -> None:
    from iceg.results import check_directory
    from iceg.show.progress import ProgressBar, compile_note

    path, directory, config = asked.log, asked.output, asked.settings
    check_directory(directory, overwrite=asked.overwrite)
    before = written_at(directory)
    try:
        with compile_note():
            from frontends.dp_slam import dp_slam
            from frontends.logs import read_log
            from iceg.dp_slam_results import write_dp_slam_results
            from iceg.slam.progress import Progress

            log = read_log(path, skip_bad_lines=asked.skip_bad_lines)
            tell_warnings(log)
            with ProgressBar(log) as bar:
                result = dp_slam(
                    log, config, lambda done, _: bar(Progress(scans=done, tried=0, accepted=0, stage="filtering"))
                )
            write_dp_slam_results(result, log, config, directory, overwrite=asked.overwrite)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(what_was_kept(directory, before)) from None
    telling.keep(scans=len(log), seconds=result.summary["seconds"], results=str(directory))
    telling.say(f"{len(log)} scans in {result.summary['seconds']:.1f} s, {config.particles} particles at most")
    telling.say(f"Results are in {directory}: map.png, map.pgm, map.yaml, trajectory.tum, config.toml and summary.json")
    tell_stale_files(directory)

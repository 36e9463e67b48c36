"""The command line: parse, call the library, print."""

import dataclasses
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from frontends.dp_slam.config import DpSlamConfig
from graph.errors import IcegError
from iceg.config import Config, read_config
from iceg.settings_file import read_settings

if TYPE_CHECKING:
    from frontends.scan import Log
    from iceg.evaluation.bench.outcome import Outcome
    from iceg.slam.pipeline import SlamResult
    from iceg.slam.progress import Progress

_DESCRIPTION = "2D laser SLAM for recorded logs. 'iceg COMMAND --help' tells more; 'iceg --version' the version."
_FAILED, _USAGE, _INTERRUPTED = 1, 2, 130
_MANY_CARRIED = 0.02
"""More than this share of scans without a match is worth a warning."""

_ConfigFile = Annotated[
    Path | None, tyro.conf.arg(metavar="FILE", help="TOML file of settings; flags given here override it.")
]
_Settings = Annotated[Config, tyro.conf.arg(name="")]
_Overwrite = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Replace earlier results; they stay until the new are complete."),
]
_SkipBadLines = Annotated[
    tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="Go on after malformed lines and count them.")
]


class UsageError(Exception):
    """Arguments that do not belong together."""


class BenchError(IcegError):
    """Runs of a benchmark that failed."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Recorded log in; trajectory, graph, feature map, occupancy grid and pictures out."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the results, made if missing.")
    ]
    config: _ConfigFile = None
    closures: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="Loops closed by hand: a CSV scan_i,scan_j,x_m,y_m,theta_rad[,sigma_m,sigma_rad].",
        ),
    ] = None
    overwrite: _Overwrite = False
    skip_bad_lines: _SkipBadLines = False
    settings: _Settings = field(default_factory=Config)

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
    config: _ConfigFile = None
    overwrite: _Overwrite = False
    skip_bad_lines: _SkipBadLines = False
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
    overwrite: _Overwrite = False

    def __call__(self) -> None:
        """Run, evaluate, say where the map is."""
        from iceg.demo import demo_log_path, demo_truth_path
        from iceg.evaluation.judge import truth_report
        from iceg.evaluation.report import format_table

        _run_log(demo_log_path(), self.output, Config(), overwrite=self.overwrite, skip_bad_lines=False)
        truth = demo_truth_path()
        print(format_table(truth_report(self.output, truth), f"Against the truth, {truth.name}:"))
        print(f"The map is {(self.output / 'map.png').resolve()}")


@dataclass(frozen=True, kw_only=True)
class Info:
    """Tell what is in a log."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log.")]
    skip_bad_lines: _SkipBadLines = False

    def __call__(self) -> None:
        """Read and describe."""
        from frontends.logs import describe_log, read_log

        print(describe_log(read_log(self.log, skip_bad_lines=self.skip_bad_lines)))


@dataclass(frozen=True, kw_only=True)
class Eval:
    """Judge a trajectory by benchmark relations, a reference trajectory or the truth."""

    trajectory: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY", help="A trajectory.tum or the folder of a run.")
    ]
    relations: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE",
            help="Relative poses known: a CSV by scan, or the benchmark's .relations by stamp (needs --log).",
        ),
    ] = None
    log: Annotated[Path | None, tyro.conf.arg(metavar="LOG", help="The log, to tie stamps to scans.")] = None
    reference: Annotated[
        Path | None, tyro.conf.arg(metavar="CSV", help="Reference poses of some scans: scan,x_m,y_m,theta_rad.")
    ] = None
    truth: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="CSV", help="True pose of every scan: t_s,x_m,y_m,theta_rad. A run folder also gets its NEES."
        ),
    ] = None
    consistency: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Judge each factor of a run's graph by all the others: needs no reference."),
    ] = False
    json: Annotated[tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="One JSON object instead of a table.")] = (
        False
    )

    def __call__(self) -> None:
        """Compare and print."""
        from iceg.evaluation.report import format_json, format_table

        report, title = self._report()
        print(format_json(report) if self.json else format_table(report, title))

    def _report(self) -> tuple[dict[str, float], str]:
        given = [path for path in (self.relations, self.reference, self.truth) if path is not None]
        if len(given) + self.consistency != 1:
            raise UsageError(
                f"found {len(given) + self.consistency} of --relations, --reference, --truth and --consistency,"
                " expected exactly one"
            )
        if self.log is not None and (self.relations is None or _is_csv(self.relations)):
            raise UsageError("--log is only needed with relations by stamp")
        if self.consistency:
            from iceg.evaluation.cross_validation import cross_validation_report

            return cross_validation_report(self.trajectory), f"{self.trajectory}, each factor against all the others:"
        title = f"{self.trajectory} against {given[0]}:"
        return self._figures(), title

    def _figures(self) -> dict[str, float]:
        from iceg.evaluation.judge import (
            reference_report,
            relations_by_stamp_report,
            relations_csv_report,
            truth_report,
        )

        if self.reference is not None:
            return reference_report(self.trajectory, self.reference)
        if self.truth is not None:
            return truth_report(self.trajectory, self.truth)
        assert self.relations is not None
        if _is_csv(self.relations):
            return relations_csv_report(self.trajectory, self.relations)
        if self.log is None:
            raise UsageError(
                f"{self.relations.name} names scans by their stamps: give the log they are from with --log"
            )
        return relations_by_stamp_report(self.trajectory, self.relations, self.log)


@dataclass(frozen=True, kw_only=True)
class Plot:
    """Draw the pictures of a run again, from the files in its folder."""

    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR", help="The folder of a run.")]

    def __call__(self) -> None:
        """Read the folder, draw, name the pictures."""
        from iceg.show.run_plots import plot_results

        for path in plot_results(self.results):
            print(path)


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """Drive a robot through a simulated scene: a log in two formats, and the truth."""

    scene: Annotated[
        tyro.conf.Positional[str],
        tyro.conf.arg(
            metavar="SCENE", help="A scene that comes with iceg, such as rooms, or the path of a .world file."
        ),
    ]
    output: Annotated[
        Path,
        tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for log.clf, log.usarsim and truth.csv."),
    ]
    seed: Annotated[int, tyro.conf.arg(help="Of all that is random.")] = 0

    def __call__(self) -> None:
        """Simulate and write."""
        from frontends.simulator.output import write_simulation
        from frontends.simulator.simulation import simulate
        from iceg.show.progress import compile_note

        with compile_note():
            simulation = simulate(self.scene, self.seed)
            write_simulation(self.output, simulation)
        seconds = float(simulation.log.stamps[-1])
        print(f"{len(simulation.log)} scans in {seconds:.1f} s of '{simulation.scene.name}' are in {self.output}")


@dataclass(frozen=True, kw_only=True)
class Optimize:
    """Solve any planar pose graph (g2o), robustly against false closures."""

    graph: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="GRAPH", help="The pose graph, a g2o file.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FILE", help="The solved graph, with the edges that hold.")
    ]
    kernel: Annotated[
        Literal["given", "none", "huber", "cauchy", "geman_mcclure", "dcs"],
        tyro.conf.arg(help="Robust kernel of the closures; given: what the file says."),
    ] = "given"
    kernel_width: Annotated[float, tyro.conf.arg(help="Where it begins to fade.")] = 5.0
    gnc: Annotated[
        tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="Decide by graduated non-convexity which closures hold.")
    ] = False
    pcm: Annotated[
        tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="Drop closures that disagree with most others first.")
    ] = False
    incremental: Annotated[
        tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="Grow the graph pose by pose before solving it at once.")
    ] = False

    def __call__(self) -> None:
        """Read, solve, write, tell."""
        from graph.g2o import read_g2o, write_g2o
        from graph.optimize_g2o import OptimizeOptions, format_report, optimize_g2o

        options = OptimizeOptions(
            kernel=self.kernel,
            kernel_width=self.kernel_width,
            gnc=self.gnc,
            pcm=self.pcm,
            incremental=self.incremental,
        )
        solved = optimize_g2o(read_g2o(self.graph), options)
        write_g2o(self.output, solved.poses, solved.factors, solved.ids)
        print(format_report(solved))
        print(f"The solved graph is {self.output}")


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Compare methods on logs; without FILE, ICE's accuracy and speed on the embedded and the public logs.

    FILE names methods, logs, seeds and parameter sweeps (docs/benchmark.md). Runs that are in DIR already, with the
    same settings and logs, are not made again.
    """

    file: Annotated[
        tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="FILE", help="TOML file of an experiment.")
    ] = None
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for runs, tables and pictures.")
    ] = Path("bench-output")
    workers: Annotated[
        int | None, tyro.conf.arg(metavar="N", help="FILE: runs at a time; left out: one for each core.")
    ] = None
    scheduler: Annotated[
        str | None,
        tyro.conf.arg(metavar="ADDRESS", help="FILE: run on a Dask cluster, such as tcp://127.0.0.1:8786."),
    ] = None
    overwrite: Annotated[tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="FILE: make all runs again.")] = False
    data: Annotated[
        Path | None,
        tyro.conf.arg(metavar="DIR", help="Without FILE: folder of public logs; left out: $ICEG_DATA, else none."),
    ] = None
    parts: Annotated[
        tuple[Literal["runs", "recall", "consistency", "ablation", "growth"], ...],
        tyro.conf.arg(help="Without FILE: which tables; left out: all but growth, which takes many minutes."),
    ] = ()

    def __call__(self) -> None:
        """Run, print, keep."""
        with_file, without = (self.workers, self.scheduler, self.overwrite or None), (self.data, self.parts or None)
        if any(value is not None for value in (with_file if self.file is None else without)):
            raise UsageError(
                "--workers, --scheduler and --overwrite need an experiment FILE"
                if self.file is None
                else "--data and --parts belong to the benchmark without FILE"
            )
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"found --workers {self.workers}, expected at least 1")
        if self.file is None:
            self._real_logs()
        else:
            self._experiment(self.file)

    def _real_logs(self) -> None:
        from iceg.evaluation.bench.real_logs import PARTS, folder_of_logs, real_log_tables
        from iceg.evaluation.bench.tables import format_markdown

        data = folder_of_logs(self.data)
        if data is None:
            print("No folder of public logs (--data, or ICEG_DATA): the embedded log only.")
        for name, rows in real_log_tables(data, self.output, self.parts or PARTS):
            print(f"\n{name.replace('-', ' ').capitalize()}\n{format_markdown(rows)}", flush=True)

    def _experiment(self, file: Path) -> None:
        from iceg.evaluation.bench.comparison import run_experiment
        from iceg.evaluation.bench.experiment import read_experiment
        from iceg.evaluation.bench.plots import save_plots
        from iceg.evaluation.bench.summary import summary_rows, write_results
        from iceg.evaluation.bench.tables import format_markdown

        experiment = read_experiment(file)
        try:
            outcomes = run_experiment(
                experiment,
                self.output,
                workers=self.workers,
                scheduler=self.scheduler,
                overwrite=self.overwrite,
                tell=_tell_outcome,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"complete runs are kept in {self.output}, the same command goes on") from None
        files = [*write_results(outcomes, self.output), *save_plots(outcomes, self.output)]
        print(f"\n{format_markdown(summary_rows(outcomes))}")
        print(f"Results are in {self.output}: {', '.join(path.name for path in files)}; each run in cells/")
        failures = sum(outcome.error is not None for outcome in outcomes)
        if failures:
            raise BenchError(f"{failures} of {len(outcomes)} runs failed; the same command tries them again")


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """What each stage of a run gains, and what calibrated covariances buy: tables for logs with a reference."""

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(
            metavar="LOG",
            help="Logs with NAME.relations.csv, .truth.csv or .reference.csv beside them; left out: the embedded log "
            "and the public ones.",
        ),
    ] = ()
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the tables as CSV, made if missing.")
    ] = Path("ablation-output")
    data: Annotated[
        Path | None, tyro.conf.arg(metavar="DIR", help="Folder of public logs; left out: $ICEG_DATA, else none.")
    ] = None
    faults: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Instead: what each fault of robot, laser and recorder does to a run (docs/robustness.md)."),
    ] = False

    def __call__(self) -> None:
        """Run, print log by log, keep."""
        from iceg.evaluation.ablation import logs_to_judge, write_tables
        from iceg.evaluation.bench.tables import format_markdown
        from iceg.show.progress import compile_note

        data = self.data or (Path(os.environ["ICEG_DATA"]) if os.environ.get("ICEG_DATA") else None)
        if self.faults:
            from iceg.evaluation.robustness import write_faults

            with compile_note():
                rows = list(write_faults(logs_to_judge(self.logs, data), self.output))
            print(f"\n{format_markdown(rows)}", flush=True)
            return
        with compile_note():
            for name, rows in write_tables(logs_to_judge(self.logs, data), self.output):
                print(f"\n{name.capitalize()}\n{format_markdown(rows)}", flush=True)


@dataclass(frozen=True, kw_only=True)
class Nees:
    """Whether the covariances are right: NEES of factors and poses against the truth, over many simulated runs."""

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="LOG", help="Logs with NAME.truth.csv beside them; left out: simulated scenes."),
    ] = ()
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for tables and picture, made if missing.")
    ] = Path("nees-output")
    runs: Annotated[int, tyro.conf.arg(help="Simulated runs in all, spread evenly over the scenes.")] = 50
    scenes: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="SCENE", help="Scenes that come with iceg, or .world files; left out: rooms, corridors, an office."
        ),
    ] = ()

    def __call__(self) -> None:
        """Run, tell run by run, print the table."""
        from iceg.evaluation.bench.tables import format_markdown
        from iceg.evaluation.nees_study import SCENES, recorded, simulated, study, summarise
        from iceg.show.progress import compile_note

        if self.runs < 1:
            raise UsageError(f"found --runs {self.runs}, expected at least 1")
        if self.logs and self.scenes:
            raise UsageError("found logs and --scenes, expected one of them")
        judged = []
        with compile_note():
            recordings = recorded(self.logs) if self.logs else simulated(self.scenes or SCENES, self.runs)
            for one in study(recordings, self.output):
                judged.append(one)
                means = ", ".join(f"{kind} {values.mean():.2f}" for kind, values in one.values.items())
                print(f"{one.scene} {one.seed}: {means}", flush=True)
        print(f"\n{format_markdown(summarise(judged))}")
        print(f"Tables and picture are in {self.output}: nees.csv, nees-runs.csv and nees.png")


@dataclass(frozen=True, kw_only=True)
class PrintConfig:
    """Print all settings with their documentation, as a file for --config."""

    config: _ConfigFile = None
    settings: _Settings = field(default_factory=Config)

    def __call__(self) -> None:
        """Print the settings that would be used."""
        from iceg.config import format_config

        print(format_config(self.settings), end="")


Command = Run | DpSlam | Demo | Info | Eval | Plot | Simulate | Optimize | Bench | Ablation | Nees | PrintConfig


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: what follows the program's name; the process's own when left out.

    Returns:
        The exit code: 0, 1 for an error in the data, 2 in the arguments or settings, 130 when interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return _main(words)
    except KeyboardInterrupt as err:
        print("\niceg: " + ", ".join(["interrupted", *map(str, err.args)]), file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has seen enough; keep the interpreter from flushing into the closed pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED


def _main(words: list[str]) -> int:
    if words == ["--version"]:
        from iceg import __version__

        print(f"iceg {__version__}")
        return 0
    try:
        command = parse(words)
    except IcegError as err:
        return _complain(err, _USAGE)
    try:
        command()
        sys.stdout.flush()
    except UsageError as err:
        return _complain(err, _USAGE)
    except IcegError as err:
        return _complain(err, _FAILED)
    return 0


def parse(words: Sequence[str]) -> Command:
    """The command that the words after the program's name ask for.

    Flags override the file given with --config, which overrides the defaults.

    Raises:
        IcegError: settings in the file or flags that are not valid.
        SystemExit: arguments that are not valid, or a request for help.
    """
    file = _config_file(words)
    is_dp_slam = "dp-slam" in words[:1]
    settings = Config() if file is None or is_dp_slam else read_config(file)
    dp_settings = read_settings(DpSlamConfig, file) if file is not None and is_dp_slam else DpSlamConfig()
    run = Run(log=tyro.MISSING, output=tyro.MISSING, settings=settings)
    dp_slam = DpSlam(log=tyro.MISSING, output=tyro.MISSING, settings=dp_settings)
    commands = (
        Annotated[Run, tyro.conf.subcommand("run", default=run)]
        | Annotated[DpSlam, tyro.conf.subcommand("dp-slam", default=dp_slam)]
        | Annotated[Demo, tyro.conf.subcommand("demo")]
        | Annotated[Info, tyro.conf.subcommand("info")]
        | Annotated[Eval, tyro.conf.subcommand("eval")]
        | Annotated[Plot, tyro.conf.subcommand("plot")]
        | Annotated[Simulate, tyro.conf.subcommand("simulate")]
        | Annotated[Optimize, tyro.conf.subcommand("optimize")]
        | Annotated[Bench, tyro.conf.subcommand("bench")]
        | Annotated[Ablation, tyro.conf.subcommand("ablation")]
        | Annotated[Nees, tyro.conf.subcommand("nees")]
        | Annotated[PrintConfig, tyro.conf.subcommand("config", default=PrintConfig(settings=settings))]
    )
    parsed: Command = tyro.cli(commands, args=words, prog="iceg", description=_DESCRIPTION)
    return parsed


def _config_file(words: Sequence[str]) -> Path | None:
    """The file given with --config, known before the flags are parsed because it sets their defaults."""
    found = None
    for word, following in zip_longest(words, words[1:]):
        if word == "--config" and following is not None:
            found = Path(following)
        elif word.startswith("--config="):
            found = Path(word.partition("=")[2])
    return found


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


def _tell_outcome(outcome: "Outcome", done: int, of: int) -> None:
    from iceg.evaluation.bench.summary import error_of

    head = f"[{done}/{of}] {outcome.cell.name}"
    if outcome.error is not None:
        print(f"{head}: failed: {outcome.error}", file=sys.stderr, flush=True)
        return
    error = error_of(outcome)
    shown = "" if error is None else f"{error:.4f} m, "
    again = ", from before" if outcome.is_reused else ""
    print(f"{head}: {shown}{outcome.figures['scans_per_cpu_s']:.0f} scans/CPU s{again}", flush=True)


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


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == ".csv"


def _complain(error: Exception, code: int) -> int:
    print(f"iceg: {' '.join(str(error).split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())

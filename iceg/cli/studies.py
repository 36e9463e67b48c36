"""Commands that measure: methods against each other, what each part buys, covariances against the truth."""

import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from graph.errors import IcegError
from iceg.cli.options import Json, UsageError
from iceg.cli.telling import Telling

if TYPE_CHECKING:
    from collections.abc import Sequence

    from iceg.evaluation.bench.logs import BenchLog
    from iceg.evaluation.bench.outcome import Outcome
    from iceg.evaluation.regression.cells import Cell
    from iceg.evaluation.regression.outcome import Outcome as RegressionOutcome

Groups = Annotated[
    tuple[Literal["worlds", "logs", "faults", "simulated", "carried", "random", "degraded"], ...],
    tyro.conf.arg(help="Regression table: which cells; left out: all.", help_behavior_hint=""),
]
Long = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(
        help="Regression table: every cell there is, instead of a sample that takes some ten minutes.",
        help_behavior_hint="",
    ),
]
Seeds = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="A-B",
        help="Regression table: random scenes, such as 5000-5099.",
        help_behavior_hint="",
    ),
]
Odometry = Annotated[
    tuple[Literal["good", "fair", "poor", "none"], ...],
    tyro.conf.arg(help="--seeds: only such odometry; left out: any.", help_behavior_hint=""),
]

Noise = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="A-B",
        help="As --seeds: the faults where a millimetre decides.",
        help_behavior_hint="",
    ),
]
OneLaser = Annotated[
    str | None,
    tyro.conf.arg(metavar="NAME", help="--seeds: this laser of `iceg simulate` for all.", help_behavior_hint=""),
]

OneFault = Annotated[
    str | None,
    tyro.conf.arg(metavar="NAME", help="--seeds: this fault of docs/robustness.md in all.", help_behavior_hint=""),
]


class BenchError(IcegError):
    """Runs of a benchmark that failed."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Compare methods on logs; without FILE, accuracy and speed on the known logs.

    FILE names methods, logs, seeds and parameter sweeps (docs/benchmark.md). Runs that are in DIR already, with the
    same settings and logs, are not made again.
    """

    file: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(metavar="[FILE]", help="TOML file of an experiment.", help_behavior_hint=""),
    ] = None
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for runs, tables and pictures.")
    ] = Path("bench-output")
    workers: Annotated[
        int | None,
        tyro.conf.arg(
            metavar="N", help="FILE, regression: runs at a time; left out: one for each core.", help_behavior_hint=""
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="ADDRESS",
            help="FILE: run on a Dask cluster, such as tcp://127.0.0.1:8786; left out: on this machine.",
            help_behavior_hint="",
        ),
    ] = None
    overwrite: Annotated[
        tyro.conf.FlagCreatePairsOff[bool], tyro.conf.arg(help="FILE: make all runs again.", help_behavior_hint="")
    ] = False
    data: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="DIR",
            help="Without FILE: folder of public logs; left out: $ICEG_DATA, else none.",
            help_behavior_hint="",
        ),
    ] = None
    parts: Annotated[
        tuple[Literal["runs", "recall", "consistency", "ablation", "solvers", "growth", "mapper", "regression"], ...],
        tyro.conf.arg(
            help="Without FILE: which tables; left out: all but growth, mapper and regression, which take minutes.",
            help_behavior_hint="",
        ),
    ] = ()
    groups: Groups = ()
    long: Long = False
    seeds: Seeds = None
    odometry: Odometry = ()
    laser: OneLaser = None
    fault: OneFault = None
    noise: Noise = None
    baseline: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="CSV",
            help="regression: an earlier regression.csv to compare with; left out: the one kept with iceg.",
            help_behavior_hint="",
        ),
    ] = None
    json: Json = False

    def __call__(self) -> None:
        """Run, print, keep."""
        from iceg.results import check_directory

        has_regression = "regression" in self.parts
        workers = None if has_regression else self.workers
        with_file, without = (workers, self.scheduler, self.overwrite or None), (self.data, self.parts or None)
        if any(value is not None for value in (with_file if self.file is None else without)):
            raise UsageError(
                "--workers, --scheduler and --overwrite need an experiment FILE (--workers: or --parts regression)"
                if self.file is None
                else "--data and --parts belong to the benchmark without FILE"
            )
        if not has_regression and (_chooses_cells(self) or self.baseline is not None):
            raise UsageError(
                "--groups, --long, --seeds, --odometry, --laser, --fault, --noise, --baseline need --parts regression"
            )
        _check_choice(self)
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"found --workers {self.workers}, expected at least 1")
        check_directory(self.output, overwrite=True)
        with Telling(as_json=self.json) as telling:
            if self.file is None:
                self._real_logs(telling)
            else:
                self._experiment(self.file, telling)

    def _real_logs(self, telling: Telling) -> None:
        from iceg.evaluation.bench.real_logs import PARTS, real_log_tables

        tables = [part for part in self.parts if part != "regression"] if self.parts else PARTS
        data = None if self.seeds is not None and not tables else _public_logs(self.data, telling)
        for name, rows in real_log_tables(data, self.output, tables):
            telling.table(name, name.replace("-", " ").capitalize(), rows)
        if "regression" in self.parts:
            self._regression(data, telling)

    def _regression(self, data: Path | None, telling: Telling) -> None:
        from iceg.evaluation.regression.comparison import changed_cells
        from iceg.evaluation.regression.kept import BASELINE
        from iceg.evaluation.regression.outcome import read_outcomes
        from iceg.evaluation.regression.study import compared_by_group, outcomes_of, total_rows

        before = read_outcomes(self.baseline or BASELINE)
        cells, _ = _chosen_cells(self, data)
        after = outcomes_of(cells, data, self.output, self.workers or _cores(), _Counted(len(cells), telling))
        telling.table("regression", "Regression table", total_rows(after))
        if not {one.name for one in before} & {one.name for one in after}:
            telling.say("The baseline has none of these cells: --baseline names an earlier regression.csv that does.")
            return
        telling.table("against_baseline", "Against the baseline", compared_by_group(before, after))
        changed = changed_cells(before, after)
        telling.table("changed_cells", f"Cells that changed: {len(changed)}", changed)

    def _experiment(self, file: Path, telling: Telling) -> None:
        from graph.publish import publishing
        from iceg.evaluation.bench.comparison import run_experiment
        from iceg.evaluation.bench.experiment import read_experiment
        from iceg.evaluation.bench.plots import save_plots
        from iceg.evaluation.bench.summary import RESULT_FILES, summary_rows, write_results

        experiment = read_experiment(file)
        try:
            outcomes = run_experiment(
                experiment,
                self.output,
                workers=self.workers,
                scheduler=self.scheduler,
                overwrite=self.overwrite,
                tell=partial(_tell_outcome, telling),
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"complete runs are kept in {self.output}, the same command goes on") from None
        with publishing(self.output, replaces=RESULT_FILES) as staging:
            files = [*write_results(outcomes, staging), *save_plots(outcomes, staging)]
        telling.table("summary", "", summary_rows(outcomes))
        telling.say(f"Results are in {self.output}: {', '.join(path.name for path in files)}; each run in cells/")
        failures = sum(outcome.error is not None for outcome in outcomes)
        if failures:
            raise BenchError(f"{failures} of {len(outcomes)} runs failed; the same command tries them again")


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """What each stage of a run, and what calibrated covariances buy."""

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(
            metavar="[LOG ...]",
            help="Logs with NAME.relations.csv, .truth.csv or .reference.csv beside them; left out: the embedded log "
            "and the public ones.",
            help_behavior_hint="",
        ),
    ] = ()
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for the tables as CSV, made if missing.")
    ] = Path("ablation-output")
    data: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="DIR", help="Folder of public logs; left out: $ICEG_DATA, else none.", help_behavior_hint=""
        ),
    ] = None
    faults: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(
            help="Instead: what each fault of robot, laser and recorder does to a run (docs/robustness.md).",
            help_behavior_hint="",
        ),
    ] = False
    rules: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(
            help="Instead: what each rule and gate is worth, by a regression table without (regression.md).",
            help_behavior_hint="",
        ),
    ] = False
    scales: Annotated[
        tuple[str, ...] | None,
        tyro.conf.arg(
            metavar="[NAME ...]",
            help="Instead: what half and twice of each number among the settings does to the error; of some or of "
            "stages, such as loops; none named: all that decide the trajectory.",
            help_behavior_hint="",
        ),
    ] = None
    off: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="[RULE ...]",
            help="--rules: the rules to switch off, 'A + B' for both at once; left out: each.",
            help_behavior_hint="",
        ),
    ] = ()
    groups: Groups = ()
    long: Long = False
    seeds: Seeds = None
    odometry: Odometry = ()
    laser: OneLaser = None
    fault: OneFault = None
    noise: Noise = None
    workers: Annotated[
        int | None,
        tyro.conf.arg(metavar="N", help="--rules: runs at a time; left out: one for each core.", help_behavior_hint=""),
    ] = None
    json: Json = False

    def __call__(self) -> None:
        """Run, print log by log, keep."""
        with Telling(as_json=self.json) as telling:
            self._run(telling)

    def _run(self, telling: Telling) -> None:
        from iceg.evaluation.ablation import logs_to_judge, write_tables
        from iceg.results import check_directory
        from iceg.show.progress import compile_note

        if self.logs and self.data is not None:
            raise UsageError("found logs and --data, expected one of them")
        if self.rules:
            self._without_rules(telling)
            return
        if self.off or _chooses_cells(self) or self.workers is not None:
            raise UsageError(
                "--off, --groups, --long, --seeds, --odometry, --laser, --fault, --noise and --workers need --rules"
            )
        check_directory(self.output, overwrite=True)
        logs = logs_to_judge(self.logs, None if self.logs else _public_logs(self.data, telling))
        if self.scales is not None:
            self._with_scaled_settings(logs, telling)
            return
        if self.faults:
            from iceg.evaluation.robustness import write_faults

            with compile_note():
                rows = list(write_faults(logs, self.output))
            telling.table("faults", "", rows)
            return
        with compile_note():
            for name, rows in write_tables(logs, self.output):
                telling.table(name, name.capitalize(), rows)

    def _with_scaled_settings(self, logs: "list[BenchLog]", telling: Telling) -> None:
        from iceg.evaluation.setting_scales import names_to_scale, write_scales
        from iceg.show.progress import compile_note

        if self.faults:
            raise UsageError("found --scales and --faults, expected one of them")
        names = names_to_scale(self.scales or ())
        with compile_note():
            rows = write_scales(logs, names, self.output, lambda n, of: telling.say(f"{n} of {of} settings"))
        telling.table("settings", "", rows)

    def _without_rules(self, telling: Telling) -> None:
        from iceg.evaluation.regression.rules import RULES, unknown_rules
        from iceg.evaluation.regression.study import rule_rows
        from iceg.results import check_directory

        if self.logs or self.faults or self.scales is not None:
            raise UsageError("--rules goes with no logs, --faults or --scales: it runs the regression table")
        unknown = unknown_rules(self.off)
        if unknown:
            raise UsageError(f"found --off '{unknown[0]}', expected some of {', '.join(RULES)}")
        _check_choice(self)
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"found --workers {self.workers}, expected at least 1")
        check_directory(self.output, overwrite=True)
        rules, data = self.off or tuple(RULES), None if self.seeds is not None else _public_logs(self.data, telling)
        cells, on = _chosen_cells(self, data)
        tell = _Counted(len(cells) * (1 + len(rules)), telling)
        rows = rule_rows(cells, data, rules, self.output, self.workers or _cores(), tell, on)
        telling.table("rules", "", rows)


@dataclass(frozen=True, kw_only=True)
class Nees:
    """Whether the covariances are right: NEES over many simulated runs."""

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(
            metavar="[LOG ...]",
            help="Logs with NAME.truth.csv beside them; left out: simulated scenes.",
            help_behavior_hint="",
        ),
    ] = ()
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for tables and picture, made if missing.")
    ] = Path("nees-output")
    runs: Annotated[int, tyro.conf.arg(help="Simulated runs in all, spread evenly over the scenes.")] = 50
    scenes: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="[SCENE ...]",
            help="Scenes that come with iceg, or .world files; left out: rooms, corridors, an office.",
            help_behavior_hint="",
        ),
    ] = ()
    json: Json = False

    def __call__(self) -> None:
        """Run, tell run by run, print the table."""
        from iceg.evaluation.nees_study import SCENES, recorded, simulated, study, summarise
        from iceg.results import check_directory
        from iceg.show.progress import compile_note

        if self.runs < 1:
            raise UsageError(f"found --runs {self.runs}, expected at least 1")
        if self.logs and self.scenes:
            raise UsageError("found logs and --scenes, expected one of them")
        check_directory(self.output, overwrite=True)
        judged = []
        with Telling(as_json=self.json) as telling, compile_note():
            recordings = recorded(self.logs) if self.logs else simulated(self.scenes or SCENES, self.runs)
            for one in study(recordings, self.output):
                judged.append(one)
                means = ", ".join(f"{kind} {values.mean():.2f}" for kind, values in one.values.items())
                telling.say(f"{one.scene} {one.seed}: {means}")
            telling.table("nees", "", summarise(judged))
            telling.say(f"Tables and picture are in {self.output}: nees.csv, nees-runs.csv and nees.png")


def _chooses_cells(command: Bench | Ablation) -> bool:
    """Whether it says which cells of the regression table to run."""
    samples = (command.seeds, command.noise, command.laser, command.fault)
    return bool(command.groups or command.long or command.odometry or any(word is not None for word in samples))


def _check_choice(command: Bench | Ablation) -> None:
    """Refuse options that choose cells in two ways."""
    if command.seeds is None and (command.odometry or command.laser is not None or command.fault is not None):
        raise UsageError("--odometry, --laser and --fault need --seeds")
    chosen = (command.groups or command.long, command.seeds is not None, command.noise is not None)
    if sum(map(bool, chosen)) > 1:
        raise UsageError("found two of --seeds, --noise, and --groups or --long, expected one of them")


def _chosen_cells(command: Bench | Ablation, data: Path | None) -> "tuple[list[Cell], str]":
    """The cells of the regression table that a command is about; what they are, "" for their groups."""
    from iceg.evaluation.regression.cells import NO_FAULT, chosen, close_cells
    from iceg.evaluation.regression.random_cells import in_words, random_cells, seed_range

    if command.noise is not None:
        return close_cells(data, seed_range(command.noise)), f"faults where a millimetre decides, noise {command.noise}"
    if command.seeds is None:
        return chosen(data, command.groups, short=not command.long), ""
    sample = (command.seeds, command.odometry, command.laser, command.fault or NO_FAULT)
    return random_cells(*sample), in_words(*sample)


def _public_logs(given: Path | None, telling: Telling) -> Path | None:
    """The folder of public logs; says so where there is none."""
    from iceg.evaluation.bench.logs import folder_of_logs

    data = folder_of_logs(given)
    if data is None:
        telling.say("No folder of public logs (--data, or ICEG_DATA): the embedded log only.")
    return data


class _Counted:
    """Tells cells of the regression table as they are done."""

    def __init__(self, of: int, telling: Telling) -> None:
        self._done, self._of, self._telling = 0, of, telling

    def __call__(self, rule: str, outcomes: "Sequence[RegressionOutcome]") -> None:
        for one in outcomes:
            self._done += 1
            without = f" without {rule}" if rule else ""
            self._telling.say(f"[{self._done}/{self._of}] {one.name}{without}: {one.error_m:.4f} m")


def _cores() -> int:
    return os.cpu_count() or 1


def _tell_outcome(telling: Telling, outcome: "Outcome", done: int, of: int) -> None:
    from iceg.evaluation.bench.summary import error_of

    head = f"[{done}/{of}] {outcome.cell.name}"
    if outcome.error is not None:
        print(f"{head}: failed: {outcome.error}", file=sys.stderr, flush=True)
        return
    error = error_of(outcome)
    shown = "" if error is None else f"{error:.4f} m, "
    again = ", from before" if outcome.is_reused else ""
    telling.say(f"{head}: {shown}{outcome.figures['scans_per_cpu_s']:.0f} scans/CPU s{again}")

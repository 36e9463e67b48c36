"""What a scan costs in short and in long runs: processor time and memory over ever longer parts of one log."""

import io
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from graph.atomic import write_atomically
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.runs import cpu_by_stage, run_in_fresh_process
from iceg.evaluation.bench.tables import Row
from iceg.results import read_summary

SCENE = "endless"
LENGTHS = (6_250, 12_500, 25_000, 100_000)
PICTURE = "growth.png"
_LOG, _TRUTH = "log.clf", "truth.csv"
_DOTS_PER_INCH = 130


@dataclass(frozen=True, slots=True, kw_only=True)
class LongRun:
    """What the run of one part of the log took.

    Attributes:
        scans: how many the part has.
        key_poses: of the run.
        closures: accepted.
        cpu_s: processor time by stage [s]; `start and reading` is what the stages leave of the whole process.
        peak_memory_mb: largest resident memory of the process [MB].
        figures: against the truth.
    """

    scans: int
    key_poses: int
    closures: int
    cpu_s: dict[str, float]
    peak_memory_mb: float
    figures: dict[str, float]

    @property
    def cpu_total_s(self) -> float:
        """Processor time of the whole process [s]."""
        return sum(self.cpu_s.values())


def simulated_log(folder: Path, scene: str = SCENE, seed: int = 0) -> None:
    """Write log and truth of a scene into `folder`, unless they are there."""
    if (folder / _TRUTH).exists():
        return
    from frontends.simulator.output import write_simulation
    from frontends.simulator.simulation import simulate

    write_simulation(folder, simulate(scene, seed))


def long_runs(folder: Path, lengths: Sequence[int] = LENGTHS) -> Iterator[LongRun]:
    """Run the first part of the log in `folder` and ever longer ones, each in a fresh process.

    Args:
        folder: holds `log.clf` and `truth.csv`; runs go into folders beside them.
        lengths: scans of each part; a part longer than the log is the whole log.

    Yields:
        One run after the other.

    Raises:
        IcegError: a run failed.
    """
    for n_scans in lengths:
        run = folder / f"first-{n_scans}"
        run.mkdir(parents=True, exist_ok=True)
        log, truth = run / _LOG, run / _TRUTH
        _cut(folder / _LOG, log, "FLASER", n_scans)
        _cut(folder / _TRUTH, truth, "", n_scans + 1)
        yield _run(BenchLog(name=run.name, path=log, known=truth), run / "results")
        log.unlink()


def growth_rows(runs: Sequence[LongRun]) -> list[Row]:
    """A row a run: milliseconds a scan by stage, of each scan more than in the run before, and memory."""
    rows: list[Row] = []
    for before, run in zip([None, *runs], runs, strict=False):
        more = None if before is None else 1e3 * (run.cpu_total_s - before.cpu_total_s) / (run.scans - before.scans)
        rows.append(
            {
                "scans": run.scans,
                "key poses": run.key_poses,
                "closures": run.closures,
                "CPU a scan [ms]": 1e3 * run.cpu_total_s / run.scans,
                "of each scan more [ms]": more,
                **{f"{stage.replace('_', ' ')} [ms]": 1e3 * s / run.scans for stage, s in run.cpu_s.items()},
                "peak memory [MB]": run.peak_memory_mb,
                "ATE [m]": run.figures.get("ate_rmse"),
                "largest error [m]": run.figures.get("ate_max"),
            }
        )
    return rows


def save_plot(runs: Sequence[LongRun], path: Path) -> None:
    """Draw processor time a scan, stage upon stage, and memory, over the length of the run."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    time_axes, memory_axes = figure.subplots(1, 2)
    scans = [run.scans for run in runs]
    stages = list(runs[0].cpu_s)
    per_scan = [[1e3 * run.cpu_s[stage] / run.scans for run in runs] for stage in stages]
    time_axes.stackplot(scans, per_scan, labels=[stage.replace("_", " ") for stage in stages])
    time_axes.set_ylabel("processor time a scan [ms]")
    time_axes.legend(fontsize=6, loc="upper right", ncols=2, reverse=True)
    time_axes.set_ylim(0.0, 1.5 * max(map(sum, zip(*per_scan, strict=True))))
    memory_axes.plot(scans, [run.peak_memory_mb for run in runs], "o-", color="#0072b2")
    for run in runs:
        memory_axes.annotate(
            f"{run.peak_memory_mb:.0f}",
            (run.scans, run.peak_memory_mb),
            (0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=7,
        )
    memory_axes.set_ylabel("peak memory [MB]")
    memory_axes.set_ylim(0.0, 1.15 * max(run.peak_memory_mb for run in runs))
    for axes in (time_axes, memory_axes):
        axes.set_xlabel("scans")
        axes.set_xlim(0.0, 1.02 * scans[-1])
        axes.grid(alpha=0.25)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    write_atomically(path, content.getvalue())


def _run(log: BenchLog, results: Path) -> LongRun:
    timed = run_in_fresh_process(log.path, results)
    summary = read_summary(results)
    stages = cpu_by_stage(summary)
    return LongRun(
        scans=summary["scans"],
        key_poses=summary["key_poses"],
        closures=summary["closures"]["accepted"],
        cpu_s={"start and reading": timed.cpu_s - sum(stages.values()), **stages},
        peak_memory_mb=summary["peak_memory_mb"],
        figures=log.judge(results),
    )


def _cut(whole: Path, part: Path, counted: str, n: int) -> None:
    """The lines of a file up to the n-th of those that begin with `counted`."""
    with whole.open(encoding="ascii") as source, part.open("w", encoding="ascii", newline="\n") as target:
        numbers = itertools.count(1)
        for line in source:
            target.write(line)
            if line.startswith(counted) and next(numbers) == n:
                return

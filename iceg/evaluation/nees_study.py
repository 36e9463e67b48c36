"""Are the covariances of a run right: NEES against the truth, of every kind of factor and of the poses, over many runs.

What is tested. A NEES of three degrees of freedom has the mean 3 where the covariance is right. Within a run the values
are no independent samples: neighbouring factors share scans and references, poses share all that lies before them. Only
the runs, each with its own seed, are independent. So each run counts once, with its mean. Whatever the correlation
inside it, that mean has a variance of at most the 6 of a single value, so the interval that the mean of N independent
values keeps with 95 % probability, the χ² quantiles of 3 N degrees of freedom over N, holds for the mean over N runs
too: a figure outside says that covariances are wrong. Figures inside can still be told from 3 where the runs agree with
each other; their standard error, from the spread of the runs, says how well. The table gives both.

Factors are judged as they were measured. The joint refinement of poses and map, which knows more than matches do,
carries the factors of the finished graph along, so that their errors are its own and smaller than what they claim.

Closures that their robust kernel has taken out of force pull at nothing, and are counted instead of judged. Beside the
truth stands what can be had without one: each factor predicted by all the others (`cross_validation`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from frontends.simulator.simulation import simulate
from graph.batch import optimize
from graph.factors import Factor
from graph.publish import publishing
from graph.se2 import between
from iceg.config import Config
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.consistency import (
    DEGREES_OF_FREEDOM,
    chi_square_quantiles,
    nees,
    pose_nees,
    relative_pose_errors,
)
from iceg.evaluation.cross_validation import FADED, KINDS, leave_one_out
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.trajectory import check_one_row_per_scan, read_truth_csv
from iceg.maps.config import GridConfig
from iceg.pipeline import run

SCENES = ("room", "rooms", "corridor", "long_corridor", "office")
POSES = "key poses"
JUDGED = (*KINDS, POSES)
TABLES = ("nees.csv", "nees-runs.csv")
FIRST_SEED = 10
"""Those before it served to calibrate the covariances."""
_COARSE = Config(grid=GridConfig(resolution=0.5))
_ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A log with its truth.

    Attributes:
        scene: recordings of one scene are judged together, and with all others.
        seed: of the simulation; 0 for a log from a file.
        log: the log.
        truth: (n_scans, 3) true poses, in any frame.
    """

    scene: str
    seed: int
    log: Log
    truth: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedRun:
    """One run.

    Attributes:
        scene: where.
        seed: of the simulation.
        values: NEES against the truth, (m,) of each of `JUDGED` there is.
        without_truth: the same of the factors as the rest of the graph sees them, where it sees them.
        faded: closures out of force, which are not among the values.
    """

    scene: str
    seed: int
    values: dict[str, NDArray[np.float64]]
    without_truth: dict[str, NDArray[np.float64]]
    faded: int


def simulated(scenes: Sequence[str], runs: int) -> Iterator[Recording]:
    """Seeds of each scene that nothing was calibrated on: `runs` in all, one more for the first scenes if need be."""
    each, rest = divmod(runs, len(scenes))
    for place, scene in enumerate(scenes):
        for seed in range(FIRST_SEED, FIRST_SEED + each + (place < rest)):
            simulation = simulate(scene, seed)
            yield Recording(scene=scene, seed=seed, log=simulation.log, truth=simulation.truth)


def recorded(logs: Sequence[Path]) -> Iterator[Recording]:
    """Logs with their truth, `NAME.truth.csv`, beside them.

    Raises:
        LogError: a log cannot be read.
        EvaluationError: there is no truth, or not one pose for each scan.
    """
    for path in logs:
        name = path.name.partition(".")[0]
        truth = path.with_name(f"{name}.truth.csv")
        log = read_log(path)
        if not truth.exists():
            raise EvaluationError(f"{path}: found no {truth.name} beside it, expected the true pose of every scan")
        poses = read_truth_csv(truth)
        check_one_row_per_scan(log.odometry, poses, truth)
        yield Recording(scene=name, seed=0, log=log, truth=poses)


def judge_run(recording: Recording, config: Config = _COARSE) -> JudgedRun:
    """Run the whole pipeline and compare its factors and key poses with the truth."""
    result = run(recording.log, config)
    truth, factors = recording.truth[result.key_scans], result.graph.factors
    left_out = leave_one_out(factors, optimize(factors, result.key_poses).poses)
    values: dict[str, NDArray[np.float64]] = {}
    without_truth: dict[str, NDArray[np.float64]] = {}
    faded = left_out.weights <= FADED
    for kind in KINDS:
        chosen = np.array([factor.kind == kind for factor in factors]) & ~faded
        if chosen.any():
            values[kind] = factor_nees([factors[k] for k in np.flatnonzero(chosen)], truth)
            without_truth[kind] = left_out.chi_square[chosen & ~np.isnan(left_out.chi_square)]
    if len(truth) > 1:
        values[POSES] = pose_nees(result.key_poses, truth, result.covariances)
    return JudgedRun(
        scene=recording.scene, seed=recording.seed, values=values, without_truth=without_truth, faded=int(faded.sum())
    )


def factor_nees(factors: Sequence[Factor], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """NEES of factors between key poses.

    Args:
        factors: none of them a prior.
        truth: (k, 3) true poses of the key poses.

    Returns:
        (m,).

    Raises:
        EvaluationError: a covariance is not positive definite.
    """
    i, j = (np.array([getattr(factor, end) for factor in factors], dtype=np.int64) for end in "ij")
    errors = relative_pose_errors(np.array([factor.T_i_j for factor in factors]), between(truth[i], truth[j]))
    return nees(errors, np.array([factor.covariance for factor in factors]))


def summarise(runs: Sequence[JudgedRun]) -> list[Row]:
    """One row for each kind and scene, and for each kind over all scenes; every run counts the same.

    Returns:
        How many runs and values; the mean over the runs with its standard error and the 95 % bounds for so many
        independent runs; whether it is inside; median and share inside the 95 % region of all values; the mean that
        can be had without the truth; closures out of force.
    """
    scenes = list(dict.fromkeys(one.scene for one in runs))
    groups = [(_ALL, list(runs))] if len(scenes) > 1 else []
    groups = [(scene, [one for one in runs if one.scene == scene]) for scene in scenes] + groups
    return [
        _row(kind, scene, [one for one in group if kind in one.values])
        for kind in JUDGED
        for scene, group in groups
        if any(kind in one.values for one in group)
    ]


def mean_bounds(runs: int) -> tuple[float, float]:
    """The 95 % interval of the mean NEES over so many independent runs."""
    low, high = chi_square_quantiles(np.array([0.025, 0.975]), DEGREES_OF_FREEDOM * runs) / runs
    return float(low), float(high)


def study(recordings: Iterable[Recording], output: Path) -> Iterator[JudgedRun]:
    """Judge runs one after the other; their tables and the picture are in the folder at the end.

    Args:
        recordings: what to run.
        output: folder of `nees.csv`, `nees-runs.csv` and `nees.png`, made if missing.

    Yields:
        Each run as it is judged.
    """
    runs = []
    for recording in recordings:
        runs.append(judge_run(recording))
        yield runs[-1]
    from iceg.show.nees_plot import save_nees_plot

    with publishing(output) as staging:
        summary, each = (staging / name for name in TABLES)
        write_csv(summarise(runs), summary)
        write_csv([_run_row(one) for one in runs], each)
        save_nees_plot({kind: _together(runs, kind) for kind in JUDGED}, staging / "nees.png")


def _row(kind: str, scene: str, runs: Sequence[JudgedRun]) -> Row:
    means = np.array([one.values[kind].mean() for one in runs])
    together = _together(runs, kind)
    low, high = mean_bounds(len(runs))
    unseen = [one.without_truth[kind].mean() for one in runs if len(one.without_truth.get(kind, ()))]
    return {
        "NEES of": kind,
        "scene": scene,
        "runs": len(runs),
        "values": len(together),
        "mean": float(means.mean()),
        "standard error": float(means.std(ddof=1) / len(means) ** 0.5) if len(means) > 1 else None,
        "low": low,
        "high": high,
        "within": "yes" if low <= means.mean() <= high else "no",
        "median": float(np.median(together)),
        "in 95 % region": float((together <= chi_square_quantiles(np.array(0.95), DEGREES_OF_FREEDOM)).mean()),
        "without truth": float(np.mean(unseen)) if unseen else None,
        "out of force": sum(one.faded for one in runs) if kind == "closure" else None,
    }


def _run_row(one: JudgedRun) -> Row:
    means: Row = {kind: float(one.values[kind].mean()) for kind in JUDGED if kind in one.values}
    return {"scene": one.scene, "seed": one.seed, **means, "closures out of force": one.faded}


def _together(runs: Sequence[JudgedRun], kind: str) -> NDArray[np.float64]:
    return np.concatenate([one.values.get(kind, np.empty(0)) for one in runs])

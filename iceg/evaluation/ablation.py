"""What calibrated covariances buy, and what each stage of a run gains, on every log with something to judge it by."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from graph.batch import optimize
from graph.factors import Factor
from graph.odometry import OdometryModel
from graph.publish import publishing
from graph.se2 import between, compose
from iceg.config import Config
from iceg.evaluation.bench.logs import BenchLog, find_logs, possible_beside
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.cross_validation import cross_validation
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import read_relations_csv
from iceg.evaluation.report import relations_report, trajectory_report
from iceg.evaluation.trajectory import (
    check_one_row_per_scan,
    poses_of_scans,
    read_reference_csv,
    read_truth_csv,
    trajectory_errors,
)
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult
from iceg.slam.config import FinishConfig, LoopClosureConfig
from iceg.slam.joint_config import JointRefinementConfig
from iceg.slam.odometry.calibration import OdometryCalibration

Covariances = Literal["calibrated", "constant", "identity"]
"""As the run found them; the median variances of each kind of factor for all of that kind; 1 m² and 1 rad² for all."""

Judge = Callable[[NDArray[np.float64]], dict[str, float]]

_COARSE = GridConfig(resolution=0.5)
_OPEN = LoopClosureConfig(enabled=False)
_STAGES: dict[str, Config] = {
    "front end": Config(loops=_OPEN, finish=FinishConfig(enabled=False), grid=_COARSE),
    "+ loops": Config(finish=FinishConfig(enabled=False), grid=_COARSE),
    "+ finish": Config(finish=FinishConfig(joint=JointRefinementConfig(enabled=False)), grid=_COARSE),
    "+ joint refinement": Config(grid=_COARSE),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ablation:
    """The tables of one log: `covariances` a row for each choice, `stages` a row for each stage."""

    covariances: list[Row]
    stages: list[Row]


def logs_to_judge(paths: Sequence[Path], data: Path | None) -> list[BenchLog]:
    """The logs given, or the embedded one and the public ones at hand: those with something known about them.

    Args:
        paths: of logs, with `NAME.relations.csv`, `NAME.truth.csv` or `NAME.reference.csv` beside them.
        data: folder of the public logs, looked at if no log is given.

    Raises:
        EvaluationError: a log given is not there or has nothing to be judged by.
    """
    if not paths:
        return [log for log in find_logs(data) if log.known is not None]
    for path in paths:
        if not path.is_file():
            raise EvaluationError(f"{path}: found no such file, expected a log")
    logs = [BenchLog.at(path) for path in paths]
    for log in logs:
        _known(log)
    return logs


def ablation(log: BenchLog) -> Ablation:
    """Run one log stage by stage, then solve the whole run's graph with other covariances.

    Raises:
        EvaluationError: nothing is known about the log.
    """
    recorded, judge = read_log(log.path), judge_of(log)
    runs = {stage: run(recorded, config) for stage, config in _STAGES.items()}
    whole = runs["+ joint refinement"]
    trajectories = {"odometry": recorded.odometry, "calibrated odometry": calibrated_odometry(whole)}
    trajectories |= {stage: result.trajectory for stage, result in runs.items()}
    return Ablation(
        covariances=[{"log": log.name, "covariances": choice, **_solved_with(choice, whole, judge)} for choice in _ALL],
        stages=[{"log": log.name, "stage": stage, **_errors(judge(T))} for stage, T in trajectories.items()],
    )


def write_tables(logs: Sequence[BenchLog], output: Path) -> Iterator[tuple[str, list[Row]]]:
    """Both tables log by log, printed by whoever asks, and kept as CSV.

    Args:
        logs: what to run.
        output: folder of `ablation-covariances.csv` and `ablation-stages.csv`, made if missing.

    Yields:
        Name and new rows of a table, after each log.
    """
    tables: dict[str, list[Row]] = {"stages": [], "covariances": []}
    for log in logs:
        found = ablation(log)
        new = {"stages": found.stages, "covariances": found.covariances}
        for name, rows in new.items():
            tables[name] += rows
        with publishing(output) as staging:
            for name, rows_so_far in tables.items():
                write_csv(rows_so_far, staging / f"ablation-{name}.csv")
        yield from new.items()


def with_covariances(factors: Sequence[Factor], choice: Covariances) -> list[Factor]:
    """The same factors with other covariances; priors keep theirs."""
    if choice == "calibrated":
        return list(factors)
    kinds = {factor.kind for factor in factors} - {"prior"}
    of_kind = {kind: _median_variances(factors, kind) if choice == "constant" else np.eye(3) for kind in kinds}
    return [f if f.kind == "prior" else replace(f, covariance=of_kind[f.kind]) for f in factors]


def moved_with_key_poses(result: SlamResult, key_poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n_scans, 3) the trajectory of a run when its key poses lie elsewhere: each scan goes with the key before it."""
    scans = np.arange(len(result.trajectory))
    key = np.searchsorted(result.key_scans, scans, side="right") - 1
    return compose(key_poses[key], between(result.key_poses[key], result.trajectory))


def calibrated_odometry(result: SlamResult) -> NDArray[np.float64]:
    """(n_scans, 3) the log's odometry without the systematic errors that the run found in it."""
    if not result.log.has_odometry:
        return result.log.odometry
    found = result.summary["odometry"]
    calibration = OdometryCalibration(
        translation_scale=found["translation_scale"],
        heading_scale=found["heading_scale"],
        heading_per_metre=found["heading_per_metre_rad"],
        heading_shift=found["heading_shift_scans"],
        translation_shift=found["translation_shift_scans"],
        T_odometry_laser=found["T_odometry_laser"],
        noise=OdometryModel(),
    )
    return calibration.apply(result.log.odometry, result.config.front_end.calibration.sudden)


_ALL: tuple[Covariances, ...] = get_args(Covariances)


def _solved_with(choice: Covariances, result: SlamResult, judge: Judge) -> Row:
    factors = with_covariances(result.graph.factors, choice)
    solved = optimize(factors, result.key_poses)
    nees = {kind: found.judged.mean for kind, found in cross_validation(factors, solved.poses).items()}
    return {
        **_errors(judge(moved_with_key_poses(result, solved.poses))),
        "NEES odometry": nees.get("odometry"),
        "NEES ICE": nees.get("ice"),
        "NEES closures": nees.get("closure"),
        "closures out of force": int((~solved.inliers).sum()),
    }


def _median_variances(factors: Sequence[Factor], kind: str) -> NDArray[np.float64]:
    variances = [np.diag(factor.covariance) for factor in factors if factor.kind == kind]
    return np.diag(np.median(variances, axis=0))


def _errors(figures: dict[str, float]) -> Row:
    return {
        "relations mean [m]": figures.get("trans_mean"),
        "median [m]": figures.get("trans_median"),
        "rotation mean [°]": figures.get("rot_mean_deg"),
        "ATE [m]": figures.get("ate_rmse"),
        "heading [°]": figures.get("rot_rmse_deg"),
    }


def judge_of(log: BenchLog) -> Judge:
    """What gives the errors of a trajectory (n_scans, 3) by what is known about its log.

    Raises:
        EvaluationError: nothing is.
    """
    known = _known(log)
    if known.name.endswith("relations.csv"):
        relations = read_relations_csv(known)
        return lambda T_map_robot: relations_report(T_map_robot, relations)
    if known.name.endswith("truth.csv"):
        truth = read_truth_csv(known)
        return lambda T_map_robot: _against_truth(T_map_robot, truth, known)
    scans, reference = read_reference_csv(known)
    return lambda T_map_robot: trajectory_report(
        trajectory_errors(poses_of_scans(T_map_robot, scans, known), reference)
    )


def _against_truth(T_map_robot: NDArray[np.float64], truth: NDArray[np.float64], path: Path) -> dict[str, float]:
    check_one_row_per_scan(T_map_robot, truth, path)
    return trajectory_report(trajectory_errors(T_map_robot, truth))


def _known(log: BenchLog) -> Path:
    if log.known is None:
        expected = ", ".join(path.name for path in possible_beside(log.path))
        raise EvaluationError(f"{log.path}: nothing is known about it, expected one of {expected} beside it")
    return log.known

"""Judging what a run left on disk: its trajectory file, or its whole folder, against a file of what is known."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iceg.evaluation.consistency import consistency, pose_nees
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import read_relations, read_relations_csv
from iceg.evaluation.report import consistency_report, relations_report, trajectory_report
from iceg.evaluation.trajectory import (
    check_one_row_per_scan,
    poses_of_scans,
    read_reference_csv,
    read_truth_csv,
    trajectory_errors,
)
from iceg.results import read_covariances, whole_results
from iceg.tum import read_tum


def relations_csv_report(trajectory: Path, relations: Path) -> dict[str, float]:
    """Benchmark errors against relations by scan index.

    Args:
        trajectory: a `trajectory.tum`, or the folder of a run.
        relations: CSV `scan_i,scan_j,x_m,y_m,theta_rad,certain`.

    Raises:
        IcegError: a file is not as expected, or they do not belong together.
    """
    return relations_report(read_poses(trajectory), read_relations_csv(relations))


def relations_by_stamp_report(trajectory: Path, relations: Path, log: Path) -> dict[str, float]:
    """The same against relations in the benchmark's own format, by stamp.

    Args:
        trajectory: a `trajectory.tum`, or the folder of a run.
        relations: lines `stamp_i stamp_j x y z roll pitch yaw`.
        log: the log, to tie stamps to scans.

    Raises:
        IcegError: as `relations_csv_report`.
    """
    from frontends.logs import read_log

    return relations_report(read_poses(trajectory), read_relations(relations, read_log(log).stamps))


def reference_report(trajectory: Path, reference: Path) -> dict[str, float]:
    """Absolute trajectory error against reference poses of some scans.

    Args:
        trajectory: a `trajectory.tum`, or the folder of a run.
        reference: CSV `scan,x_m,y_m,theta_rad`.

    Raises:
        IcegError: as `relations_csv_report`.
    """
    scans, T_world_robot = read_reference_csv(reference)
    if len(scans) < 2:
        raise EvaluationError(f"{reference}: found 1 pose to compare, an alignment needs at least 2")
    estimated = poses_of_scans(read_poses(trajectory), scans, reference)
    return trajectory_report(trajectory_errors(estimated, T_world_robot))


def truth_report(trajectory: Path, truth: Path) -> dict[str, float]:
    """Absolute trajectory error against the true pose of every scan; the NEES too where a run folder is given.

    Args:
        trajectory: a `trajectory.tum`, or the folder of a run.
        truth: CSV `t_s,x_m,y_m,theta_rad`, or the log itself where it holds the truth, as bags may.

    Raises:
        IcegError: as `relations_csv_report`.
    """
    T_world_robot = true_poses(truth)
    with whole_results(trajectory):
        T_map_robot = read_poses(trajectory)
        check_one_row_per_scan(T_map_robot, T_world_robot, truth)
        nees = _nees_report(trajectory, T_world_robot)
    return trajectory_report(trajectory_errors(T_map_robot, T_world_robot)) | nees


def _nees_report(trajectory: Path, T_world_robot: NDArray[np.float64]) -> dict[str, float]:
    """Empty where there are no covariances to judge."""
    covariances_file = trajectory / "covariances.csv"
    if not trajectory.is_dir() or not covariances_file.exists():
        return {}
    scans, key_poses, covariances = read_covariances(covariances_file)
    if len(scans) < 2:
        return {}
    values = pose_nees(key_poses, poses_of_scans(T_world_robot, scans, covariances_file), covariances)
    return consistency_report(consistency(values))


def true_poses(truth: Path) -> NDArray[np.float64]:
    """(n_scans, 3) T_world_robot, from a CSV or a log that holds it.

    Raises:
        IcegError: the file cannot be read, or holds no truth.
    """
    if truth.suffix.lower() == ".csv":
        return read_truth_csv(truth)
    from frontends.logs import read_log

    log = read_log(truth)
    if log.truth is None:
        raise EvaluationError(f"{truth}: the log does not hold the true poses")
    return log.truth


def read_poses(trajectory: Path) -> NDArray[np.float64]:
    """(n_scans, 3) poses of a `trajectory.tum`, given itself or by its folder, whose files have to be of one run."""
    with whole_results(trajectory):
        return read_tum(trajectory / "trajectory.tum" if trajectory.is_dir() else trajectory).poses

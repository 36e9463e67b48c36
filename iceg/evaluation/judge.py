"""Judging what a run left on disk: its trajectory file, or its whole folder, against a file of what is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iceg.evaluation.consistency import consistency, pose_nees
from iceg.evaluation.pairing import By, Pairing, pair
from iceg.evaluation.relations import read_relations, read_relations_csv
from iceg.evaluation.report import consistency_report, relations_report, relative_report, trajectory_report
from iceg.evaluation.trajectory import trajectory_errors
from iceg.evaluation.truth import Truth, read_truth
from iceg.evaluation.verdict import nees_verdict
from iceg.results import read_covariances, whole_results
from iceg.stamps import repaired_stamps, steps_back
from iceg.tum import Trajectory, read_tum


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
    """Figures against reference poses of some scans, as `truth_report`."""
    return judge_trajectory(trajectory, reference).figures


def truth_report(trajectory: Path, truth: Path) -> dict[str, float]:
    """Figures against the truth alone, see `judge_trajectory`."""
    return judge_trajectory(trajectory, truth).figures


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """A trajectory against the truth.

    Attributes:
        figures: by their published names.
        truth: what it was compared with.
        pairing: how the poses were paired.
        warning: what is doubtful about the pairing, empty for nothing.
        verdict: what the NEES says, in words; why there is none in a folder of a run that has none; empty of a file.
    """

    figures: dict[str, float]
    truth: Truth
    pairing: Pairing
    warning: str
    verdict: str


def judge_trajectory(trajectory: Path, truth: Path, by: By | None = None) -> Judgement:
    """Absolute and relative errors against true poses; the NEES too where a run folder is given.

    Args:
        trajectory: a `trajectory.tum`, or the folder of a run.
        truth: true poses in any format of `iceg.evaluation.truth`.
        by: how poses are paired; left out: as `iceg.evaluation.pairing.pair` chooses.

    Raises:
        IcegError: as `relations_csv_report`.
    """
    true = read_truth(truth)
    with whole_results(trajectory):
        estimated = _read_trajectory(trajectory)
        pairing = pair(estimated, true, by)
        nees, verdict = _nees(trajectory, pairing)
    poses = estimated.poses[pairing.scans]
    figures = trajectory_report(trajectory_errors(poses, pairing.T_world_robot))
    if pairing.by == "stamp":
        figures["matched"] = pairing.matched
    figures |= relative_report(poses, pairing.T_world_robot, repaired_stamps(estimated.stamps)[pairing.scans])
    warning = _warning(estimated) if pairing.by == "stamp" else ""
    return Judgement(figures=figures | nees, truth=true, pairing=pairing, warning=warning, verdict=verdict)


def _warning(trajectory: Trajectory) -> str:
    n = steps_back(trajectory.stamps)
    if not n:
        return ""
    return (
        f"{n} of the trajectory's {len(trajectory)} stamps are not later than the one before, so that some poses may "
        "be paired with the truth of another scan: pair by scan, or repair the stamps"
    )


def _nees(trajectory: Path, pairing: Pairing) -> tuple[dict[str, float], str]:
    """Figures of the key poses that have a true pose, and the verdict; empty where there are no covariances."""
    covariances_file = trajectory / "covariances.csv"
    if not trajectory.is_dir() or not covariances_file.exists():
        return {}, ""
    scans, key_poses, covariances = read_covariances(covariances_file)
    order = np.argsort(pairing.scans, kind="stable")
    places = np.searchsorted(pairing.scans[order], scans)
    rows = order[np.minimum(places, len(order) - 1)]
    known = np.flatnonzero(pairing.scans[rows] == scans)
    if not len(known) or known[0] != 0:
        return {}, "no NEES: the first key pose, to which the covariances are relative, has no true pose"
    if len(known) < 2:
        return {}, "no NEES: only one key pose has a true pose"
    values = pose_nees(key_poses[known], pairing.T_world_robot[rows[known]], covariances[known])
    summary = consistency(values)
    return consistency_report(summary), nees_verdict(summary.mean)


def read_poses(trajectory: Path) -> NDArray[np.float64]:
    """(n_scans, 3) poses of a `trajectory.tum`, given itself or by its folder, whose files have to be of one run."""
    with whole_results(trajectory):
        return _read_trajectory(trajectory).poses


def _read_trajectory(trajectory: Path) -> Trajectory:
    return read_tum(trajectory / "trajectory.tum" if trajectory.is_dir() else trajectory)

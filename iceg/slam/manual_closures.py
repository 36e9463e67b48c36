"""Loop closures that a person adds by hand: pairs of scans and how the one lies to the other."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.batch import optimize
from graph.config import PoseGraphConfig
from graph.dense import congruence
from graph.errors import IcegError
from graph.factors import Factor
from graph.pose_graph import PoseGraph
from graph.se2 import adjoint, compose, inverse
from iceg.slam.back_end import Solution
from iceg.slam.closures.closure import Closure
from iceg.slam.track import Track
from iceg.tables import TableError, check_row, open_table, parse_numbers

_COLUMNS = ("scan_i", "scan_j", "x_m", "y_m", "theta_rad")
_SIGMA_COLUMNS = (*_COLUMNS, "sigma_m", "sigma_rad")
_SIGMA_M, _SIGMA_RAD = 0.1, 0.03
"""How well a person is taken to know a closure, unless the file says [m, rad]."""

_LEAST_SIGMA = 1e-6
"""Nobody knows better [m, rad]."""


class ManualClosureError(IcegError):
    """A closure by hand that cannot be one, or does not belong to the log."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ManualClosure:
    """A place seen again, as a person says.

    Attributes:
        scan_i: one scan, counted from 0 in file order.
        scan_j: the other scan.
        T_i_j: (3,) pose of scan j in the frame of scan i: x [m], y [m], heading [rad].
        sigma_m: standard deviation of x and of y [m].
        sigma_rad: standard deviation of the heading [rad].
        where: file and line it is from, for messages.
    """

    scan_i: int
    scan_j: int
    T_i_j: NDArray[np.float64]
    sigma_m: float = _SIGMA_M
    sigma_rad: float = _SIGMA_RAD
    where: str = "a closure by hand"

    def __post_init__(self) -> None:
        if self.scan_i < 0 or self.scan_j < 0 or self.scan_i == self.scan_j:
            raise ManualClosureError(
                f"{self.where}: found scans {self.scan_i} and {self.scan_j}, expected two different ones counted from 0"
            )
        if not (_LEAST_SIGMA <= self.sigma_m < math.inf and _LEAST_SIGMA <= self.sigma_rad < math.inf):
            raise ManualClosureError(
                f"{self.where}: found the deviations {self.sigma_m} m and {self.sigma_rad} rad, expected at least "
                f"{_LEAST_SIGMA:g} each"
            )


def read_manual_closures(path: Path | str) -> list[ManualClosure]:
    """Read closures by hand.

    Args:
        path: a CSV with the header `scan_i,scan_j,x_m,y_m,theta_rad`, followed or not by `,sigma_m,sigma_rad`; pose
            of scan j in the frame of scan i.

    Raises:
        IcegError: path:line, what was found and what was expected.
    """
    path = Path(path)
    closures: list[ManualClosure] = []
    with open_table(path, TableError, "a CSV", "utf-8-sig") as file:
        reader = csv.reader(file)
        columns = _columns([word.strip() for word in next(reader, [])], path)
        for row in filter(None, reader):
            where = f"{path}:{reader.line_num}"
            check_row(len(closures) + 1, where, TableError)
            closures.append(_closure(row, columns, where))
    if not closures:
        raise TableError(f"{path}: holds no rows under its header '{','.join(columns)}'")
    return closures


def check_manual_closures(closures: Sequence[ManualClosure], n_scans: int) -> None:
    """Refuse closures between scans the log does not have, before any work is done.

    Raises:
        ManualClosureError: naming where the closure is from, the scan and the number of scans.
    """
    for closure in closures:
        last = max(closure.scan_i, closure.scan_j)
        if last >= n_scans:
            raise ManualClosureError(f"{closure.where}: found scan {last}, but the log has {n_scans} scans")


def manual_factors(closures: Sequence[ManualClosure], track: Track) -> list[Factor]:
    """Closures of scans as factors between the key poses these scans are tied to.

    T_keyi_keyj = T_keyi_i · T_i_j · T_keyj_j⁻¹, and its covariance is carried along by the adjoint of T_keyj_j.

    Args:
        closures: by hand, all of scans the track has.
        track: key scans, and where every other scan lies in the frame of its key scan.

    Returns:
        One factor each; none for two scans of one key pose, which the graph cannot move against each other.
    """
    return [_factor(closure, track) for closure in closures if _joins_two_keys(closure, track)]


def manual_records(closures: Sequence[ManualClosure], track: Track) -> list[Closure]:
    """What is said about them in the record of closures."""
    return [
        Closure(
            scan_i=closure.scan_i,
            scan_j=closure.scan_j,
            T_i_j=closure.T_i_j,
            score=0.0,
            inliers=0,
            overlap=0.0,
            verdict="accepted" if _joins_two_keys(closure, track) else "rejected",
            reason="by hand" if _joins_two_keys(closure, track) else "by hand; both scans hang on the same key pose",
        )
        for closure in closures
    ]


def add_by_hand(solution: Solution, factors: Sequence[Factor], config: PoseGraphConfig) -> Solution:
    """The graph with these factors more, solved anew."""
    if not factors:
        return solution
    together = [*solution.graph.factors, *factors]
    poses = optimize(together, solution.poses).poses
    return replace(solution, graph=PoseGraph.from_factors(together, poses, config), poses=poses)


def _columns(header: list[str], path: Path) -> tuple[str, ...]:
    for columns in (_COLUMNS, _SIGMA_COLUMNS):
        if header == list(columns):
            return columns
    raise TableError(
        f"{path}:1: found the header '{','.join(header)[:80]}', expected '{','.join(_COLUMNS)}[,sigma_m,sigma_rad]'"
    )


def _closure(row: list[str], columns: Sequence[str], where: str) -> ManualClosure:
    numbers = parse_numbers(row, columns, where)
    if not (numbers[0].is_integer() and numbers[1].is_integer()):
        raise ManualClosureError(f"{where}: found scans {row[0]} and {row[1]}, expected whole numbers counted from 0")
    sigma_m, sigma_rad = numbers[5:] or (_SIGMA_M, _SIGMA_RAD)
    return ManualClosure(
        scan_i=int(numbers[0]),
        scan_j=int(numbers[1]),
        T_i_j=np.array(numbers[2:5]),
        sigma_m=sigma_m,
        sigma_rad=sigma_rad,
        where=where,
    )


def _joins_two_keys(closure: ManualClosure, track: Track) -> bool:
    return bool(track.key_of_scan[closure.scan_i] != track.key_of_scan[closure.scan_j])


def _factor(closure: ManualClosure, track: Track) -> Factor:
    T_keyi_i, T_keyj_j = track.T_key_scan[closure.scan_i], track.T_key_scan[closure.scan_j]
    carry = adjoint(T_keyj_j)
    sigmas = np.array([closure.sigma_m, closure.sigma_m, closure.sigma_rad])
    return Factor(
        kind="closure",
        i=int(track.key_of_scan[closure.scan_i]),
        j=int(track.key_of_scan[closure.scan_j]),
        T_i_j=compose(compose(T_keyi_i, closure.T_i_j), inverse(T_keyj_j)),
        covariance=congruence(carry, np.diag(sigmas**2)),
    )

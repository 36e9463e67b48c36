"""Loop closures that a person adds by hand: pairs of scans and how the one lies to the other."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.radians import not_in_radians
from graph.errors import IcegError
from iceg.tables import TableError, check_row, open_table, parse_numbers

_COLUMNS = ("scan_i", "scan_j", "x_m", "y_m", "theta_rad")
_SIGMA_COLUMNS = (*_COLUMNS, "sigma_m", "sigma_rad")
SIGMA_M, SIGMA_RAD = 0.1, 0.03
"""How well a person is taken to know a closure, unless the file says [m, rad]."""

_LEAST_SIGMA, _MOST_SIGMA_M, _MOST_SIGMA_RAD = 1e-6, 1e4, 10.0
"""Nobody knows better [m, rad]; and who knows no better [m], [rad] knows nothing."""


class ManualClosureError(IcegError):
    """A closure by hand that cannot be one, or does not belong to the log."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ManualClosure:
    """A place seen again, as a person says.

    Attributes:
        scan_i: one scan, counted from 0 in file order.
        scan_j: the other scan.
        T_i_j: (3,) pose of scan j in the frame of scan i: x [m], y [m], heading [rad]; None to have it matched.
        sigma_m: standard deviation of x and of y [m]; a match knows its own.
        sigma_rad: standard deviation of the heading [rad].
        pinned: whether it is believed whatever the others say; else it has a robust kernel, as they have.
        where: file and line it is from, for messages.
    """

    scan_i: int
    scan_j: int
    T_i_j: NDArray[np.float64] | None
    sigma_m: float = SIGMA_M
    sigma_rad: float = SIGMA_RAD
    pinned: bool = False
    where: str = "a closure by hand"

    def __post_init__(self) -> None:
        if self.scan_i < 0 or self.scan_j < 0 or self.scan_i == self.scan_j:
            raise ManualClosureError(
                f"{self.where}: found scans {self.scan_i} and {self.scan_j}, expected two different ones counted from 0"
            )
        check_deviations(self.sigma_m, self.sigma_rad, self.where, self.where)
        misread = None if self.T_i_j is None else not_in_radians(float(self.T_i_j[2]))
        if misread:
            raise ManualClosureError(f"{self.where}: {misread}")


def check_deviations(sigma_m: float, sigma_rad: float, where_m: str, where_rad: str) -> None:
    """Make sure that the standard deviations of a closure are ones that somebody may know it to.

    Args:
        sigma_m: of x and y [m].
        sigma_rad: of the heading [rad].
        where_m: where the first is from, for messages.
        where_rad: where the second is from.

    Raises:
        ManualClosureError: one of them is too small or too large.
    """
    for name, sigma, most, where in (
        ("sigma_m", sigma_m, _MOST_SIGMA_M, where_m),
        ("sigma_rad", sigma_rad, _MOST_SIGMA_RAD, where_rad),
    ):
        if not _LEAST_SIGMA <= sigma <= most:
            raise ManualClosureError(f"{where}: {name}: found {sigma:g}, expected {_LEAST_SIGMA:g} to {most:g}")


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
    sigma_m, sigma_rad = numbers[5:] or (SIGMA_M, SIGMA_RAD)
    return ManualClosure(
        scan_i=int(numbers[0]),
        scan_j=int(numbers[1]),
        T_i_j=np.array(numbers[2:5]),
        sigma_m=sigma_m,
        sigma_rad=sigma_rad,
        where=where,
    )

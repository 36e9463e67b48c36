"""Files of true poses: a CSV by scan or by stamp, TUM, EuRoC, plain columns, or a log that holds its truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph.errors import reason
from graph.files import check_file
from graph.limits import LIMITS
from iceg.euroc import is_euroc_header, read_euroc
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.trajectory import (
    REFERENCE_COLUMNS,
    TRUTH_COLUMNS,
    check_scan_numbers,
    read_reference_csv,
    read_stamped_csv,
)
from iceg.tables import read_blank_separated_table, read_csv_table
from iceg.tum import read_tum

_SNIFFED = 65536  # bytes that tell the format
_TUM_COLUMNS = 8  # as many as the benchmark's relations by stamp have


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """n true poses as a file gives them.

    Attributes:
        poses: (n, 3) T_world_robot in a frame of their own.
        stamps: (n,) [s]; None where the file names scans instead.
        scans: (n,) scan of each pose, counted from 0 in file order; None where the file does not say.
        form: the format, for a person.
        path: the file.
    """

    poses: NDArray[np.float64]
    stamps: NDArray[np.float64] | None
    scans: NDArray[np.int64] | None
    form: str
    path: Path

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.poses)


def read_truth(path: Path | str) -> Truth:
    """Read true poses in whatever format they are.

    Args:
        path: a CSV with the header `t_s,x_m,y_m,theta_rad`, `scan,x_m,y_m,theta_rad` or both in one; a EuRoC CSV; TUM
            lines `t x y z qx qy qz qw`; lines `t x y theta` separated by blanks; or a log that holds its truth, as bags
            may.

    Raises:
        IcegError: it cannot be read or is in none of these formats.
    """
    path = Path(path)
    if path.is_dir():
        return _of_log(path)
    line = _first_line(path)
    words = line.split()
    _refuse_relations(line, words, path)
    if line.startswith("scan,t_s,"):
        table = read_csv_table(path, ("scan", *TRUTH_COLUMNS))
        check_scan_numbers(table[:, 0], path)
        scans = table[:, 0].astype(np.int64)
        return Truth(poses=table[:, 2:], stamps=table[:, 1], scans=scans, form="CSV by scan and stamp", path=path)
    if line.startswith("scan,"):
        scans, poses = read_reference_csv(path)
        return Truth(poses=poses, stamps=None, scans=scans, form="CSV by scan", path=path)
    if is_euroc_header(line):
        trajectory = read_euroc(path)
        return Truth(poses=trajectory.poses, stamps=trajectory.stamps, scans=None, form="EuRoC", path=path)
    if line.startswith("t_s,"):
        stamps, poses = read_stamped_csv(path)
        return Truth(poses=poses, stamps=stamps, scans=None, form="CSV", path=path)
    if _are_numbers(words) and len(words) == len(TRUTH_COLUMNS):
        table = read_blank_separated_table(path, TRUTH_COLUMNS)
        return Truth(poses=table[:, 1:], stamps=table[:, 0], scans=None, form="columns t x y theta", path=path)
    if _are_numbers(words) or not words:
        trajectory = read_tum(path)
        return Truth(poses=trajectory.poses, stamps=trajectory.stamps, scans=None, form="TUM", path=path)
    if path.suffix.lower() == ".csv":
        raise EvaluationError(
            f"{path}:1: found '{line[:80]}', expected the header '{','.join(TRUTH_COLUMNS)}', "
            f"'{','.join(REFERENCE_COLUMNS)}' or EuRoC's '#timestamp [ns],…'"
        )
    return _of_log(path)


def _of_log(path: Path) -> Truth:
    from frontends.logs import LogError, read_log
    from frontends.logs.readers import recognise

    try:
        form = recognise(path)
    except LogError as err:
        raise EvaluationError(
            f"{path}: found no true poses, expected a CSV with '{','.join(TRUTH_COLUMNS)}' or "
            f"'{','.join(REFERENCE_COLUMNS)}', a EuRoC CSV, TUM lines, lines 't x y theta' or a log that holds truth"
        ) from err
    log = read_log(path, log_format=form)
    if log.truth is None:
        raise EvaluationError(f"{path}: the log does not hold the true poses")
    return Truth(poses=log.truth, stamps=log.stamps, scans=None, form="log", path=path)


def _first_line(path: Path) -> str:
    """The first line that is neither empty nor a remark; a header that begins as a remark counts."""
    check_file(path, "log_bytes", EvaluationError, "true poses")
    try:
        with path.open("rb") as file:
            head = file.read(_SNIFFED)
    except OSError as err:
        raise EvaluationError(f"{path}: cannot be read as true poses: {reason(err)}") from err
    lines = (line.strip() for line in head.decode("utf-8-sig", errors="replace").splitlines())
    return next((line for line in lines if line and (not line.startswith("#") or is_euroc_header(line))), "")


def _refuse_relations(line: str, words: list[str], path: Path) -> None:
    """Say so where a file begins like relations: a CSV by scan, or eight numbers of which two are times of day."""
    is_by_scan = line.startswith("scan_i,")
    is_by_stamp = len(words) == _TUM_COLUMNS and _are_numbers(words) and abs(float(words[1])) > LIMITS.coordinate
    if is_by_scan or is_by_stamp:
        raise EvaluationError(
            f"{path}: found relative poses between scans ('{line[:40]}…'), expected true poses: "
            "give these as --relations"
        )


def _are_numbers(words: list[str]) -> bool:
    try:
        return bool([float(word) for word in words])
    except ValueError:
        return False

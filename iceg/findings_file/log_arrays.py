"""A log as arrays: ranges in the smallest type that holds each exactly."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log, ScanGeometry
from graph.limits import check_limit
from iceg.findings_file.table import Table

_STEPS = (1.0, 10.0, 100.0, 1000.0, 10_000.0)
"""Ranges are often whole numbers of a unit, which is a metre over one of these."""
_NO_RETURN = 65535
_BAND = 256
"""Scans looked at together."""


def log_arrays(log: Log) -> dict[str, NDArray[Any]]:
    """The arrays of a log."""
    arrays: dict[str, NDArray[Any]] = {
        **_range_arrays(log.ranges),
        "log_odometry": log.odometry,
        "log_stamps": log.stamps,
        "log_bearings": log.geometry.bearings,
        "log_mount": log.geometry.T_robot_laser,
    }
    by_scan = {"log_truth": log.truth, "log_gyro": log.gyro}
    return arrays | {name: array for name, array in by_scan.items() if array is not None}


def log_facts(log: Log) -> dict[str, Any]:
    """What there is to say of a log besides arrays, for JSON; of its path, no more than the name."""
    return {
        "name": log.path.name,
        "range_min": log.geometry.range_min,
        "range_max": log.geometry.range_max,
        "has_odometry": log.has_odometry,
        "is_mount_known": log.is_mount_known,
        "warnings": list(log.warnings),
        "skipped_lines": log.skipped_lines,
        "message_counts": dict(log.message_counts),
        "sweep": log.sweep,
        "choices": dict(log.choices),
    }


def log_of(table: Table, facts: Mapping[str, Any]) -> Log:
    """The log again.

    Raises:
        IcegError: the arrays or facts make no log.
    """
    bearings = table.floats("log_bearings", -1)
    ranges = _ranges(table, len(bearings))
    n_scans = len(ranges)
    check_limit(n_scans, "scans", f"{table.path}: found {n_scans} scans")
    check_limit(ranges.size, "readings", f"{table.path}: found {ranges.size} readings")
    return Log(
        ranges=ranges,
        odometry=table.floats("log_odometry", n_scans, 3),
        stamps=table.floats("log_stamps", n_scans),
        geometry=ScanGeometry(
            bearings=bearings,
            range_min=float(facts["range_min"]),
            range_max=float(facts["range_max"]),
            T_robot_laser=table.floats("log_mount", 3),
        ),
        path=Path(Path(str(facts["name"])).name or "log"),
        has_odometry=facts["has_odometry"] is True,
        is_mount_known=facts["is_mount_known"] is True,
        warnings=tuple(map(str, facts["warnings"])),
        skipped_lines=int(facts["skipped_lines"]),
        message_counts={str(name): int(count) for name, count in facts["message_counts"].items()},
        truth=table.floats("log_truth", n_scans, 3) if table.has("log_truth") else None,
        gyro=table.floats("log_gyro", n_scans, 3) if table.has("log_gyro") else None,
        sweep=None if facts["sweep"] is None else float(facts["sweep"]),
        choices={str(name): str(choice) for name, choice in facts["choices"].items()},
    )


def _range_arrays(ranges: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """Whole numbers of a unit, where every range is one, else the ranges themselves."""
    for per_metre in _STEPS:
        whole = _whole(ranges, per_metre)
        if whole is not None:
            return {"log_ranges": whole, "log_ranges_per_metre": np.array([per_metre])}
    return {"log_ranges": ranges}


def _whole(ranges: NDArray[np.float32], per_metre: float) -> NDArray[np.uint16] | None:
    """The ranges as whole numbers, so many a metre; None where one is none, told by the first scans most often."""
    whole = np.full(ranges.shape, _NO_RETURN, dtype=np.uint16)
    for first in range(0, len(ranges), _BAND):
        band = ranges[first : first + _BAND]
        hit = np.isfinite(band)
        found = band[hit]
        counts = np.rint(found.astype(np.float64) * per_metre)
        if counts.max(initial=0.0) >= _NO_RETURN or counts.min(initial=0.0) < 0.0:
            return None
        if not np.array_equal((counts / per_metre).astype(np.float32), found):
            return None
        whole[first : first + _BAND][hit] = counts.astype(np.uint16)
    return whole


def _ranges(table: Table, n_beams: int) -> NDArray[np.float32]:
    stored = table.any_numbers("log_ranges", -1, n_beams)
    if not table.has("log_ranges_per_metre"):
        if stored.dtype != np.float32:
            raise table.error(f"'log_ranges' is of type {stored.dtype}, expected float32")
        return stored
    if stored.dtype != np.uint16:
        raise table.error(f"'log_ranges' is of type {stored.dtype}, expected uint16")
    per_metre = float(table.floats("log_ranges_per_metre", 1)[0])
    if per_metre not in _STEPS:
        raise table.error(f"'log_ranges_per_metre' is {per_metre:g}, expected one of {_STEPS}")
    ranges = (stored / per_metre).astype(np.float32)
    ranges[stored == _NO_RETURN] = np.nan
    return ranges

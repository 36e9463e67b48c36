"""What `iceg info` counts and measures in a log."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import describe_log
from frontends.scan import Log, ScanGeometry


def log_of(
    ranges: NDArray[np.float32],
    odometry: NDArray[np.float64],
    stamps: NDArray[np.float64],
    *,
    warnings: tuple[str, ...] = (),
    has_odometry: bool = True,
) -> Log:
    bearings = np.radians(np.arange(-90.0, 91.0))
    return Log(
        ranges=ranges,
        odometry=odometry,
        stamps=stamps,
        geometry=ScanGeometry(bearings=bearings, range_min=0.02, range_max=20.0, T_robot_laser=np.zeros(3)),
        path=Path("robot.clf"),
        has_odometry=has_odometry,
        warnings=warnings,
        message_counts={"FLASER": len(ranges)},
    )


def test_counts_and_measures() -> None:
    ranges = np.random.default_rng(0).uniform(1.0, 9.0, (6, 181)).astype(np.float32)
    ranges[:5, -2:] = np.nan
    ranges[5] = np.nan
    k = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 4.0])
    odometry = np.stack([0.5 * k, 0.0 * k, 0.1 * k], axis=1)
    stamps = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 3.5])
    info = describe_log(log_of(ranges, odometry, stamps, warnings=("the stamps step back",)))
    assert (info.scans, info.beams, info.empty_scans) == (6, 181, 1)
    assert info.path_length == pytest.approx(2.0)
    assert info.turned_angle == pytest.approx(0.4)
    assert info.duration == pytest.approx(4.0)
    assert info.stamps_stepping_back == 1
    assert info.no_return_share == pytest.approx((5 * 2 + 181) / (6 * 181))
    assert info.range_quartiles[2] == pytest.approx(np.nanmedian(ranges))
    text = str(info)
    for part in ("6 in 4.0 s", "181 over 180°, 1° apart", "2.0 m, 23° turned", "6 FLASER", "warning   the stamps step"):
        assert part in text


def test_a_log_without_returns_or_odometry() -> None:
    nothing = np.full((2, 181), np.nan, dtype=np.float32)
    info = describe_log(log_of(nothing, np.zeros((2, 3)), np.array([0.0, 1.0]), has_odometry=False))
    assert not info.has_odometry
    assert math.isnan(info.range_quartiles[2])
    assert "none that says anything" in str(info)

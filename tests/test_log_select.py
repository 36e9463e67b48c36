"""Logs of some of the scans."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from frontends.scan import Log, ScanGeometry

GEOMETRY = ScanGeometry(bearings=np.linspace(-1.0, 1.0, 3), range_min=0.1, range_max=20.0)


def log_of(n: int, *, truth: bool) -> Log:
    rows = np.arange(n, dtype=np.float64)
    return Log(
        ranges=np.tile(rows[:, None], 3).astype(np.float32),
        odometry=np.tile(rows[:, None], 3),
        stamps=10.0 + rows,
        geometry=GEOMETRY,
        path=Path("some.clf"),
        warnings=("a warning",),
        truth=100.0 + np.tile(rows[:, None], 3) if truth else None,
    )


@pytest.mark.parametrize(
    ("scans", "left"),
    [
        (slice(3), [0, 1, 2]),
        (slice(1, None, 2), [1, 3]),
        (slice(None), [0, 1, 2, 3, 4]),
        (slice(0), []),
        (np.array([4, 0, 0]), [4, 0, 0]),
    ],
)
def test_every_array_of_a_log_follows(scans: slice | NDArray[np.int64], left: list[int]) -> None:
    whole = log_of(5, truth=True)
    some = whole.select(scans)
    assert len(some) == len(left)
    assert_array_equal(some.ranges[:, 1], left)
    assert_array_equal(some.odometry[:, 2], left)
    assert_array_equal(some.stamps, 10.0 + np.array(left))
    assert some.truth is not None
    assert_array_equal(some.truth[:, 0], 100.0 + np.array(left))
    assert (some.geometry, some.path, some.warnings) == (whole.geometry, whole.path, whole.warnings)


def test_a_log_without_truth_stays_without() -> None:
    assert log_of(3, truth=False).select(slice(1)).truth is None

"""Scans between key scans, smoothed: against the normal equations, and against a truth that is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.slam.recording.steps import chained
from iceg.slam.track import KeyScan, Track
from iceg.slam.tracking import _smoothing_kernels as kernels
from iceg.slam.tracking.between_keys import smoothed_between_keys
from iceg.slam.tracking_config import SmoothingConfig

_EVERY = 8
_SCAN = Scan(
    ranges=np.ones(3, np.float32), geometry=ScanGeometry(bearings=np.linspace(-1, 1, 3), range_min=0.1, range_max=9.0)
)
Floats = NDArray[np.float64]


def _dense(values: Floats, steps: Floats, end: float, measured: float, moved: float) -> Floats:
    """The same by least squares; `steps` has one more than `values` where there is an end."""
    n = len(values) - 1
    rows, right = [], []
    for i in range(1, n + 1):
        rows.append(np.eye(n)[i - 1] / np.sqrt(measured))
        right.append(values[i] / np.sqrt(measured))
        before = np.eye(n)[i - 2] if i > 1 else np.zeros(n)
        rows.append((np.eye(n)[i - 1] - before) / np.sqrt(moved))
        right.append((steps[i] + (values[0] if i == 1 else 0.0)) / np.sqrt(moved))
    if not np.isnan(end):
        rows.append(-np.eye(n)[n - 1] / np.sqrt(moved))
        right.append((steps[n + 1] - end) / np.sqrt(moved))
    found: Floats = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    return found


@given(seed=st.integers(0, 10_000), n=st.integers(1, 9), has_end=st.booleans(), measured=st.floats(1e-6, 1.0))
def test_a_part_is_solved_as_by_least_squares(seed: int, n: int, has_end: bool, measured: float) -> None:
    rng = np.random.default_rng(seed)
    values, steps, end, moved = rng.normal(size=n + 1), rng.normal(size=n + 2), float(rng.normal()), 0.01
    ends = np.array([end if has_end else np.nan, np.nan])
    smoothed = np.append(values, 7.0)
    kernels.smooth(
        np.append(values, 0.0), steps, np.array([0, n + 1, n + 2]), ends, np.zeros(2, bool), measured, moved, smoothed
    )
    assert_allclose(smoothed[1 : n + 1], _dense(values, steps, ends[0], measured, moved), atol=1e-8)
    assert smoothed[0] == values[0]
    assert smoothed[-1] == 7.0


def _track(truth: Floats, noise: Floats) -> Track:
    """Every so many scans a key scan that is right, and those between with errors, in the robot's axes."""
    firsts = np.arange(0, len(truth), _EVERY)
    motion = OdometryModel().start()
    keys = [
        KeyScan(
            index=int(first), scan=_SCAN, motion=motion, match=NoMatch(reason=""), anchor=0, T_track_robot=truth[first]
        )
        for first in firsts
    ]
    key_of_scan = np.repeat(np.arange(len(firsts)), _EVERY)[: len(truth)]
    seen = compose(truth, noise)
    seen[firsts] = truth[firsts]
    return Track(
        keys=keys,
        key_of_scan=key_of_scan,
        T_key_scan=between(truth[firsts][key_of_scan], seen),
        failures=0,
        lost=[],
    )


def _drive(n: int, seed: int, std: float, odometry_std: float) -> tuple[Track, Floats, Floats]:
    """A drive as it was tracked, its odometry, and the truth."""
    rng = np.random.default_rng(seed)
    moves = np.column_stack([rng.uniform(0.02, 0.1, n - 1), np.zeros(n - 1), rng.normal(0.0, 0.05, n - 1)])
    truth = chained(np.zeros(3), moves)
    odometry = chained(np.zeros(3), moves + rng.normal(0.0, odometry_std, moves.shape))
    return _track(truth, rng.normal(0.0, std, (n, 3))), odometry, truth


def _error(track: Track, truth: Floats) -> float:
    return float(np.sqrt(np.mean((track.trajectory(truth[track.key_scans]) - truth)[:, :2] ** 2)))


@pytest.mark.parametrize(("odometry_std", "share"), [(0.0005, 0.4), (0.002, 0.75), (0.05, 1.0)])
def test_scans_are_known_better_the_better_odometry_is(odometry_std: float, share: float) -> None:
    track, odometry, truth = _drive(2000, 1, 0.002, odometry_std)
    smoothed = smoothed_between_keys(track, odometry, SmoothingConfig())
    assert _error(smoothed, truth) <= share * _error(track, truth)
    assert_array_equal(smoothed.T_key_scan[track.key_scans], track.T_key_scan[track.key_scans])


def test_matches_without_errors_of_their_own_stay_as_they_are() -> None:
    rng = np.random.default_rng(4)
    track, _, truth = _drive(500, 4, 0.0, 0.0)
    steps = between(truth[:-1], truth[1:])
    drifting = chained(np.zeros(3), steps + 0.003 + rng.normal(0.0, 1e-5, steps.shape))
    assert_array_equal(smoothed_between_keys(track, drifting, SmoothingConfig()).T_key_scan, track.T_key_scan)


@pytest.mark.parametrize("is_told", [True, False], ids=["odometry breaks", "it slips"])
def test_where_odometry_slips_or_breaks_scans_stay_where_they_matched(is_told: bool) -> None:
    track, odometry, truth = _drive(2000, 2, 0.002, 0.0005)
    slip = np.array([0.005 if is_told else 0.3, 0.0, 0.0])
    odometry[1003:] = compose(compose(odometry[1003], slip), between(odometry[1003], odometry[1003:]))
    told = replace(track, breaks=[1003] if is_told else [])
    part = slice(1000, 1008)
    assert_array_equal(
        smoothed_between_keys(told, odometry, SmoothingConfig()).T_key_scan[part], track.T_key_scan[part]
    )
    assert _error(smoothed_between_keys(told, odometry, SmoothingConfig()), truth) < 0.5 * _error(track, truth)

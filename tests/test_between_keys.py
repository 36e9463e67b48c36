"""Scans between key scans, smoothed: against the normal equations, and against a truth that is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
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


def _dense(values: Floats, steps: Floats, end: float, measured: Floats, moved: float) -> Floats:
    """The same by least squares; `steps` has one more than `values` where there is an end."""
    n = len(values) - 1
    rows, right = [], []
    for i in range(1, n + 1):
        rows.append(np.eye(n)[i - 1] / np.sqrt(measured[i]))
        right.append(values[i] / np.sqrt(measured[i]))
        before = np.eye(n)[i - 2] if i > 1 else np.zeros(n)
        rows.append((np.eye(n)[i - 1] - before) / np.sqrt(moved))
        right.append((steps[i] + (values[0] if i == 1 else 0.0)) / np.sqrt(moved))
    if not np.isnan(end):
        rows.append(-np.eye(n)[n - 1] / np.sqrt(moved))
        right.append((steps[n + 1] - end) / np.sqrt(moved))
    found: Floats = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    return found


@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 9),
    has_end=st.booleans(),
    measured=st.floats(1e-6, 1.0),
)
def test_without_outliers_a_part_is_solved_as_by_least_squares(
    seed: int, n: int, has_end: bool, measured: float
) -> None:
    rng = np.random.default_rng(seed)
    values, steps, moved = rng.normal(size=(n + 2, 3)), rng.normal(size=(n + 3, 3)), np.array([0.01, 0.02, 0.01])
    ends = np.full((2, 3), np.nan)
    if has_end:
        ends[0] = rng.normal(size=3)
    smoothed, errors = np.full((n + 2, 3), 7.0), measured * rng.uniform(0.5, 2.0, (n + 2, 3))
    starts = np.array([0, n + 1, n + 2])
    kernels.smooth(values, steps, starts, ends, np.zeros(2, bool), errors, moved, 1e15, 3, smoothed)
    for axis in range(3):
        expected = _dense(values[: n + 1, axis], steps[:, axis], ends[0, axis], errors[: n + 1, axis], moved[axis])
        assert_allclose(smoothed[1 : n + 1, axis], expected, atol=1e-8)
    assert_array_equal(smoothed[0], values[0])
    assert (smoothed[-1] == 7.0).all()


def _density(found: Floats, values: Floats, steps: Floats, end: Floats, freedom: float) -> float:
    """Minus its logarithm, of Student's t in three axes of unit variances, but for constants."""
    squares = ((found - values)[1:] ** 2).sum(axis=1)
    moves = np.diff(np.vstack([found, end]), axis=0) - steps[1:]
    both = np.concatenate([squares, (moves**2).sum(axis=1)])
    return float(0.5 * (freedom + 3.0) * np.log1p(both / freedom).sum())


@given(seed=st.integers(0, 10_000), n=st.integers(2, 8), n_outliers=st.integers(0, 4))
def test_a_part_with_outliers_is_at_an_optimum_no_worse_than_those_next_to_values_and_steps(
    seed: int, n: int, n_outliers: int
) -> None:
    rng, freedom = np.random.default_rng(seed), 3.0
    truth = np.cumsum(rng.normal(size=(n + 2, 3)), axis=0)
    values, steps = truth[:-1] + rng.normal(size=(n + 1, 3)), np.zeros((n + 2, 3))
    values[0], steps[1:] = truth[0], np.diff(truth, axis=0) + rng.normal(size=(n + 1, 3))
    for _ in range(n_outliers):
        (values if rng.random() < 0.5 else steps)[rng.integers(1, n + 1)] += rng.normal(0.0, 30.0, 3)
    smoothed, ones = values.copy(), np.ones((n + 1, 3))
    starts = np.array([0, n + 1])
    kernels.smooth(values, steps, starts, truth[-1:], np.zeros(1, bool), ones, ones[0], freedom, 500, smoothed)
    found = _density(smoothed, values, steps, truth[-1], freedom)
    assert found <= _density(values, values, steps, truth[-1], freedom) + 1e-9
    led = values[0] + np.cumsum(np.vstack([np.zeros((1, 3)), steps[1 : n + 1]]), axis=0)
    led += (truth[-1] - led[-1] - steps[n + 1]) * np.arange(n + 1)[:, None] / (n + 1)
    assert found <= _density(led, values, steps, truth[-1], freedom) + 1e-9
    for _ in range(20):
        near = smoothed.copy()
        near[1:] += rng.normal(0.0, 1e-3, (n, 3))
        assert found <= _density(near, values, steps, truth[-1], freedom) + 1e-5


def _track(truth: Floats, noise: Floats, claimed: float) -> Track:
    """Every so many scans a key scan that is right, and those between with errors, in the robot's axes.

    Matches claim a standard deviation to be their own.
    """
    firsts = np.arange(0, len(truth), _EVERY)
    motion = OdometryModel().start()
    match = RelativePose(
        T_ref_cur=np.zeros(3),
        covariance=2.0 * claimed**2 * np.eye(3),
        score=1.0,
        inliers=9,
        overlap=1.0,
        weak_directions=np.empty((0, 3)),
    )
    keys = [
        KeyScan(index=int(first), scan=_SCAN, motion=motion, match=match, anchor=0, T_track_robot=truth[first])
        for first in firsts
    ]
    keys[0] = replace(keys[0], match=NoMatch(reason="first scan"))
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
    return _track(truth, rng.normal(0.0, std, (n, 3)), max(std, 1e-5)), odometry, truth


def _error(track: Track, truth: Floats) -> float:
    return float(np.sqrt(np.mean((track.trajectory(truth[track.key_scans]) - truth)[:, :2] ** 2)))


@pytest.mark.parametrize(("odometry_std", "share"), [(0.0005, 0.4), (0.002, 0.75), (0.05, 1.02)])
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
    smoothed = smoothed_between_keys(track, drifting, SmoothingConfig())
    assert_allclose(smoothed.T_key_scan, track.T_key_scan, atol=1e-4)


@pytest.mark.parametrize("slip", [0.05, 0.3])
def test_where_odometry_slips_scans_stay_about_where_they_matched(slip: float) -> None:
    track, odometry, truth = _drive(2000, 2, 0.002, 0.0005)
    odometry[1003:] = compose(
        compose(odometry[1003], np.array([slip, 0.0, 0.0])), between(odometry[1003], odometry[1003:])
    )
    smoothed = smoothed_between_keys(track, odometry, SmoothingConfig())
    T_keys, part = truth[track.key_scans], slice(1000, 1008)
    assert np.hypot(*(smoothed.trajectory(T_keys) - truth)[part, :2].T).max() < 0.006
    assert _error(smoothed, truth) < 0.5 * _error(track, truth)


@pytest.mark.parametrize("n_astray", [1, 7])
def test_where_matches_go_astray_scans_go_as_odometry_says(n_astray: int) -> None:
    track, odometry, truth = _drive(2000, 3, 0.002, 0.0005)
    astray = track.T_key_scan.copy()
    astray[1001 : 1001 + n_astray, 0] -= np.array([0.05, 0.1, 0.18, 0.04, 0.1, 0.13, 0.07])[:n_astray]
    smoothed = smoothed_between_keys(replace(track, T_key_scan=astray), odometry, SmoothingConfig())
    off = np.hypot(*(smoothed.trajectory(truth[track.key_scans]) - truth)[1001 : 1001 + n_astray, :2].T)
    assert off.max() < 0.004


def test_along_what_matches_do_not_observe_scans_go_as_odometry_says() -> None:
    track, odometry, truth = _drive(2000, 5, 0.002, 0.0005)
    astray, keys = track.T_key_scan.copy(), list(track.keys)
    astray[1001:1008, 0] -= np.linspace(0.04, 0.15, 7)  # as one who walks along would have it
    for key in (125, 126):
        match = keys[key].match
        assert isinstance(match, RelativePose)
        keys[key] = replace(keys[key], match=replace(match, covariance=np.diag([1.0, 1e-5, 1e-5])))
    smoothed = smoothed_between_keys(replace(track, T_key_scan=astray, keys=keys), odometry, SmoothingConfig())
    off = np.hypot(*(smoothed.trajectory(truth[track.key_scans]) - truth)[1001:1008, :2].T)
    assert off.max() < 0.004


def test_a_scan_next_to_a_key_scan_that_observes_stays_where_it_matched_though_the_next_one_slides() -> None:
    track, odometry, truth = _drive(2000, 5, 0.002, 0.02)
    odometry[1001, 2] += 0.1
    keys = list(track.keys)
    match = keys[126].match
    assert isinstance(match, RelativePose)
    keys[126] = replace(keys[126], match=replace(match, covariance=np.eye(3)))
    smoothed = smoothed_between_keys(replace(track, keys=keys), odometry, SmoothingConfig())
    assert abs(smoothed.trajectory(truth[track.key_scans])[1001, 2] - truth[1001, 2]) < 0.01

"""The noise of odometry is found beside that of the matches, which cancels from step to step."""

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.odometry import OdometryModel
from graph.se2 import between, compose, expmap, logmap
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.noise import (
    Differences,
    _best_of_all_sets,
    _non_negative_fit,
    _Paths,
    lasting_noise,
    odometry_noise,
)

Array = NDArray[np.float64]
_EVERY = 4
_TRUE = OdometryModel(
    along_per_metre=0.03,
    across_per_metre=0.015,
    position_per_radian=0.01,
    heading_per_metre=0.01,
    heading_per_radian=0.05,
    along_floor=1e-6,
    across_floor=1e-6,
    heading_floor=1e-6,
)


def _drive(n: int, seed: int) -> Array:
    """(n, 3) steps between scans: straight ways and turns on them."""
    rng = np.random.default_rng(seed)
    turning = np.repeat(rng.random(n // 20 + 1) < 0.3, 20)[:n]
    return np.column_stack([np.where(turning, 0.01, 0.1), np.zeros(n), np.where(turning, rng.uniform(0.05, 0.2), 0.0)])


def _chained(steps: Array) -> Array:
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _observed(n: int, noise: OdometryModel, match: float, seed: int) -> tuple[Differences, Array, Array]:
    """Matches minus odometry every few scans; the odometry; the true motions."""
    rng = np.random.default_rng(seed)
    steps = _drive(n, seed)
    roots = np.linalg.cholesky(noise.covariance(steps[:, None]))
    noisy = compose(steps, expmap((roots @ rng.normal(size=(n, 3, 1)))[..., 0]))
    odometry, truth = _chained(noisy), _chained(steps)
    indices = np.arange(0, n + 1, _EVERY)
    seen = compose(truth[indices], expmap(match * np.array([1.0, 1.0, 0.4]) * rng.normal(size=(len(indices), 3))))
    matched, motions = between(seen[:-1], seen[1:]), between(odometry[indices[:-1]], odometry[indices[1:]])
    claimed = np.tile(2.0 * (match * np.array([1.0, 1.0, 0.4])) ** 2, (len(matched), 1))
    differences = Differences(
        errors=logmap(between(motions, matched)),
        claimed=claimed,
        turns=matched[:, 2],
        starts=indices[:-1],
        ends=indices[1:],
    )
    return differences, odometry, between(truth[indices[:-1]], truth[indices[1:]])


def _nees(noise: OdometryModel, odometry: Array, truth: Array) -> Array:
    """(3,) mean squared errors over variances: x and y with the heading known, and the heading."""
    steps = between(odometry[:-1], odometry[1:])
    covariances = noise.covariance(steps.reshape(-1, _EVERY, 3))
    errors = logmap(between(between(odometry[:-1:_EVERY], odometry[_EVERY::_EVERY]), truth))
    lever = covariances[:, :2, 2] / covariances[:, 2, 2, None]
    own = errors[:, :2] - lever * errors[:, 2:]
    variances = covariances[:, (0, 1), (0, 1)] - lever**2 * covariances[:, 2, 2, None]
    return np.append((own**2 / variances).mean(axis=0), (errors[:, 2] ** 2 / covariances[:, 2, 2]).mean())


@pytest.mark.parametrize("match", [0.0005, 0.004])
def test_each_axis_gets_the_variance_it_has(match: float) -> None:
    differences, odometry, truth = _observed(8000, _TRUE, match, seed=1)
    noise, persistence = odometry_noise(differences, differences, odometry, CalibrationConfig())
    np.testing.assert_allclose(_nees(noise, odometry, truth), 1.0, atol=0.15)
    np.testing.assert_array_equal(persistence, 1.0)


def test_what_the_match_errs_by_is_not_odometrys() -> None:
    exact = OdometryModel(
        **{f.name: getattr(_TRUE, f.name) * (0.01 if "across" in f.name else 1.0) for f in fields(_TRUE)}
    )
    differences, odometry, _ = _observed(12000, exact, 0.003, seed=2)
    noise, _ = odometry_noise(differences, differences, odometry, CalibrationConfig())
    assert noise.across_per_metre < 0.004  # 0.007 with all that differs
    boasting = replace(differences, claimed=0.6 * differences.claimed)
    assert odometry_noise(boasting, boasting, odometry, CalibrationConfig())[0].across_per_metre < 0.004


def test_matches_that_say_they_are_led_by_people_are_believed_that() -> None:
    differences, odometry, truth = _observed(8000, _TRUE, 0.001, seed=6)
    led = 0.06 * np.repeat(np.random.default_rng(6).normal(size=len(differences.errors) // 8), 8)  # nothing cancels
    is_led = np.arange(len(led)) % 40 < 24
    differences.errors[:, 0] += np.where(is_led, led, 0.0)
    claimed = differences.claimed + np.outer(is_led, [0.08**2, 0.0, 0.0])
    told = replace(differences, claimed=claimed)
    noise, _ = odometry_noise(told, told, odometry, CalibrationConfig())
    np.testing.assert_allclose(_nees(noise, odometry, truth), 1.0, atol=0.2)
    boasting, _ = odometry_noise(differences, differences, odometry, CalibrationConfig())
    assert _nees(boasting, odometry, truth)[0] < 0.4


def test_matches_that_claim_to_be_unsure_and_are_not_make_odometry_no_better() -> None:
    differences, odometry, truth = _observed(8000, _TRUE, 0.001, seed=7)
    is_unsure = np.arange(len(differences.errors)) % 2
    modest = replace(differences, claimed=differences.claimed + np.outer(is_unsure, [0.05**2, 0.05**2, 0.02**2]))
    noise, _ = odometry_noise(modest, modest, odometry, CalibrationConfig())
    np.testing.assert_allclose(_nees(noise, odometry, truth), 1.0, atol=0.25)


def test_slips_are_no_noise() -> None:
    differences, odometry, _ = _observed(4000, _TRUE, 0.001, seed=3)
    usual, _ = odometry_noise(differences, differences, odometry, CalibrationConfig())
    differences.errors[::100] += np.array([0.5, 0.3, 0.4])
    slipping, _ = odometry_noise(differences, differences, odometry, CalibrationConfig())
    for name in ("along_per_metre", "heading_per_radian"):
        assert getattr(slipping, name) == pytest.approx(getattr(usual, name), rel=0.2)


def test_clocks_that_differ_are_a_floor() -> None:
    differences, odometry, _ = _observed(8000, _TRUE, 0.0005, seed=4)
    late = 0.03 * np.random.default_rng(0).normal(size=len(differences.errors) + 1)
    differences.errors[:, 0] += late[1:] - late[:-1]
    noise, persistence = odometry_noise(differences, differences, odometry, CalibrationConfig())
    assert noise.along_floor == pytest.approx(0.03 * 2**0.5, rel=0.2)
    assert noise.across_floor < 0.02
    assert persistence[0] == 1.0


def test_a_floor_is_not_found_where_there_is_none() -> None:
    differences, odometry, _ = _observed(8000, _TRUE, 0.0005, seed=5)
    noise, _ = odometry_noise(differences, differences, odometry, CalibrationConfig())
    assert noise.along_floor < 0.002
    assert noise.heading_floor < 0.002


def test_what_variances_are_made_of_is_what_the_model_makes_of_them() -> None:
    differences, odometry, _ = _observed(400, _TRUE, 0.001, seed=6)
    paths = _Paths.of(differences.starts, differences.ends, odometry)
    steps = between(odometry[:-1], odometry[1:]).reshape(-1, _EVERY, 3)
    tiny = dict.fromkeys((f.name for f in fields(OdometryModel)), 0.0) | dict.fromkeys(
        ("along_floor", "across_floor", "heading_floor"), 1e-9
    )
    position = OdometryModel(**tiny | {"along_per_metre": 0.3, "across_per_metre": 0.2, "position_per_radian": 0.1})
    squares = np.array([0.0, 0.0, 0.3, 0.2, 0.1]) ** 2
    covariances = position.covariance(steps)
    np.testing.assert_allclose(paths.rows_x @ squares, covariances[:, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(paths.rows_y @ squares, covariances[:, 1, 1], rtol=1e-6)
    turning = OdometryModel(**tiny | {"heading_per_metre": 0.3, "heading_per_radian": 0.2, "heading_floor": 0.1})
    squares = np.array([0.1, 0.3, 0.2]) ** 2
    covariances = turning.covariance(steps)
    np.testing.assert_allclose(paths.rows_heading @ squares, covariances[:, 2, 2], rtol=1e-6)
    lever, left = paths.carried_by(squares)
    np.testing.assert_allclose(lever, covariances[:, :2, 2] / covariances[:, 2, 2, None], atol=1e-6)
    known = covariances[:, (0, 1), (0, 1)] - lever**2 * covariances[:, 2, 2, None]
    np.testing.assert_allclose(left, known, atol=1e-6)


def test_errors_that_persist_widen_their_axis_alone() -> None:
    noise = lasting_noise(_TRUE, np.array([1.0, 4.0, 1.0]))
    assert noise.across_per_metre == pytest.approx(2.0 * _TRUE.across_per_metre)
    assert noise.along_per_metre == pytest.approx(_TRUE.along_per_metre)
    assert noise.heading_per_radian == _TRUE.heading_per_radian


@pytest.mark.parametrize(
    ("name", "error", "path", "axis"),
    [
        ("along", 0.02, (0.1, 0.0, 0.0), 0),
        ("drift", 0.003, (0.1, 0.0, 0.0), 2),
        ("turn", 0.05, (0.0, 0.0, 0.1), 2),
    ],
)
def test_what_is_the_same_all_the_way_counts_as_much_in_the_mean_over_all_ways(
    name: str, error: float, path: tuple[float, float, float], axis: int
) -> None:
    steps = 300
    noise = lasting_noise(_TRUE, np.ones(3), **{name: error * np.sqrt(0.1 * steps)})
    lengths = np.arange(1, steps + 1)
    ways = steps + 1 - lengths  # so many parts of the path are so long
    claimed = [float((model.covariance(np.tile(path, (steps, 1))) / steps)[axis, axis]) for model in (noise, _TRUE)]
    expected = np.average((0.1 * lengths * error) ** 2, weights=ways)
    assert np.average((claimed[0] - claimed[1]) * lengths, weights=ways) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_the_variance_fit_is_non_negative_least_squares(seed: int) -> None:
    from scipy.optimize import nnls

    rng = np.random.default_rng(seed)
    rows, values = rng.uniform(0.0, 1.0, (40, 3)), rng.normal(size=40)
    expected = nnls(rows, values)[0]
    np.testing.assert_allclose(_non_negative_fit(rows, values), expected, atol=1e-12)
    np.testing.assert_allclose(_best_of_all_sets(rows.T @ rows, rows.T @ values), expected, atol=1e-12)


def test_a_column_that_left_too_early_takes_part_again() -> None:
    from scipy.optimize import nnls

    def leaves_and_returns(rows: NDArray[np.float64], values: NDArray[np.float64]) -> bool:
        best = nnls(rows, values)[0]
        return bool(best[np.linalg.lstsq(rows, values)[0].argmin()] > 0.0 == best.min())

    rng = np.random.default_rng(0)
    tried = ((rng.normal(size=(8, 5)), rng.normal(size=8)) for _ in range(2000))
    rows, values = next(one for one in tried if leaves_and_returns(*one))
    np.testing.assert_allclose(_non_negative_fit(rows, values), nnls(rows, values)[0], atol=1e-9)

"""The calibration finds what was done to a true odometry, and undoes it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose, inverse
from iceg.slam.calibration_config import CalibrationConfig, SuddenStepConfig
from iceg.slam.odometry.calibration import OdometryCalibration, calibrate_odometry
from iceg.slam.track import KeyScan, Track

_GEOMETRY = ScanGeometry(bearings=np.linspace(-1.5, 1.5, 31), range_min=0.1, range_max=20.0)


def _drive(n: int, seed: int = 0) -> NDArray[np.float64]:
    """A smooth drive with changing speed and turning, (n, 3)."""
    rng = np.random.default_rng(seed)
    kernel = np.hanning(25) / np.hanning(25).sum()
    speed = np.convolve(rng.uniform(0.0, 0.15, n + 24), kernel, "valid")
    turn = np.convolve(rng.normal(0.0, 0.25, n + 24), kernel, "valid")
    poses = np.zeros((n, 3))
    for i in range(1, n):
        poses[i] = compose(poses[i - 1], np.array([speed[i], 0.0, turn[i]]))
    return poses


def _track(truth: NDArray[np.float64], every: int, noise: float = 0.0) -> Track:
    """A track whose matches are the truth, up to noise."""
    rng = np.random.default_rng(7)
    scan = Scan(ranges=np.ones(31, np.float32), geometry=_GEOMETRY)
    still = OdometryModel().start()
    keys: list[KeyScan] = []
    for index in range(0, len(truth), every):
        match: RelativePose | NoMatch = NoMatch(reason="first scan")
        if keys:
            T_ref_cur = between(truth[index - every], truth[index]) + noise * rng.normal(size=3)
            match = RelativePose(
                T_ref_cur=T_ref_cur,
                covariance=np.eye(3) * max(noise, 1e-4) ** 2,
                score=1.0,
                inliers=31,
                overlap=1.0,
                weak_directions=np.zeros((0, 3)),
            )
        keys.append(
            KeyScan(
                index=index,
                scan=scan,
                motion=still,
                match=match,
                anchor=max(0, len(keys) - 1),
                T_track_robot=truth[index],
            )
        )
    n = len(truth)
    return Track(
        keys=keys,
        key_of_scan=np.arange(n) // every,
        T_key_scan=between(truth[(np.arange(n) // every) * every], truth),
        failures=0,
        lost=[],
    )


def _spoiled(
    truth: NDArray[np.float64],
    scale: float,
    heading_scale: float,
    drift: float,
    shift: float,
    mount: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Odometry as a wrong model would record it: the inverse of what the calibration does."""
    steps = between(truth[:-1], truth[1:])
    steps = compose(compose(mount, steps), inverse(mount))
    places = np.arange(len(steps), dtype=np.float64)
    steps = np.column_stack([np.interp(places - shift, places, steps[:, k]) for k in range(3)])
    steps[:, :2] /= 1.0 + scale
    steps[:, 2] = (steps[:, 2] - drift * np.hypot(steps[:, 0], steps[:, 1])) / (1.0 + heading_scale)
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return np.array(odometry)


@pytest.mark.parametrize(
    ("scale", "heading_scale", "drift", "shift"),
    [(0.0, 0.0, 0.0, 0.0), (0.04, -0.03, 0.0, 0.0), (0.0, 0.0, 0.05, 0.0), (-0.02, 0.02, 0.02, 0.5), (0, 0, 0, -0.5)],
)
def test_what_was_done_to_odometry_is_found(scale: float, heading_scale: float, drift: float, shift: float) -> None:
    truth = _drive(2500)
    odometry = _spoiled(truth, scale, heading_scale, drift, shift, np.zeros(3))
    found = calibrate_odometry(_track(truth, 6, noise=0.002), odometry, CalibrationConfig())
    assert found.translation_scale == pytest.approx(scale, abs=0.006)
    assert found.heading_scale == pytest.approx(heading_scale, abs=0.01)
    assert found.heading_per_metre == pytest.approx(drift, abs=0.006)
    assert found.heading_shift == pytest.approx(shift, abs=0.1)


def test_matches_beside_a_wall_tell_of_turns_though_not_how_far_the_robot_came() -> None:
    truth, rng = _drive(3000), np.random.default_rng(3)
    odometry = _spoiled(truth, 0.0, 0.02, 0.01, 0.0, np.zeros(3))
    plain = _track(truth, 6, noise=0.003)

    def beside_wall(key: KeyScan, k: int, turn_per_metre: float) -> KeyScan:
        """Its match slides along the wall, but for one in twenty stretches of the way, and turns with that."""
        if isinstance(key.match, NoMatch) or k // 30 % 20 == 1:
            return key
        slide = np.array([1.0, 0.0, turn_per_metre])
        seen = compose(key.match.T_ref_cur, rng.normal(0.0, 0.2) * slide)
        return replace(key, match=replace(key.match, T_ref_cur=seen, weak_directions=slide[None]))

    def drift_beside(turn_per_metre: float) -> OdometryCalibration:
        keys = [beside_wall(key, k, turn_per_metre) for k, key in enumerate(plain.keys)]
        return calibrate_odometry(replace(plain, keys=keys), odometry, CalibrationConfig())

    straight, curved = drift_beside(0.0), drift_beside(0.2)
    assert straight.heading_per_metre == pytest.approx(0.01, abs=0.002)
    assert straight.heading_scale == pytest.approx(0.02, abs=0.005)
    assert abs(curved.heading_per_metre - 0.01) > 2.0 * abs(straight.heading_per_metre - 0.01)  # those are left out


@pytest.mark.parametrize("scans", [-5, 4])
def test_odometry_that_is_several_scans_late_is_read_in_time(scans: int) -> None:
    truth = _drive(1500)
    late = truth[np.clip(np.arange(len(truth)) - scans, 0, len(truth) - 1)]
    calibration = calibrate_odometry(_track(truth, every=4), late, CalibrationConfig())
    assert calibration.heading_shift == pytest.approx(scans, abs=0.1)
    assert calibration.translation_shift == pytest.approx(scans, abs=0.1)
    assert calibration.is_late(CalibrationConfig())
    assert not calibrate_odometry(_track(truth, every=4), truth, CalibrationConfig()).is_late(CalibrationConfig())
    inner = slice(20, -20)
    corrected = calibration.apply(late, SuddenStepConfig())[inner]
    steps, true_steps = (between(poses[:-1], poses[1:]) for poses in (corrected, truth[inner]))
    np.testing.assert_allclose(steps, true_steps, atol=3e-3)


def test_a_drifting_heading_does_not_pass_for_a_laser_that_looks_askew() -> None:
    truth = _drive(2500)
    found = calibrate_odometry(
        _track(truth, 6, noise=0.001), _spoiled(truth, 0, 0, 0.06, 0, np.zeros(3)), CalibrationConfig()
    )
    assert found.T_odometry_laser == pytest.approx(np.zeros(3), abs=0.003)


def test_noise_of_the_heading_does_not_pass_for_turns() -> None:
    steps = np.tile([0.1, 0.0, 0.0], (6000, 1))
    for corner in range(600, 6000, 600):  # a corridor with few corners
        steps[corner : corner + 12] = [0.02, 0.0, np.pi / 24.0]
    truth, odometry = np.zeros((6000, 3)), np.zeros((6000, 3))
    noise = np.random.default_rng(3).normal(0.0, 0.008, 6000)
    for i in range(1, 6000):
        truth[i] = compose(truth[i - 1], steps[i])
        odometry[i] = compose(odometry[i - 1], steps[i] * (1.0, 1.0, 1.05) + (0.0, 0.0, noise[i]))
    found = calibrate_odometry(_track(truth, 4, noise=0.0005), odometry, CalibrationConfig())
    assert found.heading_scale == pytest.approx(1.0 / 1.05 - 1.0, abs=0.03)


def test_a_shifted_laser_mount_is_found() -> None:
    truth = _drive(2500)
    mount = np.array([0.12, -0.03, 0.0])
    found = calibrate_odometry(_track(truth, 6, noise=0.001), _spoiled(truth, 0, 0, 0, 0, mount), CalibrationConfig())
    assert found.T_odometry_laser == pytest.approx(mount, abs=0.015)


def test_noise_in_the_steps_does_not_shrink_the_scale() -> None:
    truth = _drive(3000)
    steps = between(truth[:-1], truth[1:])
    steps[:, :2] *= 1.0 + np.random.default_rng(5).normal(0.0, 1.0, (len(steps), 1))
    noisy = [truth[0]]
    for step in steps:
        noisy.append(compose(noisy[-1], step))
    found = calibrate_odometry(_track(truth, every=2), np.array(noisy), CalibrationConfig())
    assert abs(found.translation_scale) < 0.05  # −0.10 when fitted to what odometry says, −0.30 to single steps of it


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("columns", [(0, 1), (2,)], ids=["moves", "turns"])
def test_odometry_that_tells_nothing_has_no_scale(columns: tuple[int, ...], noise: float) -> None:
    truth = _drive(2500)
    steps = between(truth[:-1], truth[1:])
    for column in columns:
        steps[:, column] = np.random.default_rng(column).normal(0.0, noise, len(steps))
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    found = calibrate_odometry(_track(truth, 6, noise=0.001), np.array(odometry), CalibrationConfig())
    assert (found.heading_scale if columns == (2,) else found.translation_scale) == 0.0


def test_applying_the_calibration_undoes_the_error() -> None:
    truth = _drive(2500)
    odometry = _spoiled(truth, 0.04, -0.03, 0.05, -0.4, np.array([0.1, 0.0, 0.0]))
    corrected = calibrate_odometry(_track(truth, 6, noise=0.001), odometry, CalibrationConfig()).apply(
        odometry, SuddenStepConfig()
    )

    def errors(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return between(between(truth[:-30], truth[30:]), between(poses[:-30], poses[30:]))

    before, after = np.std(errors(odometry), axis=0), np.std(errors(corrected), axis=0)
    assert after[0] < 0.3 * before[0]
    assert after[2] < 0.3 * before[2]


def test_noise_that_is_left_is_measured() -> None:
    truth = _drive(4000)
    rng = np.random.default_rng(3)
    steps = between(truth[:-1], truth[1:])
    distance = np.hypot(steps[:, 0], steps[:, 1])
    steps[:, 2] += 0.04 * np.sqrt(distance) * rng.normal(size=len(steps))
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    noise = calibrate_odometry(_track(truth, 6, noise=0.0005), np.array(odometry), CalibrationConfig()).noise
    path = float(distance.sum()) / (len(truth) / 6)
    turn = float(np.abs(between(truth[:-1], truth[1:])[:, 2]).sum()) / (len(truth) / 6)
    claimed = noise.heading_floor**2 + noise.heading_per_metre**2 * path + noise.heading_per_radian**2 * turn
    assert claimed**0.5 == pytest.approx(0.04 * path**0.5, rel=0.3)


def test_a_short_track_changes_nothing() -> None:
    truth = _drive(60)
    odometry = _spoiled(truth, 0.05, 0.05, 0.05, 0.5, np.zeros(3))
    found = calibrate_odometry(_track(truth, 6), odometry, CalibrationConfig())
    assert found == OdometryCalibration(noise=OdometryModel())
    np.testing.assert_allclose(found.apply(odometry, SuddenStepConfig()), odometry, atol=1e-9)


def test_a_single_scan_stays_where_it_is() -> None:
    one = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(OdometryCalibration(noise=OdometryModel()).apply(one, SuddenStepConfig()), one)


def _with_heading_noise(truth: NDArray[np.float64], persists: int) -> NDArray[np.float64]:
    """Odometry whose error of heading stays the same for so many steps."""
    rng = np.random.default_rng(5)
    steps = between(truth[:-1], truth[1:])
    steps[:, 2] += np.repeat(rng.normal(0.0, 0.01, len(steps) // persists + 1), persists)[: len(steps)]
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return np.array(odometry)


def test_errors_that_persist_weigh_less_in_a_graph() -> None:
    # Key scans lie 6 steps apart: errors that last for 18 steps correlate three motions, ρ = 2/3 and 1/3 one and
    # two motions on, and 1 + 2 (16/17 · 2/3 + 15/17 · 1/3) is 2.8 times the variance.
    truth = _drive(6000)
    fresh = calibrate_odometry(_track(truth, 6, noise=0.0005), _with_heading_noise(truth, 6), CalibrationConfig())
    lasting = calibrate_odometry(_track(truth, 6, noise=0.0005), _with_heading_noise(truth, 18), CalibrationConfig())

    def widened(found: OdometryCalibration) -> float:
        path = np.tile([0.08, 0.0, 0.02], (6, 1))
        return float(found.lasting_noise.covariance(path)[2, 2] / found.noise.covariance(path)[2, 2])

    assert widened(fresh) < 1.2
    assert 2.2 < widened(lasting) < 3.4


def test_a_scale_that_nothing_measures_counts_where_odometry_is_alone() -> None:
    truth = _drive(3000)
    track = _track(truth, 6, noise=0.002)
    seen = calibrate_odometry(track, truth, CalibrationConfig()).lasting_noise
    still = OdometryModel().start()
    for k in range(300, 450):  # a long corridor
        key = track.keys[k]
        assert isinstance(key.match, RelativePose)
        track.keys[k] = replace(
            key,
            match=replace(key.match, weak_directions=np.array([[1.0, 0.0, 0.0]])),
            motion=replace(still, distance=40.0),
        )
    alone = calibrate_odometry(track, truth, CalibrationConfig()).lasting_noise
    assert alone.along_per_metre > 1.2 * seen.along_per_metre
    assert alone.across_per_metre == pytest.approx(seen.across_per_metre, rel=0.5)


def test_a_drift_and_a_scale_of_turns_that_nothing_measures_count_where_odometry_is_alone() -> None:
    truth = _drive(3000)
    track = _track(truth, 6, noise=0.002)
    seen = calibrate_odometry(track, truth, CalibrationConfig()).lasting_noise
    still = OdometryModel().start()

    def alone(distance: float, turn: float, every_other: float) -> OdometryModel:
        for k in range(300, 450):
            heading = turn if k % 2 else every_other * turn
            motion = replace(still, T_key_robot=np.array([distance, 0.0, heading]), distance=distance, turn=abs(turn))
            track.keys[k] = replace(track.keys[k], match=NoMatch(reason="nothing there"), motion=motion)
        return calibrate_odometry(track, truth, CalibrationConfig()).lasting_noise

    driving, turning, shaking = alone(40.0, 0.0, 1.0), alone(0.0, 3.0, 1.0), alone(0.0, 3.0, -1.0)
    assert driving.heading_per_metre > 1.2 * seen.heading_per_metre
    assert driving.heading_per_radian == pytest.approx(seen.heading_per_radian, rel=0.1)
    assert turning.heading_per_radian > 1.2 * seen.heading_per_radian
    assert shaking.heading_per_radian < 0.5 * (seen.heading_per_radian + turning.heading_per_radian)

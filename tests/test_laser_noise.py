"""Noise learned from scans: against what the simulator put in, and plausible on recorded logs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frontends.laser_noise import LaserNoise, LaserNoiseError, learn_laser_noise
from frontends.logs import read_log
from frontends.scan import Log, ScanGeometry
from frontends.simulator.laser import Laser, sense, sick_lms200
from frontends.simulator.scene import load_scene
from frontends.simulator.simulation import simulate

SCENE = load_scene("rooms")
DRIVE = simulate(SCENE, 1).truth[::20]


def seen(laser: Laser, outliers: float = 0.0, seed: int = 0) -> Log:
    """What a laser sees in rooms, a share of its returns anywhere nearer than the walls."""
    rng = np.random.default_rng(seed)
    ranges = sense(SCENE.world, DRIVE, laser, rng)
    stray = rng.random(ranges.shape) < outliers
    ranges[stray] *= rng.random(np.count_nonzero(stray)).astype(np.float32)
    return log_of(ranges, laser.geometry)


def log_of(ranges: np.ndarray, geometry: ScanGeometry) -> Log:
    n = len(ranges)
    return Log(
        ranges=ranges,
        odometry=np.zeros((n, 3)),
        stamps=np.arange(n, dtype=np.float64),
        geometry=geometry,
        path=Path("x"),
    )


@settings(max_examples=12)
@given(
    constant=st.floats(0.005, 0.3),
    per_metre=st.floats(0.0, 0.03),
    outliers=st.floats(0.0, 0.1),
    step=st.sampled_from([0.0, 0.001, 0.01]),
    seed=st.integers(0, 100),
)
def test_the_noise_of_a_simulated_laser_is_found(
    constant: float, per_metre: float, outliers: float, step: float, seed: int
) -> None:
    geometry = replace(sick_lms200(), range_max=40.0)
    # The simulator's deviation is linear in the range, the model's variance in its square.
    laser = Laser(
        geometry=geometry, range_std=constant, range_std_per_metre=0.0, quantisation=step, mixed_share=0.2, period=0.2
    )
    if per_metre > 0.0:
        laser = replace(laser, range_std=0.0, range_std_per_metre=per_metre)
    log = seen(laser, outliers, seed)
    found = learn_laser_noise(log)
    assert found is not None
    typical = np.nanmedian(log.ranges)
    expected = per_metre * typical if per_metre > 0.0 else constant
    expected = np.hypot(expected, step / np.sqrt(12.0))
    assert found.typical == pytest.approx(expected, rel=0.15, abs=0.001)
    assert found.outlier_share <= outliers + 0.12


def test_what_grows_with_range_is_told_from_what_does_not() -> None:
    geometry = replace(sick_lms200(), range_max=40.0)
    constant = learn_laser_noise(seen(Laser(geometry=geometry, range_std=0.05, range_std_per_metre=0.0)))
    growing = learn_laser_noise(seen(Laser(geometry=geometry, range_std=0.0, range_std_per_metre=0.02)))
    assert constant is not None
    assert growing is not None
    assert constant.constant == pytest.approx(0.05, rel=0.1)
    assert constant.per_metre < 0.008
    assert growing.per_metre == pytest.approx(0.02, rel=0.15)
    assert growing.constant < 0.02


def test_a_step_of_the_readings_is_found_and_counts_as_noise() -> None:
    found = learn_laser_noise(seen(Laser(range_std=0.0005, range_std_per_metre=0.0, quantisation=0.02)))
    assert found is not None
    assert found.step == pytest.approx(0.02, abs=1e-5)
    assert 0.02 / np.sqrt(12.0) * 0.9 < found.constant < 0.012


def test_outliers_and_missing_returns_are_counted() -> None:
    clean, stray = seen(Laser(mixed_share=0.0)), seen(Laser(mixed_share=0.0), outliers=0.08)
    stray.ranges[:, ::10] = np.nan
    noise, more = learn_laser_noise(clean), learn_laser_noise(stray)
    assert noise is not None
    assert more is not None
    assert more.outlier_share - noise.outlier_share == pytest.approx(0.08, abs=0.025)
    assert more.no_return_share - noise.no_return_share == pytest.approx(19 / 181, abs=0.01)
    assert more.constant == pytest.approx(noise.constant, rel=0.15)


def test_a_log_that_meets_no_walls_tells_nothing() -> None:
    geometry = sick_lms200()
    empty = np.full((50, 181), np.nan, np.float32)
    assert learn_laser_noise(log_of(empty, geometry)) is None
    sparse = empty.copy()
    sparse[:, ::3] = 5.0
    assert learn_laser_noise(log_of(sparse, geometry)) is None
    assert learn_laser_noise(log_of(empty[:0], geometry)) is None


def test_negative_noise_is_refused() -> None:
    with pytest.raises(LaserNoiseError, match="negative"):
        LaserNoise(constant=-0.01)


def test_the_typical_deviation_is_that_at_the_typical_range() -> None:
    assert LaserNoise(constant=0.03, per_metre=0.01, typical_range=4.0).typical == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("name", "least", "most"), [("intel", 0.003, 0.01), ("mit-csail", 0.005, 0.015), ("aces", 0.015, 0.03)]
)
def test_recorded_logs_err_by_as_much_as_their_lasers(data_dir: Path, name: str, least: float, most: float) -> None:
    found = learn_laser_noise(read_log(data_dir / f"{name}.clf.gz"))
    assert found is not None
    assert least < found.typical < most
    assert found.step == pytest.approx(0.01, abs=1e-6)

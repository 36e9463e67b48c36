"""Lasers much noisier than those of the recorded logs: what becomes of a run, and what its parts make of the noise."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from frontends.laser_noise import LaserNoise
from frontends.scan import Log, Scan
from frontends.simulator.laser import Laser, cast, sense, sick_lms200
from frontends.simulator.scene import load_scene
from frontends.simulator.simulation import simulate
from graph.se2 import compose
from iceg.config import Config, ConfigError, LaserConfig
from iceg.evaluation.consistency import pose_nees
from iceg.evaluation.noise_bound import scan_information, trajectory_bound
from iceg.evaluation.trajectory import trajectory_errors
from iceg.ice.config import FeatureConfig, LocalMapConfig
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.noise import ALLOWED, PLAIN, beyond_allowed
from iceg.ice.points import ScanPoints, extract_points
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.slam.noise_widths import widened

GEOMETRY = replace(sick_lms200(), range_max=40.0)


@pytest.mark.parametrize(
    ("noise", "per_metre", "most"), [(0.03, 0.0, 2.0), (0.1, 0.0, 2.2), (0.3, 0.0, 4.5), (0.005, 0.02, 2.5)]
)
def test_a_noisy_laser_finds_its_way_near_the_bound(noise: float, per_metre: float, most: float) -> None:
    scene = load_scene("room")
    laser = replace(scene.laser, geometry=GEOMETRY, range_std=noise, range_std_per_metre=per_metre)
    simulation = simulate(scene, 5, laser=laser)
    result = run(simulation.log, Config(grid=GridConfig(resolution=0.2)))
    truth = simulation.truth
    assert result.summary["lost_at_scans"] == []
    bound = trajectory_bound(scan_information(scene.world, truth, laser, simulation.log.stamps))
    assert trajectory_errors(result.trajectory, truth).ate_rmse < most * bound
    low, high = float(chi2.ppf(0.01, 3)), float(chi2.ppf(0.99, 3))
    assert low < pose_nees(result.key_poses, truth[result.key_scans], result.covariances).mean() < high
    found = result.summary["laser"]
    assert found is not None
    typical = np.hypot(found["noise_m"], found["noise_per_metre"] * found["typical_range_m"])
    assert typical == pytest.approx(noise + per_metre * found["typical_range_m"], rel=0.15)


def test_settings_overrule_what_the_log_says() -> None:
    simulation = simulate("room", 5)
    log = simulation.log.select(slice(0, 60))
    said = Config(laser=LaserConfig(noise=0.2, noise_per_metre=0.01))
    summary = run(log, said).summary["laser"]
    assert summary is not None
    assert (summary["noise_m"], summary["noise_per_metre"]) == (0.2, 0.01)
    with pytest.raises(ConfigError, match="noise"):
        LaserConfig(noise=-0.1)


def test_a_laser_that_errs_little_leaves_everything_as_it_is() -> None:
    assert beyond_allowed(None) == PLAIN
    good = beyond_allowed(LaserNoise(constant=ALLOWED))
    assert good.typical == 0.0
    scan = Scan(ranges=np.linspace(2.0, 30.0, GEOMETRY.n_beams, dtype=np.float32), geometry=GEOMETRY)
    plain, seen = extract_points(scan), extract_points(scan, noise=good)
    for name in ("points", "normals", "beams", "spreads"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(plain, name))
    config = Config()
    assert widened(config, 0.0) is config
    assert widened(config, 1e-6).ice.refinement.scale == pytest.approx(config.ice.refinement.scale)


def test_far_ranges_count_less_though_near_ones_are_good() -> None:
    camera = LaserNoise(constant=0.002, per_metre=0.006, typical_range=2.0)
    noise = beyond_allowed(camera)
    assert noise.typical == 0.0
    ranges = np.where(np.arange(GEOMETRY.n_beams) < 90, 3.0, 8.0).astype(np.float32)
    seen = extract_points(Scan(ranges=ranges, geometry=GEOMETRY), noise=noise)
    near = np.hypot(*(seen.points - GEOMETRY.origin_robot).T) < 4.0
    assert (seen.spreads[near] == 1.0).all()
    # Seen at a right angle, as these are.
    far = (0.002**2 + (0.006 * 8.0) ** 2) / ALLOWED**2
    assert np.median(seen.spreads[~near]) == pytest.approx(far, rel=0.02)


def test_points_of_a_noisy_laser_move_towards_their_wall_and_keep_its_normal() -> None:
    scene, pose = load_scene("rooms"), np.array([[0.0, 0.0, 0.4]])
    laser = Laser(geometry=GEOMETRY, range_std=0.15, range_std_per_metre=0.0, mixed_share=0.0)
    ranges = sense(scene.world, pose, laser, np.random.default_rng(3))[0]
    truth = cast(scene.world, compose(pose, GEOMETRY.T_robot_laser), GEOMETRY.bearings, 40.0)
    noisy = Scan(ranges=ranges, geometry=GEOMETRY)
    plain = extract_points(noisy)
    smooth = extract_points(noisy, noise=beyond_allowed(LaserNoise(constant=0.15, typical_range=2.0)))
    assert (plain.spreads == 1.0).all()
    where = GEOMETRY.origin_robot + truth[0][:, None] * GEOMETRY.directions_robot
    normals = smooth.normals
    known = (normals**2).sum(axis=1) > 0
    assert known.mean() > 0.75 > ((plain.normals**2).sum(axis=1) > 0).mean()
    off, moved = (np.abs(((one.points - where[one.beams]) * normals).sum(axis=1))[known] for one in (plain, smooth))
    assert np.median(moved) < 0.6 * np.median(off)


def test_surfels_of_one_wall_gather_on_it() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.5, 3.5, 2000), 2.0 + rng.normal(0, 0.1, 2000)])
    normals = np.tile([0.0, -1.0], (2000, 1))
    cloud = ScanPoints(points=points, normals=normals, beams=np.arange(2000, dtype=np.int32), spreads=np.ones(2000))
    plain, sharp = (_surfels_of(cloud, sharpen) for sharpen in (0.0, 0.1))
    before, after = (np.abs(surfels[:, 1] - 2.0) for surfels in (plain, sharp))
    assert after.mean() < 0.4 * before.mean()
    np.testing.assert_allclose(sharp[:, 3], -1.0, atol=1e-9)


def _surfels_of(cloud: ScanPoints, sharpen: float) -> NDArray[np.float64]:
    """Of a local map that holds one scan alone."""
    local_map = LocalMap(np.zeros(2), np.full(2, 4.0), LocalMapConfig(sharpen=sharpen), FeatureConfig())
    nothing = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))
    local_map.add(cloud, nothing, np.zeros(3))
    return local_map.surfels


def test_a_stated_noise_counts_where_the_log_tells_none() -> None:
    blind = Log.from_arrays(np.full((5, 20), np.nan), field_of_view=3.0)
    laser = run(blind, Config(laser=LaserConfig(noise=0.3))).summary["laser"]
    assert laser is not None
    assert laser["noise_m"] == 0.3

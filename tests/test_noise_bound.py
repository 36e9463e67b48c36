"""The bound that range noise sets, against closed forms."""

import numpy as np
import pytest

from frontends.scan import ScanGeometry
from frontends.simulator.laser import Laser
from frontends.simulator.world import World, rectangle
from iceg.evaluation.noise_bound import scan_information, trajectory_bound

SQUARE = World.empty().with_segments(rectangle(0.0, 0.0, 4.0, 4.0))


def laser(bearings: list[float], noise: float, mount: float = 0.0) -> Laser:
    geometry = ScanGeometry(
        bearings=np.array(bearings), range_min=0.0, range_max=20.0, T_robot_laser=np.array([mount, 0.0, 0.0])
    )
    return Laser(geometry=geometry, range_std=noise, range_std_per_metre=0.0, quantisation=0.0)


def test_beams_that_meet_walls_squarely_tell_of_the_distance() -> None:
    # One beam to the right and one ahead, each 2 m from its wall: dr = dy, dr = -dx; a turn changes neither.
    found = scan_information(SQUARE, np.zeros((1, 3)), laser([-np.pi / 2, 0.0], 0.1), np.zeros(1))
    np.testing.assert_allclose(found[0], np.diag([100.0, 100.0, 0.0]), atol=1e-3)


def test_a_slanting_beam_tells_more_of_the_distance_and_of_the_turn() -> None:
    # 30° to the normal of the wall ahead: r = (2 - x) / cos 30°, dr/dθ = r tan 30°.
    found = scan_information(SQUARE, np.zeros((1, 3)), laser([-np.pi / 6, 0.0], 0.1), np.zeros(1))
    r = 2.0 / np.cos(np.pi / 6)
    slope = np.array([-1.0 / np.cos(np.pi / 6), 0.0, -r * np.tan(np.pi / 6)])
    np.testing.assert_allclose(found[0], 100.0 * (np.outer(slope, slope) + np.diag([1.0, 0.0, 0.0])), atol=2e-2)


@pytest.mark.parametrize("factor", [2.0, 10.0])
def test_the_bound_grows_as_the_noise(factor: float) -> None:
    bearings = np.linspace(-3.0, 3.0, 120).tolist()
    poses = np.array([[0.3, 0.2, 0.5], [-0.4, 0.1, 1.0]])
    bounds = [
        trajectory_bound(scan_information(SQUARE, poses, laser(bearings, noise), np.zeros(2)))
        for noise in (0.01, factor * 0.01)
    ]
    # 120 beams, half of which see x and half y: about σ / √60 each, a little less for those that slant.
    assert 0.5 < bounds[0] / (0.01 * np.sqrt(2.0 / 60.0)) < 1.0
    assert bounds[1] == pytest.approx(factor * bounds[0], rel=1e-9)


def test_no_scan_that_knows_its_pose_has_no_bound() -> None:
    assert np.isnan(trajectory_bound(np.zeros((3, 3, 3))))

"""Open ground is told by what the laser does not see."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from frontends.logs import read_log
from frontends.scan import Log, ScanGeometry
from frontends.simulator.laser import Laser
from frontends.simulator.scene import parse_scene
from frontends.simulator.simulation import simulate
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking.open_ground import is_open_ground
from iceg.slam.tracking_config import OpenGroundConfig


def log_of(ranges: NDArray[np.float64]) -> Log:
    geometry = ScanGeometry(bearings=np.linspace(-1.5, 1.5, ranges.shape[1]), range_min=0.0, range_max=40.0)
    n = len(ranges)
    return Log(
        ranges=ranges.astype(np.float32),
        odometry=np.zeros((n, 3)),
        stamps=np.arange(n, dtype=np.float64),
        geometry=geometry,
        path=Path("some.clf"),
    )


def seen(share: float, distance: float, near: float = 0.0) -> Log:
    """So large a share of the beams of each scan returns from so far, and another from nearby."""
    ranges = np.full((20, 100), np.nan)
    ranges[:, : round(100 * share)] = distance
    ranges[:, 100 - round(100 * near) :] = 4.0
    for row, scan in enumerate(ranges):
        scan[:] = np.roll(scan, 5 * row)
    return log_of(ranges)


def test_few_returns_from_afar_are_open_ground() -> None:
    assert is_open_ground(seen(0.3, 20.0), OpenGroundConfig())
    assert is_open_ground(seen(0.6, 20.0, near=0.1), OpenGroundConfig())  # between buildings
    assert not is_open_ground(seen(0.6, 20.0, near=0.15), OpenGroundConfig())  # a hall
    assert not is_open_ground(seen(0.1, 3.0), OpenGroundConfig())  # a short-sighted laser
    assert not is_open_ground(seen(0.0, 20.0), OpenGroundConfig())


def test_beams_that_never_return_are_hidden_and_tell_nothing() -> None:
    log = seen(0.5, 20.0, near=0.2)
    half_hidden = np.column_stack([log.ranges, np.full_like(log.ranges, np.nan)])
    assert not is_open_ground(log, OpenGroundConfig())
    assert not is_open_ground(log_of(half_hidden), OpenGroundConfig())


@pytest.mark.parametrize("fault", ["", "every 4th beam", "half the readings", "half the view", "4 m"])
def test_a_building_is_none_whatever_the_laser_lacks(fault: str) -> None:
    log = read_log(iceg.demo_log_path())
    assert not is_open_ground(DEGRADATIONS[fault](log).log if fault else log, OpenGroundConfig())


def wood() -> str:
    """Trunks of 15 to 40 cm beside a path of 16 m."""
    rng = np.random.default_rng(3)
    places = rng.uniform((-30.0, -40.0), (50.0, 40.0), (260, 2))
    places = places[(np.abs(places[:, 1]) > 2.0) | (places[:, 0] < -2.0) | (places[:, 0] > 20.0)]
    radii = rng.uniform(0.08, 0.2, len(places))
    trunks = [f"arc {x:.2f} {y:.2f} {r:.2f} pieces=8" for (x, y), r in zip(places, radii, strict=True)]
    return "\n".join(["start 0 0 0", *trunks, "goto 16 0"])


def test_trunks_hold_a_robot_in_a_wood() -> None:
    geometry = ScanGeometry(bearings=np.radians(np.arange(-90.0, 91.0)), range_min=0.05, range_max=40.0)
    run = simulate(parse_scene(wood(), Path("wood.world")), seed=1, laser=Laser(geometry=geometry, period=0.2))
    assert is_open_ground(run.log, OpenGroundConfig())
    without, tracked = (
        track_log(run.log, IceMatcher(open_ground=trunks), OdometryModel(), FrontEndConfig())
        for trunks in (False, True)
    )
    assert without.failures > 0.2 * len(run.log)
    assert tracked.failures < 0.2 * without.failures
    keys = [key.index for key in tracked.keys]
    T_first_keys = between(run.truth[0], run.truth[keys])
    off = between(T_first_keys, np.array([key.T_track_robot for key in tracked.keys]))
    assert np.abs(off).max() < 1.0

"""Among trunks, where no wall holds a robot."""

from pathlib import Path

import numpy as np

from frontends.scan import ScanGeometry
from frontends.simulator.laser import Laser
from frontends.simulator.scene import parse_scene
from frontends.simulator.simulation import simulate
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.tracking.log_tracking import track_log


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
    tracked = track_log(run.log, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert tracked.failures < 0.05 * len(run.log)
    keys = [key.index for key in tracked.keys]
    T_first_keys = between(run.truth[0], run.truth[keys])
    off = between(T_first_keys, np.array([key.T_track_robot for key in tracked.keys]))
    assert np.abs(off).max() < 1.0

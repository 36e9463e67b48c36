"""What a log without odometry knows of its motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.matchers import make_matcher
from frontends.scan import Log
from graph.measurement import NoMatch
from graph.odometry import OdometryModel
from iceg.evaluation.trajectory import trajectory_errors
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.completed_matcher import completed
from iceg.slam.config import FrontEndConfig
from iceg.slam.odometry.constant_velocity import constant_velocity
from iceg.slam.pipeline import run
from iceg.slam.tracking.log_tracking import track_log


def room_log(speeds: list[float]) -> Log:
    """A robot that drives along a room of 8 m by 4 m at speeds [m/scan], and sees all around."""
    bearings = np.linspace(-np.pi, np.pi, 181)[:-1]
    cos, sin = np.cos(bearings), np.sin(bearings)
    rows = []
    for x in np.cumsum(speeds):
        with np.errstate(divide="ignore"):
            to_sides = np.where(cos > 0, (8.0 - x) / cos, -x / cos)
            to_ends = np.where(sin > 0, 2.5 / sin, -1.5 / sin)
        rows.append(np.minimum(np.abs(to_sides), np.abs(to_ends)))
    return Log.from_arrays(np.array(rows), bearings=bearings)


def test_a_robot_that_keeps_its_velocity_is_believed_to() -> None:
    log = room_log([0.05] * 120)
    track = track_log(log, completed(make_matcher("plicp")), OdometryModel(), FrontEndConfig())
    found = constant_velocity(track, CalibrationConfig())
    assert found is not None
    np.testing.assert_allclose(found.poses[:, 0], 0.05 * np.arange(120), atol=0.02)
    assert found.noise.along_floor < 0.03


def test_a_robot_that_stops_and_goes_is_not() -> None:
    log = room_log([0.1 if (k // 5) % 2 else 0.0 for k in range(120)])
    found = constant_velocity(
        track_log(log, completed(make_matcher("plicp")), OdometryModel(), FrontEndConfig()), CalibrationConfig()
    )
    assert found is not None
    assert found.noise.along_floor > 0.1


def test_a_velocity_that_nothing_sees_grows_as_uncertain_as_a_random_walk() -> None:
    track = track_log(room_log([0.05] * 120), completed(make_matcher("plicp")), OdometryModel(), FrontEndConfig())
    found = constant_velocity(track, CalibrationConfig())
    assert found is not None
    usual = found.motions(track)
    keys = [
        replace(key, match=NoMatch(reason="nothing seen")) if 10 <= number < 20 else key
        for number, key in enumerate(track.keys)
    ]
    seen = keys[9].index
    for number, (motion, widened) in enumerate(zip(usual, found.motions(replace(track, keys=keys)), strict=True), 1):
        assert motion is not None
        assert widened is not None
        start, end = (keys[at].index - seen for at in (number - 1, number))
        once = max(1.0, ((end - start) / found.scans) ** 3)
        factor = max(1.0, (end**3 - start**3) / found.scans**3) if 10 <= number <= 20 else once
        np.testing.assert_allclose(widened.covariance * once, factor * motion.covariance)


def test_few_steps_tell_nothing() -> None:
    log = room_log([0.05] * 20)
    assert (
        constant_velocity(
            track_log(log, completed(make_matcher("plicp")), OdometryModel(), FrontEndConfig()), CalibrationConfig()
        )
        is None
    )


@pytest.mark.parametrize(("name", "most"), [("stage-58deg-truth-2", 0.15), ("jackal-mocap-3", 0.015)])
def test_real_bags_without_odometry(data_dir: Path, name: str, most: float) -> None:
    log = read_log(data_dir / "bags" / f"{name}.bag")
    assert log.truth is not None
    assert trajectory_errors(run(log).trajectory, log.truth).ate_rmse < most

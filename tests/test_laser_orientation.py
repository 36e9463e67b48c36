"""Lasers that are mounted otherwise than their logs say."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from graph.odometry import OdometryModel
from graph.se2 import compose
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.ice.matcher import IceMatcher
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.slam.config import FinishConfig, FrontEndConfig
from iceg.slam.progress import Progress
from iceg.slam.tracking.laser_orientation import LaserOrientation, laser_orientation
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking_config import MountConfig

_SCANS = 500
_QUICK = Config(grid=GridConfig(resolution=0.2), finish=FinishConfig(enabled=False))


@pytest.fixture(scope="module")
def log() -> Log:
    log = read_log(demo_log_path())
    return replace(log, ranges=log.ranges[:_SCANS], odometry=log.odometry[:_SCANS], stamps=log.stamps[:_SCANS])


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())[:_SCANS]


def _upside_down(log: Log) -> Log:
    return replace(log, ranges=np.ascontiguousarray(log.ranges[:, ::-1]))


def _turned(log: Log, heading: float) -> Log:
    """The laser looks `heading` to the left of where the log puts it."""
    return replace(log, odometry=compose(log.odometry, np.array([0.0, 0.0, -heading])))


@pytest.mark.parametrize(
    ("heading", "is_mirrored"), [(np.pi, False), (-0.6, False), (0.0, False), (0.5 * np.pi, True), (0.0, True)]
)
def test_a_laser_mounted_otherwise_is_found_and_said(
    log: Log, truth: NDArray[np.float64], heading: float, is_mirrored: bool
) -> None:
    mounted = _turned(_upside_down(log) if is_mirrored else log, heading)
    result = run(mounted, _QUICK)
    assert trajectory_errors(result.trajectory, truth).ate_rmse < 0.02
    said = " ".join(result.summary["warnings"])
    assert ("upside down" in said) == is_mirrored
    assert ("the laser looks there" in said) == (heading != 0.0)
    if heading:
        told = re.search(r"move at (-?\d+)°", said)
        # A few degrees are left to the calibration; upside down, the sign is that of the mirrored log.
        assert told is not None
        assert abs(int(told[1])) == pytest.approx(abs(np.degrees(heading)), abs=2.0)


def test_a_few_degrees_are_left_to_the_calibration(log: Log) -> None:
    askew = _turned(log, np.radians(10.0))
    track = track_log(askew, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert laser_orientation(track, askew.odometry, MountConfig()).is_as_said


def test_beams_of_a_scanner_that_leaves_one_out_at_its_left_are_mirrored_with_their_bearings(log: Log) -> None:
    """Upside down, what a SICK of 180 beams leaves out lies at its other end."""
    cut = replace(
        log,
        ranges=np.ascontiguousarray(log.ranges[:, :0:-1]),
        geometry=replace(log.geometry, bearings=log.geometry.bearings[:-1]),
    )
    track = track_log(cut, IceMatcher(), OdometryModel(), FrontEndConfig())
    corrected = laser_orientation(track, cut.odometry, MountConfig()).corrected(cut)
    np.testing.assert_allclose(corrected.geometry.bearings, log.geometry.bearings[1:])
    np.testing.assert_array_equal(corrected.ranges, log.ranges[:, 1:])


def test_odometry_that_says_nothing_of_where_the_robot_goes_mounts_no_laser(log: Log) -> None:
    rng = np.random.default_rng(0)
    steps = rng.normal(0.0, (0.3, 0.3, 0.3), (len(log), 3))
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert laser_orientation(track, np.cumsum(steps, axis=0), MountConfig()).is_as_said


def test_a_robot_that_never_moves_says_nothing(log: Log) -> None:
    still = replace(log, ranges=log.ranges[:3], odometry=log.odometry[:3], stamps=log.stamps[:3])
    track = track_log(still, IceMatcher(), OdometryModel(), FrontEndConfig())
    assert laser_orientation(track, still.odometry, MountConfig()).is_as_said


def test_scans_that_see_nothing_do_not_count_as_matching_nothing(log: Log) -> None:
    ranges = log.ranges.copy()
    ranges[1::2] = ranges[:-1:2]  # read anew at every second scan only: half of them are not believed
    result = run(replace(log, ranges=ranges), _QUICK)
    said = " ".join(result.summary["warnings"])
    assert "repeats itself" in said
    assert "the laser looks there" not in said


def test_a_laser_tried_backwards_in_vain_is_neither_told_nor_tried_again(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    ranges = log.ranges.copy()
    ranges[::2] = np.random.default_rng(1).uniform(0.5, 8.0, ranges[::2].shape)
    config = replace(_QUICK, front_end=FrontEndConfig(mount=MountConfig(lost_share=0.0)))
    tried: list[LaserOrientation] = []
    corrected = LaserOrientation.corrected

    def noted(orientation: LaserOrientation, log: Log) -> Log:
        tried.append(orientation)
        return corrected(orientation, log)

    monkeypatch.setattr(LaserOrientation, "corrected", noted)
    told: list[Progress] = []
    result = run(replace(log, ranges=ranges, sweep=0.2), config, told.append)
    assert len(tried) == 1
    assert told[-1].tried - told[-1].accepted == result.summary["scans_carried_by_odometry"]

"""Reading bags: what a person who has one notices."""

import bz2
import contextlib
import gzip
import lzma
import math
import os
import sqlite3
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import graph.limits
from frontends.bags import compression
from frontends.bags.compression import unpacked_beginning, unpacked_message, zstd
from frontends.bags.errors import MalformedMessageError
from frontends.logs import LogError, describe_log, read_log
from frontends.scan import Log
from graph.limits import LIMITS
from graph.se2 import compose, expmap
from tests.bags import (
    CONTAINERS,
    OLD_TF,
    Said,
    multi_echo,
    odometry,
    point_cloud,
    pose_with_covariance,
    scan,
    storage_file,
    text,
    transform,
    true_pose,
    unknown,
    write_bag,
)

N_SCANS, N_BEAMS = 12, 61
START = 1_700_000_000.0
URDF = """<robot name="r"><link name="base_link"/><link name="plate"/><link name="laser"/>
<joint name="a" type="fixed"><parent link="base_link"/><child link="plate"/>
<origin xyz="0.1 0 0" rpy="0 0 1.5"/></joint>
<joint name="b" type="fixed"><parent link="plate"/><child link="laser"/><origin xyz="0.2 0 0.3"/></joint></robot>"""


def readings(index: int, n_beams: int = N_BEAMS) -> NDArray[np.float32]:
    """A sweep unlike all others."""
    return (2.0 + 0.01 * index + np.linspace(0.0, 1.0, n_beams)).astype(np.float32)


def moving_scans(**options: object) -> list[Said]:
    """Scans at 10 Hz."""
    return [scan(START + 0.1 * k, readings(k), **options) for k in range(N_SCANS)]  # type: ignore[arg-type]


def arc(share: float) -> NDArray[np.float64]:
    """Pose of a robot on an arc after a share of it."""
    return expmap(share * np.array([2.0, 0.0, 1.2]))


def whole_bag() -> list[Said]:
    """Scans, odometry, a mount, the truth, and what is not needed."""
    said = moving_scans(limits=(0.1, 2.9))
    said += [odometry(START + 0.05 * k, arc(k / 24)) for k in range(25)]
    said += [true_pose(START - 1.0 + 0.05 * k, (5.0, 0.01 * k, 0.0)) for k in range(60)]
    said += [transform(START, "base_link", "laser", (0.2, 0.1, math.pi / 2), topic="/tf_static"), unknown(START)]
    return said


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_bag_reads_the_same_from_every_container(tmp_path: Path, container: str) -> None:
    log = read_log(write_bag(tmp_path, whole_bag(), container))
    assert len(log) == N_SCANS
    expected = np.array([readings(k) for k in range(N_SCANS)])
    expected[expected >= np.float32(2.9)] = np.nan
    np.testing.assert_array_equal(log.ranges, expected)
    np.testing.assert_allclose(log.stamps, START + 0.1 * np.arange(N_SCANS), atol=1e-6)
    np.testing.assert_allclose(log.odometry, [arc(2 * k / 24) for k in range(N_SCANS)], atol=1e-6)
    np.testing.assert_allclose(log.geometry.T_robot_laser, [0.2, 0.1, math.pi / 2], atol=1e-6)
    assert log.truth is not None
    np.testing.assert_allclose(log.truth[:, 1], 0.2 + 0.02 * np.arange(N_SCANS), atol=1e-6)
    assert log.warnings == ()
    assert log.message_counts["/scan (sensor_msgs/msg/LaserScan)"] == N_SCANS


def test_files_that_continue_each_other_are_one_bag(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for part, said in enumerate(np.array_split(np.arange(N_SCANS), 11)):
        own = [scan(START + 0.1 * k, readings(k)) for k in said.tolist()]
        storage_file(write_bag(tmp_path, own, "sqlite3", f"part{part}")).rename(folder / f"split_{part}.db3")
    assert read_log(folder).stamps.tolist() == pytest.approx((START + 0.1 * np.arange(N_SCANS)).tolist())
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - split_0.db3\n    - gone.db3\n  duration: 1\n"
    )
    log = read_log(folder)
    assert len(log) == N_SCANS
    assert any("gone.db3" in warning for warning in log.warnings)


@pytest.mark.parametrize("name", ["metadata.yaml", "part_0.db3"])
def test_a_pipe_among_the_files_of_a_bag_is_refused(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    storage_file(write_bag(tmp_path, moving_scans(), "sqlite3")).rename(folder / "part_1.db3")
    os.mkfifo(folder / name)
    with pytest.raises(LogError, match=rf"{name}: cannot be read as .*: found a device or pipe, expected a file"):
        read_log(folder)


def test_digits_that_are_no_number_do_not_count_the_files(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    storage_file(write_bag(tmp_path, moving_scans(), "sqlite3")).rename(folder / "1²2_0.db3")
    assert len(read_log(folder)) == N_SCANS


def test_a_folder_of_several_bags_is_refused(tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_bag(tmp_path, moving_scans(), "ros1", name)
    with pytest.raises(LogError, match="several bags"):
        read_log(tmp_path)


@pytest.mark.parametrize("container", ["ros1", "mcap"])
def test_topics_with_two_types_and_types_nobody_knows(tmp_path: Path, container: str) -> None:
    said = [*moving_scans(), unknown(START), transform(START, "base_link", "laser", (0.3, 0.0, 0.0))]
    said += [transform(START + k, "odom", "base_link", (0.5 * k, 0.0, 0.0), type_name=OLD_TF) for k in range(3)]
    log = read_log(write_bag(tmp_path, said, container))
    np.testing.assert_allclose(log.odometry[:, 0], 0.05 * np.arange(N_SCANS), atol=1e-6)
    assert log.geometry.T_robot_laser.tolist() == pytest.approx([0.3, 0.0, 0.0])


def one_scan_log(folder: Path, ranges: Sequence[float], **options: object) -> Log:
    """The log of a sweep, twice."""
    said = [scan(START + 0.1 * k, ranges, **options) for k in range(2)]  # type: ignore[arg-type]
    return read_log(write_bag(folder, said))


def test_a_whole_turn_whose_last_beam_is_the_first(tmp_path: Path) -> None:
    log = one_scan_log(tmp_path, [1.0, 2.0, 3.0, 4.0, 1.0], first=-math.pi, step=math.pi / 2)
    assert log.ranges[0].tolist() == [1.0, 2.0, 3.0, 4.0]
    np.testing.assert_allclose(log.geometry.bearings, [-math.pi, -math.pi / 2, 0.0, math.pi / 2], atol=1e-6)


def test_decreasing_angles_are_turned_about(tmp_path: Path) -> None:
    log = one_scan_log(tmp_path, [1.0, 2.0, 3.0], first=1.0, step=-1.0, time_increment=0.02)
    assert log.ranges[0].tolist() == [3.0, 2.0, 1.0]
    np.testing.assert_allclose(log.geometry.bearings, [-1.0, 0.0, 1.0], atol=1e-6)
    assert log.sweep == pytest.approx(-0.04)
    assert log.stamps[0] == pytest.approx(START + 0.02, abs=1e-6)


def test_no_returns_of_all_kinds(tmp_path: Path) -> None:
    log = one_scan_log(
        tmp_path, [0.0, math.inf, -math.inf, math.nan, 10.0, 11.0, 0.05, -1.0, 2.0, 3.0], limits=(0.1, 10.0)
    )
    assert np.flatnonzero(np.isfinite(log.ranges[0])).tolist() == [8, 9]


def test_a_laser_that_hangs_upside_down(tmp_path: Path) -> None:
    said = [scan(START + 0.1 * k, [1.0, 2.0, 3.0], first=-0.5, step=1.0) for k in range(3)]
    said.append(transform(START, "base_link", "laser", (0.2, 0.0, 0.4), roll=math.pi, topic="/tf_static"))
    log = read_log(write_bag(tmp_path, said))
    ahead = log.geometry.bearings + log.geometry.T_robot_laser[2]
    np.testing.assert_allclose(ahead, 0.4 - np.array([1.5, 0.5, -0.5]), atol=1e-6)
    assert log.ranges[0].tolist() == [3.0, 2.0, 1.0]
    assert any("upside down" in warning for warning in log.warnings)


@given(first=st.floats(-270.0, -15.0), view=st.floats(15.0, 360.0), n_beams=st.integers(11, 1081))
def test_angles_in_degrees_are_told_as_such(first: float, view: float, n_beams: int) -> None:
    step = view / (n_beams - 1)
    with tempfile.TemporaryDirectory() as folder:
        said = [scan(START + 0.1 * k, readings(k, n_beams), first=first, step=step) for k in range(3)]
        with pytest.raises(
            LogError, match=rf"/scan makes a scan: found {n_beams} beams from .* expected radians: these"
        ):
            read_log(write_bag(Path(folder), said))


def test_poses_that_may_be_odometry_are_offered_and_taken_if_asked_for(tmp_path: Path) -> None:
    said = moving_scans()
    for k in range(N_SCANS):
        pose = (0.1 * k, 0.0, 0.0)
        said.append(pose_with_covariance(START + 0.1 * k, pose, topic="/robot_pose_ekf/odom_combined"))
        said.append(pose_with_covariance(START + 0.1 * k, pose, topic="/amcl_pose", parent="map"))
    said.append(pose_with_covariance(START, (0.0, 0.0, 0.0), topic="/initialpose"))
    path = write_bag(tmp_path, said)
    log = read_log(path)
    hint = "--log.odometry-topic /robot_pose_ekf/odom_combined"
    assert not log.has_odometry
    assert log.choices["odometry"].endswith(f"/odom_combined (PoseWithCovarianceStamped) is, if asked for: {hint}")
    assert [warning for warning in log.warnings if warning.startswith("there is no odometry:") and hint in warning]
    assert "pose " not in log.choices["odometry"]
    asked = read_log(path, odometry_topic="/robot_pose_ekf/odom_combined")
    np.testing.assert_allclose(asked.odometry[:, 0], 0.1 * np.arange(N_SCANS), atol=1e-6)


def test_beams_that_change_from_message_to_message(tmp_path: Path) -> None:
    said = moving_scans()
    said[4] = scan(START + 0.4, readings(4, 31), step=math.pi / 30)
    said[5] = scan(START + 0.5, [1.0])
    said[6] = scan(START + 0.6, readings(6), step=math.nan, first=math.nan)
    log = read_log(write_bag(tmp_path, said))
    assert len(log) == N_SCANS - 2
    np.testing.assert_array_equal(log.ranges[4, ::2], readings(4, 31))
    assert np.isnan(log.ranges[4, 1::2]).all()
    assert sum("beams" in warning for warning in log.warnings) == 2


def test_of_several_lasers_the_one_that_sees_most(tmp_path: Path) -> None:
    said = [scan(START + 0.1 * k, readings(50 + k), topic="/rear", frame="rear", step=0.01) for k in range(N_SCANS)]
    said += moving_scans(topic="/wide", frame="wide")
    path = write_bag(tmp_path, said)
    chosen = read_log(path).choices["laser"]
    assert chosen.startswith("/wide")
    assert "/rear" in chosen
    assert read_log(path, scan_topic="rear").geometry.resolution == pytest.approx(0.01)
    with pytest.raises(LogError, match="/wide in frame 'wide'"):
        read_log(path, scan_topic="/front")


def test_of_a_laser_with_several_echoes_the_first(tmp_path: Path) -> None:
    plain = moving_scans(frame="laser")
    several = [multi_echo(said, [[r, r + 0.5] if r > 2.5 else [r] for r in said.fields["ranges"]]) for said in plain]
    several[3] = multi_echo(plain[3], [[]] * N_BEAMS)
    log = read_log(write_bag(tmp_path, several, name="several"))
    expected = read_log(write_bag(tmp_path, plain, name="plain"))
    np.testing.assert_array_equal(np.delete(log.ranges, 3, axis=0), np.delete(expected.ranges, 3, axis=0))
    assert np.isnan(log.ranges[3]).all()
    np.testing.assert_array_equal(log.geometry.bearings, expected.geometry.bearings)


def cloud_of_a_room(height: float) -> NDArray[np.float64]:
    """What sixteen rings, two degrees apart, see of walls 4 m away on all sides and of the floor, so far below."""
    azimuth, elevation = np.meshgrid(np.radians(np.arange(-180.0, 180.0, 0.2)), np.radians(np.arange(-15.0, 16.0, 2.0)))
    wall = 4.0 / np.maximum(np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth)))
    floor = np.where(elevation < 0.0, height / np.maximum(np.tan(-elevation), 1e-9), np.inf)
    far = np.minimum(wall, floor)
    return np.stack([far * np.cos(azimuth), far * np.sin(azimuth), far * np.tan(elevation)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("container", ["ros1", "mcap"])
def test_where_there_is_no_scan_point_clouds_are_sliced(tmp_path: Path, container: str) -> None:
    said = [point_cloud(START + 0.1 * k, cloud_of_a_room(0.05)) for k in range(3)]
    said[1] = point_cloud(START + 0.1, [])
    log = read_log(write_bag(tmp_path, said, container))
    bearings = log.geometry.bearings
    assert len(bearings) == 720
    wall = 4.0 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    seen = np.isfinite(log.ranges[0])
    assert seen.mean() > 0.98  # the corners, all equally far, pass for a mark of no return
    np.testing.assert_allclose(log.ranges[0, seen], wall[seen], atol=0.03)
    assert np.isnan(log.ranges[1]).all()
    assert log.choices["laser"].startswith("/points in frame 'lidar'")


def test_a_planar_laser_tells_the_same_by_points_and_by_scans(tmp_path: Path) -> None:
    bearings = np.radians(0.5 * (np.arange(720) + 0.5) - 180.0)
    ranges = readings(0, 720).astype(np.float64)
    points = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(720)])
    said = [point_cloud(START + 0.1 * k, points) for k in range(3)]
    log = read_log(write_bag(tmp_path, said, name="points"))
    np.testing.assert_allclose(log.ranges[0], ranges, atol=1e-4)
    both = [*said, *(scan(START + 0.1 * k, readings(k)) for k in range(3))]
    path = write_bag(tmp_path, both, name="both")
    assert read_log(path).choices["laser"].startswith("/scan in frame 'laser', 3 scans")
    assert "/points" not in read_log(path).choices["laser"]
    np.testing.assert_allclose(read_log(path, scan_topic="points").ranges, log.ranges)


def test_a_laser_called_vertical_does_not_look_into_the_plane(tmp_path: Path) -> None:
    said = moving_scans(topic="/horizontal_laser_2d", frame="horizontal_laser_link", step=0.01)
    said += [
        scan(START + 0.1 * k, readings(50 + k), topic="/vertical_laser_2d", frame="vertical_laser_link")
        for k in range(N_SCANS)
    ]
    path = write_bag(tmp_path, said)
    assert read_log(path).choices["laser"].startswith("/horizontal_laser_2d")
    assert read_log(path, scan_topic="/vertical_laser_2d").choices["laser"].startswith("/vertical_laser_2d")
    upright = transform(START, "base_link", "vertical_laser_link", (0.2, 0.0, 0.0), topic="/tf_static")
    assert read_log(write_bag(tmp_path, [*said, upright], name="placed")).choices["laser"].startswith("/vertical")


def test_a_topic_that_repeats_a_laser_is_no_other_laser(tmp_path: Path) -> None:
    said = moving_scans()
    said += [
        scan(START - 0.5 + 0.1 * k, readings(k), topic="/a_scan", recorded=START + 0.1 * k) for k in range(N_SCANS)
    ]
    log = read_log(write_bag(tmp_path, said))
    assert log.choices["laser"].startswith("/scan")
    assert "/a_scan repeats it" in log.choices["laser"]


def test_two_lasers_on_one_topic_decades_apart(tmp_path: Path) -> None:
    said = moving_scans(frame="front_laser")
    said += [
        scan(3.0 + 0.1 * k, readings(100 + k), frame="rear_laser", recorded=START + 0.1 * k) for k in range(N_SCANS)
    ]
    path = write_bag(tmp_path, said)
    log = read_log(path)
    assert len(log) == N_SCANS
    assert describe_log(log).duration == pytest.approx(1.1)
    assert any("2 lasers share the topic /scan" in warning for warning in log.warnings)
    assert read_log(path, scan_frame="/rear_laser").ranges[0, 0] == np.float32(3.0)


def test_stamps_of_another_clock_are_no_gap(tmp_path: Path) -> None:
    said = moving_scans()
    said[:4] = [scan(5.0 + 0.1 * k, readings(k), recorded=START + 0.1 * k) for k in range(4)]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.stamps, START + 0.1 * np.arange(N_SCANS), atol=1e-5)
    assert any("another clock" in warning for warning in log.warnings)


def test_scans_count_by_their_stamps_not_by_their_recording(tmp_path: Path) -> None:
    late = {3: 0.35, 4: 0.3}
    said = [scan(START + 0.1 * k, readings(k), recorded=START - 80.0 + 0.1 * k + late.get(k, 0.0)) for k in range(12)]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_array_equal(log.ranges[:, 0], [readings(k)[0] for k in range(12)])
    assert any("2 scans arrived behind later ones" in warning for warning in log.warnings)


def test_a_recording_played_twice_keeps_its_order(tmp_path: Path) -> None:
    said = [scan(5.0 + 0.1 * (k % 6), readings(k), recorded=START + 0.1 * k) for k in range(12)]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_array_equal(log.ranges[:, 0], [readings(k)[0] for k in range(12)])
    assert (np.diff(log.stamps) > 0).all()


def test_slow_transforms_are_odometry_on_the_arc_between_them(tmp_path: Path) -> None:
    said = [*moving_scans(frame="/laser"), transform(START, "/base_link", "/laser", (0.0, 0.0, 0.0))]
    said += [transform(START - 0.1 + 1.2 * k, "odom", "base_link", arc(k)) for k in range(2)]
    said += [transform(START + 0.1 * k, "map", "odom", (3.0 * k, 0.0, 0.0)) for k in range(10)]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.odometry, [arc((k + 1) / 12) for k in range(N_SCANS)], atol=1e-6)
    assert "odom → base_link" in log.choices["odometry"]


def test_neither_a_map_nor_the_truth_is_odometry(tmp_path: Path) -> None:
    said = [*moving_scans(), *(transform(START + k, "map", "base_link", (k, 0.0, 0.0)) for k in range(3))]
    said += [odometry(START + 0.5 * k, (k, 0.0, 0.0), topic="/base_pose_ground_truth") for k in range(4)]
    path = write_bag(tmp_path, said)
    log = read_log(path)
    assert not log.has_odometry
    assert log.truth is not None
    asked = read_log(path, odometry_topic="/base_pose_ground_truth")
    assert asked.has_odometry
    assert asked.truth is None
    with pytest.raises(LogError, match="/base_pose_ground_truth"):
        read_log(path, odometry_topic="/odom")


def test_odometry_of_another_clock_is_aligned_by_the_recording(tmp_path: Path) -> None:
    said = [*moving_scans(), *(odometry(50.0 + 0.1 * k, arc(k / 12), recorded=START + 0.1 * k) for k in range(12))]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.odometry, [arc(k / 12) for k in range(12)], atol=1e-5)
    assert any("another clock" in warning for warning in log.warnings)


def test_odometry_that_begins_late_is_told(tmp_path: Path) -> None:
    said = [scan(START + 1.0 * k, readings(k)) for k in range(12)]
    said += [odometry(START + 6.0 + k, arc(k / 12)) for k in range(10)]
    log = read_log(write_bag(tmp_path, said))
    assert any("begins 6 scans late" in warning for warning in log.warnings)


def test_the_mount_by_the_robots_description(tmp_path: Path) -> None:
    said = [*moving_scans(), text(START, "/robot_description", URDF)]
    log = read_log(write_bag(tmp_path, said, "mcap"))
    expected = compose(np.array([0.1, 0.0, 1.5]), np.array([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(log.geometry.T_robot_laser, expected, atol=1e-6)


def test_the_base_frame_may_be_chosen(tmp_path: Path) -> None:
    said = [*moving_scans(), *(odometry(START + 0.1 * k, arc(k / 12), child="base_link") for k in range(12))]
    said += [
        transform(START, "base_link", "laser", (0.2, 0.0, 0.0), topic="/tf_static"),
        transform(START, "base_link", "tip", (0.5, 0.0, 0.0), topic="/tf_static"),
    ]
    path = write_bag(tmp_path, said)
    log = read_log(path, base_frame="tip")
    assert log.geometry.T_robot_laser.tolist() == pytest.approx([-0.3, 0.0, 0.0])
    np.testing.assert_allclose(log.odometry[3], compose(arc(3 / 12), np.array([0.5, 0.0, 0.0])), atol=1e-6)
    with pytest.raises(LogError, match="nothing joins"):
        read_log(path, base_frame="moon")


def test_without_a_scan_the_topics_are_named(tmp_path: Path) -> None:
    with pytest.raises(
        LogError, match=r"1 /bump \(some_robot/msg/Bump\).*LaserScan, MultiEchoLaserScan or PointCloud2$"
    ):
        read_log(write_bag(tmp_path, [unknown(START)]))


@pytest.mark.parametrize(
    "container", ["ros1", "ros1-bz2", "ros1-lz4", "sqlite3", "sqlite3-messages", "mcap", "mcap-zstd"]
)
def test_damaged_bags_are_read_or_refused_in_one_line(tmp_path: Path, container: str) -> None:
    path = write_bag(tmp_path, whole_bag(), container)
    path = storage_file(path) if path.is_dir() else path
    whole, random = path.read_bytes(), np.random.default_rng(1)
    copies = [whole[: len(whole) * k // 21] for k in range(1, 21, 2)]
    for _ in range(20):
        flipped = bytearray(whole)
        for place in random.integers(len(whole), size=random.choice([1, 8])).tolist():
            flipped[place] ^= 1 << int(random.integers(8))
        copies.append(bytes(flipped))
    told: list[str] = []
    for copy in copies:
        path.write_bytes(copy)
        try:
            told += describe_log(read_log(path)).warnings
        except LogError as error:
            told.append(str(error))
    assert told
    assert not any("\n" in sentence for sentence in told)


def test_a_packed_bag_is_unpacked_no_farther_than_a_log_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = write_bag(tmp_path, [*moving_scans(), text(START, "/long", "a" * 1_000_000)], "ros1")
    packed = tmp_path / "packed.bag.zstd"
    packed.write_bytes(zstd.compress(bag.read_bytes()))
    assert len(read_log(packed)) == N_SCANS
    monkeypatch.setattr(graph.limits, "LIMITS", replace(LIMITS, log_bytes=500_000))
    with pytest.raises(LogError, match=r"packed\.bag\.zstd: found \d+ bytes or more .*\(ICEG_LIMITS=log_bytes="):
        read_log(packed, log_format="bag")


def test_a_message_is_unpacked_no_farther_than_a_log_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    packed = zstd.compress(b"a" * 60_000) + zstd.compress(b"b" * 60_000)
    assert unpacked_message(packed) == b"a" * 60_000 + b"b" * 60_000
    with pytest.raises(MalformedMessageError, match="cannot be unpacked"):
        unpacked_message(packed[:-3])
    noise = np.random.default_rng(0).bytes(200_000)
    assert unpacked_beginning("zstd", zstd.compress(noise)) == (noise, True)
    for module in (compression, graph.limits):
        monkeypatch.setattr(module, "LIMITS", replace(LIMITS, log_bytes=100_000))
    with pytest.raises(MalformedMessageError, match=r"found more bytes when unpacked, expected at most 100000 "):
        unpacked_message(packed)
    beginning, is_whole = unpacked_beginning("zstd", zstd.compress(noise))
    assert noise.startswith(beginning)
    assert not is_whole
    assert len(beginning) < len(noise)


def test_a_bag_cut_off_gives_what_is_there(tmp_path: Path) -> None:
    path = write_bag(tmp_path, moving_scans(), "ros1")
    path.write_bytes(path.read_bytes()[:-2500])
    log = read_log(path)
    assert 3 <= len(log) <= N_SCANS
    assert any("index" in warning for warning in log.warnings)


def test_reading_other_logs_does_not_load_rosbags() -> None:
    program = "import sys, frontends.logs, iceg.cli; sys.exit(not {'rosbags', 'lz4', 'apsw'}.isdisjoint(sys.modules))"
    subprocess.run([sys.executable, "-c", program], check=True)


REAL = {  # scans, beams, whether there is odometry, whether there is truth
    "bags/jackal-mocap-3.bag": (400, 897, False, True),
    "bags/stage-58deg-truth-2.bag": (398, 640, False, True),
    "bags/urg-corridor-2019-04.bag": (962, 726, True, False),
    "bags/urg-2018-dec13-before.bag": (857, 726, True, False),
    "bags/neato-left.bag": (174, 360, True, False),
    "bags/obstacle-detector-two-lasers.bag": (330, 726, False, False),
    "bags/mumble-kitchen_1": (675, 360, False, False),
    "bags/cart-rplidar-scanonly": (791, 360, False, False),
    "bags/tb3gazebo-surya": (138, 359, True, False),
    "ros1-laserscan.bag": (1838, 271, False, False),
    "ros1-broken-index.bag": (360, 681, False, False),
}


@pytest.mark.parametrize("name", REAL)
def test_real_bags(data_dir: Path, name: str) -> None:
    log = read_log(data_dir / name)
    assert (len(log), log.geometry.n_beams, log.has_odometry, log.truth is not None) == REAL[name]


def test_what_is_odd_about_real_bags(data_dir: Path) -> None:
    cart, neato = (read_log(data_dir / "bags" / name) for name in ("cart-rplidar-scanonly", "neato-left.bag"))
    assert any("22 % of the beams" in warning for warning in cart.warnings)
    np.testing.assert_allclose(np.abs(neato.geometry.T_robot_laser), [0.1016, 0.0, math.pi], atol=1e-3)
    assert "/stable_scan repeats it" in neato.choices["laser"]
    gaps = describe_log(read_log(data_dir / "bags" / "urg-corridor-2019-04.bag")).gaps
    assert gaps[0][1] == pytest.approx(5.53, abs=0.01)


@pytest.mark.parametrize("apart", [-30.0, 4.0])
def test_odometry_whose_clock_is_seconds_off_is_aligned_by_the_recording(tmp_path: Path, apart: float) -> None:
    said = [scan(START + k, readings(k % N_SCANS)) for k in range(100)]
    said += [
        odometry(START + apart + 0.25 * k, (0.1 * k, 0.0, 0.0), recorded=START + 0.25 * k + 0.02 * (k % 3))
        for k in range(400)
    ]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.odometry[:, 0], 0.4 * np.arange(100), atol=0.02)
    assert any(f"{abs(apart):.1f} s" in warning and "another clock" in warning for warning in log.warnings)


def test_while_odometry_is_silent_its_last_reading_is_held_and_a_whole_source_is_taken(tmp_path: Path) -> None:
    scans = [scan(START + k, readings(k % N_SCANS)) for k in range(60)]
    torn = [odometry(START + k, (0.1 * k, 0.0, 0.0)) for k in range(60) if not 20 < k < 40]
    log = read_log(write_bag(tmp_path, [*scans, *torn], name="torn"))
    np.testing.assert_allclose(log.odometry[20:40, 0], 2.0, atol=1e-6)
    assert log.odometry[40, 0] == pytest.approx(4.0)
    whole = [transform(START + k, "odom", "base_link", (0.1 * k, 0.5, 0.0)) for k in range(60)]
    log = read_log(write_bag(tmp_path, [*scans, *torn, *whole], name="whole"))
    np.testing.assert_allclose(log.odometry[:, 0], 0.1 * np.arange(60), atol=1e-6)
    assert "transform" in log.choices["odometry"]


@pytest.mark.parametrize("is_topic", [True, False])
def test_of_several_robots_the_odometry_is_that_of_the_lasers_own(tmp_path: Path, is_topic: bool) -> None:
    said = [scan(START + 0.1 * k, readings(k), topic="/b/scan", frame="b/laser") for k in range(N_SCANS)]
    said += [transform(START, f"{robot}/base_link", f"{robot}/laser", (0.1, 0.0, 0.0)) for robot in "ab"]
    for k in range(N_SCANS):
        for robot, speed in (("a", 1.0), ("b", 0.02)):
            frames, pose = (f"{robot}/odom", f"{robot}/base_link"), (speed * k, 0.0, 0.0)
            if is_topic:
                moved = odometry(START + 0.1 * k, pose, topic=f"/{robot}/odom", parent=frames[0], child=frames[1])
            else:
                moved = transform(START + 0.1 * k, *frames, pose)
            said.append(moved)
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.odometry[:, 0], 0.02 * np.arange(N_SCANS), atol=1e-6)


def test_parts_of_a_recording_that_each_bear_their_own_date_are_one_bag(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for part, said in enumerate(np.array_split(np.arange(N_SCANS), 3)):
        own = [scan(START + 0.1 * k, readings(k)) for k in said.tolist()]
        write_bag(tmp_path, own).rename(folder / f"run_2024-05-01-10-0{5 * part % 7}-00_{part}.bag")
    assert len(read_log(folder)) == N_SCANS


def test_what_a_recorder_had_still_to_write_is_read(tmp_path: Path) -> None:
    file = storage_file(write_bag(tmp_path, moving_scans(), "sqlite3"))
    crashed = tmp_path / "crashed"
    crashed.mkdir()
    with closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode=WAL").fetchall()
        rows = database.execute("SELECT * FROM messages ORDER BY id DESC LIMIT 4").fetchall()
        database.execute("DELETE FROM messages WHERE id IN (SELECT id FROM messages ORDER BY id DESC LIMIT 4)")
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        database.executemany(f"INSERT INTO messages VALUES ({','.join('?' * len(rows[0]))})", rows)
        database.commit()
        for name in (file.name, f"{file.name}-wal"):
            (crashed / name).write_bytes((file.parent / name).read_bytes())
    before = {entry.name: entry.read_bytes() for entry in crashed.iterdir()}
    assert len(read_log(crashed / file.name)) == N_SCANS
    assert {entry.name: entry.read_bytes() for entry in crashed.iterdir()} == before


def test_a_flat_cloud_may_be_given_in_the_frame_of_the_base(tmp_path: Path) -> None:
    bearings = np.radians(np.arange(0.25, 360.0, 1.0))
    points = np.column_stack([3.0 * np.cos(bearings), 3.0 * np.sin(bearings), np.full(len(bearings), 0.3)])
    said = [point_cloud(START + 0.1 * k, points, frame="base_link") for k in range(12)]
    ranges = read_log(write_bag(tmp_path, said)).ranges
    assert np.isfinite(ranges).sum(axis=1).min() == len(bearings)
    np.testing.assert_allclose(ranges[np.isfinite(ranges)], 3.0, atol=1e-5)


def test_scans_recorded_a_few_periods_late_keep_their_stamps(tmp_path: Path) -> None:
    late = [0.9 if k % 4 == 0 else 0.0 for k in range(80)]
    said = [scan(START + 0.1 * k, readings(k % N_SCANS), recorded=START + 0.1 * k + late[k]) for k in range(80)]
    log = read_log(write_bag(tmp_path, said))
    np.testing.assert_allclose(log.stamps, START + 0.1 * np.arange(80), atol=1e-6)
    assert any("arrived behind later ones" in warning for warning in log.warnings)


@pytest.mark.parametrize("container", ["ros1", "sqlite3"])
def test_a_bag_may_be_of_any_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, container: str) -> None:
    monkeypatch.setattr(graph.limits, "LIMITS", replace(LIMITS, log_bytes=1000))
    assert len(read_log(write_bag(tmp_path, moving_scans(), container))) == N_SCANS


@pytest.mark.parametrize("opened", [gzip.open, bz2.open, lzma.open])
def test_a_bag_may_be_packed_as_any_log(tmp_path: Path, opened: Any) -> None:
    bag = write_bag(tmp_path, moving_scans())
    packed = tmp_path / "packed"
    with opened(packed, "wb") as file:
        file.write(bag.read_bytes())
    assert len(read_log(packed)) == N_SCANS


def test_an_archive_is_to_be_unpacked_first(tmp_path: Path) -> None:
    bag, files = write_bag(tmp_path, moving_scans()), (tmp_path / "x.zip", tmp_path / "x.tar.gz")
    with zipfile.ZipFile(files[0], "w") as archive, tarfile.open(files[1], "w:gz") as other:
        archive.write(bag, "log.bag")
        other.add(bag, "log.bag")
    for file in files:
        with pytest.raises(LogError, match="unpack it first"):
            read_log(file)


@pytest.mark.parametrize("robot", ["lidarbot", "mapping_robot", "laser2go"])
def test_a_robot_may_be_called_after_its_laser(tmp_path: Path, robot: str) -> None:
    said = [*moving_scans(topic=f"/{robot}/scan")]
    said += [odometry(START + 0.1 * k, arc(k / 12), topic=f"/{robot}/odom") for k in range(N_SCANS)]
    assert read_log(write_bag(tmp_path, said)).has_odometry
    others = [
        odometry(START + 0.1 * k, arc(k / 12), topic=f"/robot/{name}")
        for k in range(N_SCANS)
        for name in ("lidar_odometry", "laser/odom", "mapping/odometry", "slam/odom")
    ]
    assert not read_log(write_bag(tmp_path, [*moving_scans(), *others], name="estimates")).has_odometry


@pytest.mark.parametrize("opened", [gzip.open, bz2.open, lzma.open])
def test_a_packed_bag_that_is_damaged_is_read_as_far_as_it_goes_or_refused(tmp_path: Path, opened: Any) -> None:
    bag = write_bag(tmp_path, moving_scans())
    packed = tmp_path / "packed"
    with opened(packed, "wb") as file:
        file.write(bag.read_bytes())
    whole = packed.read_bytes()
    for share in (0.05, 0.5, 0.95):
        at = int(share * len(whole))
        for content in (whole[:at], whole[:at] + bytes(64) + whole[at + 64 :]):
            packed.write_bytes(content)
            with contextlib.suppress(LogError):
                assert len(read_log(packed)) <= N_SCANS

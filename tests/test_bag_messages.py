"""Decoding of messages: what rosbags writes is read back, and no bytes trip it."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontends.bags import messages
from frontends.bags.errors import MalformedMessageError
from frontends.bags.point_clouds import point_cloud as point_cloud_as_scan
from frontends.bags.rigid import Rigid, planar_poses
from frontends.bags.wire import Wire
from tests.bags import (
    MULTI_ECHO,
    ODOMETRY,
    POINT_CLOUD,
    POSE,
    SCAN,
    TF,
    make,
    multi_echo,
    odometry,
    point_cloud,
    scan,
    store,
    transform,
    true_pose,
)

STORES = {is_ros1: store(is_ros1=is_ros1) for is_ros1 in (True, False)}
FRAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0/"), max_size=9)
FLOATS = st.floats(-1e6, 1e6)
POSES = st.tuples(FLOATS, FLOATS, st.floats(-3.1, 3.1))
STAMPS = st.integers(0, 2**31 - 1).map(float)


def packed(said: Any, *, is_ros1: bool) -> bytes:
    """A message as rosbags serialises it."""
    types = STORES[is_ros1]
    pack = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    return bytes(pack(make(types, said, is_ros1=is_ros1), said.type))


@given(st.booleans(), STAMPS, FRAMES, st.lists(st.floats(width=32), min_size=2, max_size=9))
def test_scans(is_ros1: bool, stamp: float, frame: str, ranges: list[float]) -> None:
    data = packed(scan(stamp, ranges, frame=frame, time_increment=0.5), is_ros1=is_ros1)
    read = messages.laser_scan(Wire(data, is_cdr=not is_ros1))
    assert (read.stamp, read.frame) == (stamp, frame)
    np.testing.assert_array_equal(read.ranges, np.array(ranges, np.float32))
    assert read.setting[3:] == (0.5, 0.0, float(np.float32(0.1)), 10.0)


@given(st.booleans(), FRAMES, st.lists(st.lists(st.floats(width=32), max_size=3), min_size=2, max_size=9))
def test_of_several_echoes_the_first_counts(is_ros1: bool, frame: str, echoes: list[list[float]]) -> None:
    said = scan(7.0, [0.0] * len(echoes), frame=frame, time_increment=0.5)
    data = packed(multi_echo(said, echoes), is_ros1=is_ros1)
    read = messages.multi_echo_laser_scan(Wire(data, is_cdr=not is_ros1))
    assert (read.stamp, read.frame, read.setting[3]) == (7.0, frame, 0.5)
    first = [beam[0] if beam else math.nan for beam in echoes]
    np.testing.assert_array_equal(read.ranges, np.array(first, np.float32))


@given(st.booleans(), STAMPS, FRAMES, FRAMES, POSES)
def test_poses(is_ros1: bool, stamp: float, parent: str, child: str, pose: tuple[float, float, float]) -> None:
    for said, decode in (
        (odometry(stamp, pose, parent=parent, child=child), messages.transform_stamped),
        (true_pose(stamp, pose), messages.pose_stamped),
        (transform(stamp, parent, child, pose), lambda wire: messages.transforms(wire)[0]),
    ):
        read = decode(Wire(packed(said, is_ros1=is_ros1), is_cdr=not is_ros1))
        assert read.stamp == stamp
        assert (read.parent, read.child) == (("world", "") if said.type == POSE else (parent, child))
        np.testing.assert_allclose(planar_poses(np.array([read.pose]))[0], pose, atol=1e-9)
        np.testing.assert_allclose(Rigid.of(read.pose).planar, pose, atol=1e-9)


def test_big_endian_cdr() -> None:
    types = STORES[False]
    said = scan(5.0, [1.0, 2.0, 3.0])
    data = bytes(types.serialize_cdr(make(types, said, is_ros1=False), SCAN, little_endian=False))
    assert messages.laser_scan(Wire(data, is_cdr=True)).ranges.tolist() == [1.0, 2.0, 3.0]
    echoes = make(types, multi_echo(said, [[1.0, 5.0], [2.0], [3.0]]), is_ros1=False)
    data = bytes(types.serialize_cdr(echoes, MULTI_ECHO, little_endian=False))
    assert messages.multi_echo_laser_scan(Wire(data, is_cdr=True)).ranges.tolist() == [1.0, 2.0, 3.0]


DECODERS = {
    SCAN: messages.laser_scan,
    MULTI_ECHO: messages.multi_echo_laser_scan,
    ODOMETRY: messages.transform_stamped,
    TF: messages.transforms,
    "imu": messages.turn_rate,
    POINT_CLOUD: point_cloud_as_scan,
}


@given(st.sampled_from(sorted(DECODERS)), st.booleans(), st.binary(max_size=120))
def test_no_bytes_trip_a_decoder(kind: str, is_cdr: bool, data: bytes) -> None:
    try:
        DECODERS[kind](Wire(b"\0\1\0\0" + data if is_cdr else data, is_cdr=is_cdr))
    except MalformedMessageError as error:
        assert str(error)  # noqa: PT017


@pytest.mark.parametrize("is_ros1", [True, False])
def test_a_message_cut_off_is_malformed(is_ros1: bool) -> None:
    data = packed(odometry(1.0, (1.0, 2.0, 0.5)), is_ros1=is_ros1)
    for end in range(60):
        with pytest.raises(MalformedMessageError):
            messages.transform_stamped(Wire(data[:end], is_cdr=not is_ros1))


@pytest.mark.parametrize("is_ros1", [True, False])
def test_echoes_cut_off_are_malformed(is_ros1: bool) -> None:
    data = packed(multi_echo(scan(1.0, [0.0] * 3), [[1.0, 5.0], [], [3.0]]), is_ros1=is_ros1)
    end = len(data) - 4 * 3  # behind the echoes: one list of two intensities, preceded by how many lists
    messages.multi_echo_laser_scan(Wire(data[: end - 4], is_cdr=not is_ros1))
    for short in range(end - 4):
        with pytest.raises(MalformedMessageError):
            messages.multi_echo_laser_scan(Wire(data[:short], is_cdr=not is_ros1))


POINTS = st.lists(st.tuples(*[st.floats(-50.0, 50.0)] * 2, st.sampled_from([0.0, 9.0, math.nan])), max_size=6)


@given(st.booleans(), POINTS, st.sampled_from([7, 8]), st.integers(1, 2), st.booleans())
def test_of_a_cloud_what_lies_level(
    is_ros1: bool, points: list[tuple[float, float, float]], kind: int, rows: int, is_big_endian: bool
) -> None:
    whole = points[: len(points) // rows * rows]
    data = packed(point_cloud(7.0, whole, kind=kind, rows=rows, is_big_endian=is_big_endian), is_ros1=is_ros1)
    read = point_cloud_as_scan(Wire(data, is_cdr=not is_ros1))
    assert (read.stamp, read.frame, len(read.ranges)) == (7.0, "lidar", 720)
    level = [math.hypot(x, y) for x, y, z in whole if z == 0.0]
    seen = read.ranges[np.isfinite(read.ranges)].tolist()
    assert len(seen) <= len(level)
    for distance in seen:
        assert min(abs(distance - other) for other in level) < 1e-4


def test_a_cloud_that_is_none_is_malformed() -> None:
    said = point_cloud(7.0, [[1.0, 2.0, 0.0]] * 3)
    without = said.fields | {"fields": said.fields["fields"][:3]}
    integers = said.fields | {"fields": [(name, offset, 5) for name, offset, _ in said.fields["fields"]]}
    short = said.fields | {"row_step": 5}
    few = said.fields | {"data": said.fields["data"][:-1]}
    for fields in (without, integers, short, few):
        data = packed(said._replace(fields=fields), is_ros1=True)
        with pytest.raises(MalformedMessageError):
            point_cloud_as_scan(Wire(data, is_cdr=False))
    data = packed(said, is_ros1=False)
    for end in range(len(data) - 1):
        with pytest.raises(MalformedMessageError):
            point_cloud_as_scan(Wire(data[:end], is_cdr=True))


ANGLES = st.floats(-math.pi, math.pi)
METRES = st.floats(-10.0, 10.0)
RIGIDS = st.builds(Rigid.from_roll_pitch_yaw, st.tuples(METRES, METRES, METRES), st.tuples(ANGLES, ANGLES, ANGLES))


@given(RIGIDS, RIGIDS)
def test_rigid_transforms_are_a_group(first: Rigid, second: Rigid) -> None:
    back = first.inverse().compose(first.compose(second))
    sign = math.copysign(1.0, sum(a * b for a, b in zip(back[3:], second[3:], strict=True)))
    np.testing.assert_allclose([*back[:3], *(sign * q for q in back[3:])], second, atol=1e-6)


@given(st.floats(-3.1, 3.1))
def test_what_hangs_upside_down_turns_the_other_way(yaw: float) -> None:
    pose = Rigid.from_roll_pitch_yaw((0.0, 0.0, 0.0), (math.pi, 0.0, yaw))
    assert pose.upright == pytest.approx(-1.0)
    left = pose.turned(0.0, 1.0, 0.0)
    np.testing.assert_allclose(left[:2], [math.sin(yaw), -math.cos(yaw)], atol=1e-9)

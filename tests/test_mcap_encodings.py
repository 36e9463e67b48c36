"""MCAP that other programs than ROS 2 have written: read where its messages are those of ROS, else told as it is."""

import json
import struct
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontends.bags.message import type_name
from frontends.logs import LogError, read_log
from iceg.cli import main
from tests.bags import SCAN, Said, make, odometry, scan, store

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000.0
ENCODINGS = st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1, max_size=12)


def string(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def record(operation: int, content: bytes) -> bytes:
    return struct.pack("<BQ", operation, len(content)) + content


def write_mcap(path: Path, profile: str, channels: Iterable[tuple[str, str, str, str, list[bytes]]]) -> Path:
    """A file without chunks and summary: of each channel topic, schema, encoding of both, messages."""
    body = record(1, string(profile) + string("by hand"))
    for number, (topic, schema, schema_encoding, encoding, messages) in enumerate(channels, 1):
        body += record(3, struct.pack("<H", number) + string(schema) + string(schema_encoding) + struct.pack("<I", 0))
        body += record(4, struct.pack("<HH", number, number) + string(topic) + string(encoding) + struct.pack("<I", 0))
        for k, message in enumerate(messages):
            time = round(1e9 * (START + 0.1 * k))
            body += record(5, struct.pack("<HIQQ", number, k, time, time) + message)
    footer = record(2, struct.pack("<QQI", 0, 0, 0))
    path.write_bytes(MAGIC + body + record(15, struct.pack("<I", 0)) + footer + MAGIC)
    return path


def ranges(k: int) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    return (2.0 + 0.01 * k + np.linspace(0.0, 1.0, 61)).astype(np.float32)


def as_ros1(said: list[Said]) -> list[bytes]:
    types = store(is_ros1=True)
    return [bytes(types.serialize_ros1(make(types, message, is_ros1=True), message.type)) for message in said]


def as_cdr(said: list[Said]) -> list[bytes]:
    types = store(is_ros1=False)
    return [bytes(types.serialize_cdr(make(types, message, is_ros1=False), message.type)) for message in said]


SCANS = [scan(START + 0.1 * k, ranges(k)) for k in range(12)]
MOVED = [odometry(START + 0.1 * k, (0.05 * k, 0.0, 0.0)) for k in range(12)]


def test_a_file_that_ends_where_it_begins_is_damaged_in_words(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(MAGIC)
    with pytest.raises(LogError, match=r"damaged, and no message could be read \(it is not laid out as a bag is\)"):
        read_log(path)


def test_scans_as_json_are_told_by_topic_and_encoding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = [json.dumps({"ranges": ranges(k).tolist()}).encode() for k in range(12)]
    path = write_mcap(tmp_path / "log.mcap", "", [("/lidar", "LaserScan", "jsonschema", "json", said)])
    assert main(["info", str(path)]) == 1
    told = capsys.readouterr().err
    assert "12 /lidar (LaserScan as json)" in told
    assert "encoded as json are left out (/lidar), expected those of ROS, encoded as cdr or ros1" in told
    assert "damaged" not in told


@given(
    profile=ENCODINGS | st.just("") | st.just("ros2"),
    encoding=ENCODINGS.filter(lambda text: text not in ("cdr", "ros1")),
)
def test_whatever_the_encoding_it_is_named_and_never_called_damage(profile: str, encoding: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        channel = ("/lidar", "foxglove.LaserScan", encoding, encoding, [b"\x0a\x00"] * 3)
        path = write_mcap(Path(folder) / "log.mcap", profile, [channel])
        with pytest.raises(LogError) as told:
            read_log(path)
    assert f"3 /lidar (foxglove.LaserScan as {encoding})" in str(told.value)
    assert "damaged" not in str(told.value)


def test_odometry_that_cannot_be_read_is_told_beside_scans_that_can(tmp_path: Path) -> None:
    channels = [
        ("/scan", SCAN, "ros2msg", "cdr", as_cdr(SCANS)),
        ("/odom", "foxglove.PoseInFrame", "protobuf", "protobuf", [b"\x0a\x00"] * 12),
    ]
    log = read_log(write_mcap(tmp_path / "log.mcap", "", channels))
    assert len(log) == 12
    assert [warning for warning in log.warnings if "encoded as protobuf are left out (/odom)" in warning]


def test_a_bag_of_ros_1_in_mcap_is_read_without_a_warning_of_damage(tmp_path: Path) -> None:
    channels = [
        ("/scan", "sensor_msgs/LaserScan", "ros1msg", "ros1", as_ros1(SCANS)),
        ("/odom", "nav_msgs/Odometry", "ros1msg", "ros1", as_ros1(MOVED)),
    ]
    assert type_name(channels[0][1]) == SCAN
    log = read_log(write_mcap(tmp_path / "log.mcap", "ros1", channels))
    np.testing.assert_array_equal(log.ranges[:, 5], [ranges(k)[5] for k in range(12)])
    np.testing.assert_allclose(log.odometry[:, 0], 0.05 * np.arange(12), atol=1e-6)
    assert not [warning for warning in log.warnings if "damaged" in warning or "index" in warning]

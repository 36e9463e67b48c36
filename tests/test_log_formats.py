"""Logs whose format and compression are told by their content, and files that are none."""

import bz2
import gzip
import lzma
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from frontends.logs import READERS, LogError, read_log

Compress = Callable[[bytes], bytes]

N_BEAMS = 181


def ranges(k: int) -> NDArray[np.float64]:
    """Readings of scan k, without any repetition."""
    return np.round(np.random.default_rng(k).uniform(1.0, 9.0, N_BEAMS), 3)


def carmen(n_scans: int) -> bytes:
    """A CARMEN log of a robot that drives a metre from scan to scan."""
    lines = [f"FLASER {N_BEAMS} {' '.join(map(str, ranges(k)))} {k} 0 0 {k} 0 0 {k} host {k}" for k in range(n_scans)]
    return "".join(f"{line}\n" for line in lines).encode()


@pytest.mark.parametrize("compress", [bytes, gzip.compress, bz2.compress, lzma.compress])
def test_compression_is_told_by_content_not_by_name(tmp_path: Path, compress: Compress) -> None:
    path = tmp_path / "robot.log"
    path.write_bytes(compress(carmen(900)))
    log = read_log(path)
    assert len(log) == 900
    assert_array_equal(log.ranges[899], ranges(899).astype(np.float32))


def test_what_a_windows_editor_leaves_in_a_log_is_no_part_of_it(tmp_path: Path) -> None:
    path = tmp_path / "robot.log"
    path.write_bytes(b"\xef\xbb\xbf" + carmen(3).replace(b"\n", b"\r\n"))
    assert_array_equal(read_log(path).ranges, [ranges(k).astype(np.float32) for k in range(3)])


@pytest.mark.parametrize("compress", [gzip.compress, bz2.compress, lzma.compress])
def test_compressed_log_that_was_cut_off(tmp_path: Path, compress: Compress) -> None:
    path = tmp_path / "robot.clf"
    whole = compress(carmen(2000))
    path.write_bytes(whole[: len(whole) * 3 // 4])
    log = read_log(path)
    assert 500 < len(log) < 2000
    assert any("compressed file is cut off" in warning for warning in log.warnings)


def test_damaged_compressed_log_is_an_error(tmp_path: Path) -> None:
    content = bytearray(gzip.compress(carmen(100), mtime=0))
    content[200:260] = bytes(60)
    path = tmp_path / "robot.clf.gz"
    path.write_bytes(bytes(content))
    with pytest.raises(LogError, match=r"its compressed content is damaged|:\d+: found"):
        read_log(path)


def test_formats_are_chosen_by_name_or_content(tmp_path: Path) -> None:
    path = tmp_path / "robot.clf"
    path.write_bytes(b"# CARMEN Logfile\n" + carmen(1))
    assert len(read_log(path, log_format="carmen")) == 1
    assert len(read_log(str(path))) == 1
    assert "carmen" in READERS
    with pytest.raises(LogError, match="no log format is called 'rosbag9': expected 'auto' or one of carmen"):
        read_log(path, log_format="rosbag9")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the log is empty"),
        (b"\n \n", "the log is empty"),
        (b"\x1f\x8b\x08\x00\x00", "the compressed file is cut off before its first line"),
        (
            b"time,x,y\n0,1,2\n",
            "found 'time,x,y', expected a log of one of the formats carmen, dpslam, usarsim,",
        ),
        ("range_0,range_1\n1,2\n".encode("utf-16"), "found text in UTF-16, expected UTF-8"),
        (b"\x89PNG\r\n\x1a\n\x00", r"found '\x89PNG\r', expected a log"),
        (b"\x00\x1b[2J", r"found '\x00\x1b[2J', expected a log"),
    ],
)
def test_what_is_no_log_is_shown_in_plain_text(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "robot.clf"
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert str(caught.value).isprintable()


def test_where_the_laser_sits_may_be_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.log"
    path.write_text("Odometry 0 0 0\nLaser 3 1 2 3\nOdometry 0 0 1\nLaser 3 1 2 3\n")
    log = read_log(path)
    assert any("where the laser sits" in warning for warning in log.warnings)
    told = read_log(path, laser_x=0.1, laser_heading=0.5)
    assert told.geometry.T_robot_laser.tolist() == [0.1, log.geometry.T_robot_laser[1], 0.5]
    assert not any("where the laser sits" in warning for warning in told.warnings)
    assert_array_equal(told.ranges, log.ranges)

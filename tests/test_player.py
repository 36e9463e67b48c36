"""Logs of Player: what each of its versions writes, and every kind of damage."""

import gzip
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from frontends.logs import LogError, describe_log, read_log
from frontends.logs.player import is_player, read_player

Write = Callable[..., Path]
N_BEAMS = 181
STEP = math.radians(1.0)


def readings(k: int, n_beams: int = N_BEAMS) -> list[float]:
    return list(np.round(np.random.default_rng(k).uniform(1.0, 7.0, n_beams), 3))


def head(time: float, device: str, *, host: str = "robot", delay: float = 0.02) -> str:
    """Of Player 1: written a little after the reading."""
    return f"{time + delay:014.3f} {host} 6665 {device} 00 {time:014.3f}"


def position(time: float, x: float, y: float, heading: float, **options: str) -> str:
    return f"{head(time, 'position', **options)} {x:+07.3f} {y:+07.3f} {heading:+04.3f} +00.100 +00.000 +00.000 0"  # type: ignore[arg-type]


def pairs(ranges: Sequence[float]) -> str:
    return "".join(f"{reading:.3f} {k % 3:2d} " for k, reading in enumerate(ranges))


def laser(time: float, ranges: Sequence[float], **options: str) -> str:
    return f"{head(time, 'laser', **options)} -1.5708 +1.5708 +.01745329 {len(ranges):04d} {pairs(ranges)}"  # type: ignore[arg-type]


def head2(time: float, device: str, kind: str, index: int = 0, robot: int = 6665) -> str:
    """Of Player 2 and 3."""
    return f"{time:014.3f} 16777343 {robot} {device} {index:02d} {kind}"


def position2(time: float, x: float, y: float, heading: float, **options: int) -> str:
    place = f"{x:+07.3f} {y:+07.3f} {heading:+04.3f}"
    return f"{head2(time, 'position2d', '001 001', **options)} {place} +00.100 +00.000 +00.000 0"


def laser2(time: float, ranges: Sequence[float], *, longest: float = 8.0, pose: str = "", **options: int) -> str:
    kind = "001 002" if pose else "001 001"
    angles = f"-1.5708 +1.5708 +0.01745329 {longest:+07.4f} {len(ranges):04d}"
    return f"{head2(time, 'laser', kind, **options)} 0007 {pose}{angles} {pairs(ranges)}"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_lines(*lines: str, version: str = "1.6.5", end: str = "\n") -> Path:
        path = tmp_path / "writelog_2005.log"
        path.write_text("\n".join([f"## Player version {version} ", "## File version 0.1.0 ", *lines]) + end)
        return path

    return write_lines


def test_player_1_tells_odometry_by_the_times_of_the_readings(write: Write) -> None:
    path = write(
        position(10.0, 0.0, 0.0, 3.1), head(10.0, "sync"), laser(10.05, readings(0)), position(10.1, 1.0, 0.0, -3.1)
    )
    log = read_log(path)
    assert_array_equal(log.ranges, np.array([readings(0)], np.float32))
    assert_allclose(np.degrees(log.geometry.bearings), np.arange(-90, 91), atol=1e-9)
    assert_allclose(log.stamps, [10.05])
    assert abs(log.odometry[0, 2]) == pytest.approx(math.pi)
    assert log.odometry[0, 0] == pytest.approx(0.5, abs=0.02)
    assert log.message_counts == {"laser:0": 1, "position:0": 2, "sync:0": 1}
    assert any("where the laser sits" in warning for warning in log.warnings)


def test_player_2_tells_the_mount_and_the_longest_range(write: Write) -> None:
    ranges = readings(0)
    ranges[3] = 8.0
    log = read_log(
        write(
            head2(0.0, "laser", "004 001") + "  +0.030  -0.010   0.100   0.140   0.140",
            head2(0.0, "position2d", "004 001") + " +00.000 +00.000 +0.000 +00.330 +00.245",
            position2(10.0, 1.0, 2.0, 0.5),
            laser2(10.0, ranges),
        )
    )
    assert_allclose(log.geometry.T_robot_laser, [0.03, -0.01, 0.1])
    assert_allclose(log.odometry, [[1.0, 2.0, 0.5]])
    assert np.flatnonzero(np.isnan(log.ranges[0])).tolist() == [3]
    assert log.geometry.range_max < 8.0
    assert log.has_odometry


def test_scans_may_bring_the_pose_of_the_robot(write: Write) -> None:
    lines = [laser2(10.0 + k, readings(k), pose=f"{k:+07.3f} +00.500 +00.100 ") for k in range(3)]
    log = read_log(write(*lines))
    assert_allclose(log.odometry, [[k, 0.5, 0.1] for k in range(3)])
    assert log.choices["odometry"] == "the poses in the messages of laser:0"
    preferred = read_log(write(position2(10.0, 7.0, 0.0, 0.0), *lines))
    assert_allclose(preferred.odometry, [[7.0, 0.0, 0.0]] * 3)


def test_player_3_keeps_the_beams_of_rangers_in_a_message_of_their_own(write: Write) -> None:
    ranges = " ".join(map(str, readings(0, 91)))
    log = read_log(
        write(
            head2(0.0, "ranger", "004 001") + " +00.200 +00.000 +00.100 +00.000 +00.000 +01.571 +00.1 +00.1 +00.1 0000",
            head2(0.0, "ranger", "004 005") + " -0.785398 0.785398 0.01745329 0.02 5.0 0.001 10.0",
            head2(10.0, "ranger", "001 001") + f" 0091 {ranges} ",
            head2(10.1, "ranger", "001 002") + f" 0091 {ranges} 0 ",
            head2(10.1, "ranger", "001 003") + " 0002 1.000 1.000 ",
        )
    )
    assert len(log) == 2
    assert_allclose(np.degrees(log.geometry.bearings), np.arange(-45, 46), atol=1e-3)
    assert_allclose(log.geometry.T_robot_laser, [0.2, 0.0, 1.571])
    assert_array_equal(np.isfinite(log.ranges[0]), np.array(readings(0, 91)) < 5.0)
    assert not log.has_odometry


def test_of_several_lasers_and_robots_the_one_with_most_scans(write: Write) -> None:
    path = write(
        laser2(10.0, readings(0)),
        position2(10.0, 5.0, 0.0, 0.0),
        *(laser2(10.0 + k, readings(k), robot=6666, index=1) for k in range(3)),
        position2(10.0, 2.0, 0.0, 0.0, robot=6666, index=1),
        position2(10.0, 1.0, 0.0, 0.0, robot=6666, index=0),
    )
    log = read_log(path)
    assert len(log) == 3
    assert_allclose(log.odometry[:, 0], 1.0)
    assert log.choices["odometry"] == "position2d:0, preferred to position2d:1"
    assert any("several lasers" in warning for warning in log.warnings)
    assert_allclose(read_log(path, laser="laser:0").odometry[:, 0], 5.0)
    with pytest.raises(LogError, match="expected 'front' or one of 16777343:6665/laser:0, 16777343:6666/laser:1"):
        read_log(path, laser="laser:2")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("hello", r":3: found 'hello', expected a time, host, port, interface and index"),
        (laser(1.0, [1.0, 2.0]).replace("0002", "0003"), r":3: found 8 numbers, expected angles, how many beams"),
        (laser(1.0, [1.5, 2.0]).replace("1.500", "one"), r":3: found 'one', expected number 5 of 8"),
        (position(1.0, 1e9, 0.0, 0.0), r":3: found the pose 1000000000.0 0.0 0.0"),
        (head(1.0, "position") + " 1.0 2.0", r":3: found the end of the line, expected number 3 of 3"),
        (head2(1.0, "ranger", "001 001") + " 0003 1.0", r":3: found 2 numbers, expected how many ranges follow"),
        (head2(1.0, "laser", "004 001") + " 1e5 0 0 0 0", r":3: found 100000.0 0.0 0.0, expected a finite mounting"),
        (head(1e25, "sync"), r":3: found the time 1e\+25"),
    ],
)
def test_bad_lines_name_their_place_or_are_passed_over(write: Write, line: str, said: str) -> None:
    path = write(line, laser(2.0, readings(0)))
    with pytest.raises(LogError, match=said):
        read_log(path)
    log = read_log(path, skip_bad_lines=True)
    assert (len(log), log.skipped_lines) == (1, 1)


def test_a_last_line_cut_off_is_a_warning(write: Write) -> None:
    log = read_log(write(laser(1.0, readings(0)), laser(2.0, readings(1))[:200], end=""))
    assert len(log) == 1
    assert any("last line is cut off" in warning for warning in log.warnings)


def test_without_a_scan_the_interfaces_are_named(write: Write) -> None:
    with pytest.raises(LogError, match="no scan; the log holds 1 of position:0, expected those of a laser"):
        read_log(write(position(1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(LogError, match="two beams or more"):
        read_log(write(laser(1.0, [2.0])))


def test_the_format_is_told_by_any_of_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "robot.log.gz"
    path.write_bytes(gzip.compress("\n".join(laser(k, readings(k)) for k in range(3)).encode()))
    log = read_log(path)
    assert len(log) == 3
    assert "laser:0 of robot:6665, 3 scans" in str(describe_log(log))
    assert not is_player(b"FLASER 2 1.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n")


@given(st.lists(st.text(st.characters(codec="ascii"), max_size=60), max_size=5), st.randoms(use_true_random=False))
def test_no_text_trips_the_reader(tmp_path_factory: pytest.TempPathFactory, texts: list[str], random: Random) -> None:
    sound = [
        position2(1.0, 1.0, 2.0, 0.5),
        laser2(1.0, readings(0, 3)),
        laser(1.0, readings(0, 3)),
        head2(1.0, "ranger", "001 001") + " 0002 1.0 2.0",
        head2(0.0, "ranger", "004 005") + " -1 1 0.01 0.02 5.0 0.001 10.0",
    ]
    lines = [line[: random.randint(0, len(line))] + text for line, text in zip(sound, texts, strict=False)]
    path = tmp_path_factory.mktemp("player") / "x.log"
    path.write_text("\n".join([*sound, *lines, ""]))
    with suppress(LogError):
        read_player(path)
    assert len(read_player(path, skip_bad_lines=True)) >= 1

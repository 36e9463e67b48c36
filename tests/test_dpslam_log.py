"""DP-SLAM's own log format: both messages, every kind of damage, and the way back."""

import dataclasses
import gzip
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from frontends.logs import READERS, LogError, read_log
from frontends.logs.dpslam import read_dpslam, write_dpslam
from frontends.scan import Log, ScanGeometry

Write = Callable[..., Path]


def odometry(x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> str:
    return f"Odometry {x:.6f} {y:.6f} {heading:.6f} "


def laser(ranges: Sequence[float]) -> str:
    return f"Laser {len(ranges)} " + " ".join(f"{value:.6f}" for value in ranges)


def room(n_beams: int, seed: int = 0) -> list[float]:
    return list(np.round(np.random.default_rng(seed).uniform(1.0, 7.9, n_beams), 3))


def scans(n: int) -> list[str]:
    return [line for k in range(n) for line in (odometry(float(k), 0.5, 0.1), laser(room(181, k)))]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_lines(*lines: str, end: str = "\n") -> Path:
        path = tmp_path / "robot.log"
        path.write_text("\n".join(lines) + end)
        return path

    return write_lines


def test_reads_scans_with_the_pose_before_each(write: Write) -> None:
    log = read_dpslam(write(*scans(3)))
    assert len(log) == 3
    assert_array_equal(log.ranges[2], np.array(room(181, 2), dtype=np.float32))
    assert_allclose(log.odometry, [[0, 0.5, 0.1], [1, 0.5, 0.1], [2, 0.5, 0.1]])
    assert_allclose(np.degrees(log.geometry.bearings), np.arange(-90, 91), atol=1e-9)
    assert_allclose(log.stamps, [0, 1, 2])
    assert log.has_odometry
    assert log.message_counts == {"Laser": 3, "Odometry": 3}
    assert any("no stamps" in warning for warning in log.warnings)


def test_keywords_in_capitals_comments_blank_lines_and_other_ends_of_line(write: Write) -> None:
    path = write("# a comment", "", odometry(1, 2, 0.5).upper() + "\r", laser(room(181)).upper() + "\r")
    log = read_log(path)
    assert len(log) == 1
    assert_allclose(log.odometry, [[1, 2, 0.5]])


def test_is_told_by_its_content_beside_the_other_formats(write: Write) -> None:
    path = write(*scans(2))
    assert [name for name, reader in READERS.items() if reader.recognises(path.read_bytes())] == ["dpslam"]
    assert_array_equal(read_log(path).ranges, read_dpslam(path).ranges)


def test_compressed_log_is_read_and_a_cut_off_one_is_a_warning(write: Write, tmp_path: Path) -> None:
    plain = write(*scans(40))
    packed = tmp_path / "robot.log.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert_array_equal(read_log(packed).ranges, read_dpslam(plain).ranges)
    packed.write_bytes(packed.read_bytes()[:-3000])
    log = read_dpslam(packed)
    assert 0 < len(log) < 40
    assert any("compressed file is cut off" in warning for warning in log.warnings)


def test_marks_of_the_sick_in_millimetres_are_no_returns(write: Write) -> None:
    readings = [8.183, 8.183001, 8.187, 8.190999, 8.191, 8.178, *room(175)]
    log = read_dpslam(write(odometry(), laser(readings), odometry(1), laser(room(181))))
    assert_array_equal(np.flatnonzero(np.isnan(log.ranges[0])), [0, 1, 2, 3, 4])
    assert log.geometry.range_max == pytest.approx(8.178)


def test_usable_range_and_mount_can_be_set(write: Write) -> None:
    log = read_dpslam(write(*scans(2)), range_min=2.0, range_max=5.0, T_robot_laser=(0.16, 0.0, 0.0))
    assert np.nanmin(log.ranges) >= 2.0
    assert np.nanmax(log.ranges) <= 5.0
    assert_allclose(log.geometry.T_robot_laser, [0.16, 0, 0])
    assert not any("where the laser sits" in warning for warning in log.warnings)


def test_mount_of_the_authors_robot_is_assumed_and_said(write: Write) -> None:
    log = read_dpslam(write(*scans(2)))
    assert_allclose(log.geometry.T_robot_laser, [0.4, 0, 0])
    assert any("does not say where the laser sits: 0.4 m ahead" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Odometry 1 2", "found the end of the line, expected number 3 of 3 of the pose 'x y θ'"),
        ("Odometry 1 2 3 4", "found '4' after the pose, expected the end of the line"),
        (
            "Odometry 1 nan 3",
            (
                "found the pose 1.0 nan 3.0, expected a finite pose within 1e+07 m of the origin, its heading within "
                "1e+06 rad"
            ),
        ),
        ("Laser", "found the end of the line, expected the number of readings"),
        ("Laser 1.5 2 3", "found 1.5 readings, expected a whole number from 0 to 100000"),
        ("Laser 3 1 2", "found the end of the line, expected number 3 of 3 of the readings"),
        ("Laser 3 1 x 2", "found 'x', expected number 2 of 3 of the readings"),
        ("Laser 2 1 2 3", "found '3' after the readings, expected the end of the line"),
        ("Sonar 3 1 2 3", "found 'Sonar', expected Odometry, Laser or a comment with #"),
    ],
)
def test_malformed_line_is_named_with_its_place_or_passed_over(write: Write, line: str, message: str) -> None:
    path = write(*scans(1), line, *scans(1))
    with pytest.raises(LogError) as caught:
        read_dpslam(path)
    assert str(caught.value) == f"{path}:3: {message}"
    log = read_dpslam(path, skip_bad_lines=True)
    assert len(log) == 2
    assert log.skipped_lines == 1
    assert f":3: {message}" in log.warnings[0]


def test_scan_whose_odometry_is_missing_is_no_scan(write: Write) -> None:
    path = write(*scans(1), laser(room(181, 5)), *scans(1))
    with pytest.raises(LogError, match=r":3: found a Laser line without an Odometry line of its own"):
        read_dpslam(path)
    assert len(read_dpslam(path, skip_bad_lines=True)) == 2


def test_log_without_any_odometry_says_so(write: Write) -> None:
    log = read_dpslam(write(*(laser(room(181, k)) for k in range(4))))
    assert not log.has_odometry
    assert_array_equal(log.odometry, np.zeros((4, 3)))


def test_cut_off_last_line_is_a_warning(write: Write) -> None:
    log = read_dpslam(write(*scans(2), odometry(2), laser(room(181))[:-3], end=""))
    assert len(log) == 2
    assert "the last line is cut off" in log.warnings[0]


def test_changing_beams_are_placed_on_the_usual_ones(write: Write) -> None:
    log = read_dpslam(write(*scans(2), odometry(2), laser(room(180, 9))))
    assert log.ranges.shape == (3, 181)
    assert_array_equal(log.ranges[2, :180], np.array(room(180, 9), dtype=np.float32))
    assert np.isnan(log.ranges[2, 180])
    assert any("the beams change: 1 scans with 180" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ((), "the log is empty"),
        ((odometry(), odometry(1)), "no Laser line found, only 2 Odometry lines"),
        ((odometry(), "Laser 1 2.5"), "no Laser line has two readings or more"),
    ],
)
def test_log_without_scans(write: Write, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(LogError, match=message):
        read_log(write(*lines))


@settings(max_examples=25)
@given(
    ranges=st.lists(
        st.lists(st.one_of(st.none(), st.integers(20, 7900)), min_size=181, max_size=181), min_size=1, max_size=3
    ),
    pose=st.tuples(*(st.integers(-3_000_000, 3_000_000),) * 3),
    packed=st.booleans(),
)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    ranges: list[list[int | None]],
    pose: tuple[int, int, int],
    packed: bool,
) -> None:
    metres = np.array([[np.nan if r is None else r / 1000 for r in row] for row in ranges], dtype=np.float32)
    metres[0, 0] = 7.9
    log = Log(
        ranges=metres,
        odometry=np.array([[pose[0] / 1e6 + k, pose[1] / 1e6, pose[2] / 1e6] for k in range(len(metres))]),
        stamps=np.arange(len(metres), dtype=np.float64),
        geometry=ScanGeometry(bearings=np.radians(np.arange(-90.0, 91.0)), range_min=0.02, range_max=7.9),
        path=Path("robot.log"),
    )
    path = tmp_path_factory.mktemp("logs") / ("robot.log.gz" if packed else "robot.log")
    write_dpslam(path, log)
    back = read_log(path)
    assert_allclose(back.ranges, log.ranges, rtol=1e-6)
    assert_allclose(back.odometry, log.odometry, atol=1e-6)
    again = path.with_name(f"again{path.suffix}")
    write_dpslam(again, back)
    assert again.read_bytes() == path.read_bytes()


def test_beams_that_the_format_cannot_tell_are_refused(tmp_path: Path) -> None:
    geometry = ScanGeometry(bearings=np.radians(np.linspace(-60.0, 60.0, 181)), range_min=0.02, range_max=7.9)
    log = Log(
        ranges=np.ones((1, 181), dtype=np.float32),
        odometry=np.zeros((1, 3)),
        stamps=np.zeros(1),
        geometry=geometry,
        path=Path("robot.log"),
    )
    with pytest.raises(LogError, match=r"found beams from -60° to 60°, expected -90° to 90°"):
        write_dpslam(tmp_path / "robot.log", log)
    assert not list(tmp_path.iterdir())
    with pytest.raises(LogError, match="cannot be written"):
        write_dpslam(
            tmp_path / "none" / "robot.log",
            dataclasses.replace(
                log, geometry=dataclasses.replace(geometry, bearings=np.radians(np.arange(-90.0, 91.0)))
            ),
        )


def test_reads_the_public_log(data_dir: Path) -> None:
    log = read_log(data_dir / "dpslam-loop5.log.gz")
    assert log.ranges.shape == (551, 181)
    assert log.message_counts == {"Laser": 551, "Odometry": 551}
    assert 8.0 < log.geometry.range_max < 8.1825
    assert_allclose(log.odometry[0], [-2.424026, 4.800517, 2.590948])
    assert 0.05 < np.isnan(log.ranges).mean() < 0.08


def test_the_only_laser_is_the_front_one(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("Odometry 0 0 0\nLaser 3 1 1 1\n")
    with pytest.raises(LogError, match="no laser is called 'rear'"):
        read_log(path, laser="rear")

"""USARSim logs: every message, every kind of damage, frames, and what is written read back."""

import gzip
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.logs import READERS, LogError, describe_log, read_log
from frontends.logs.carmen import write_carmen
from frontends.logs.usarsim import read_usarsim, write_usarsim
from frontends.scan import Log, ScanGeometry
from frontends.simulator.output import write_simulation
from frontends.simulator.simulation import Simulation, simulate

Write = Callable[..., Path]
Pose = tuple[float, float, float]

room_drive = cache(lambda: simulate("room", 3))


def sweep(ranges: Sequence[float], *, time: float | None = None, name: str = "Scanner1", fov: float = 3.1415) -> str:
    at = "" if time is None else f"{{Time {time}}} "
    return (
        f"SEN {at}{{Type RangeScanner}} {{Name {name}}} {{Resolution 0.0174}} {{FOV {fov}}} {{Range {joined(ranges)}}}"
    )


def joined(values: Sequence[float]) -> str:
    return ",".join(f"{value:.4f}" for value in values)


def odometry(x: float, y: float, heading: float, time: float | None = None) -> str:
    at = "" if time is None else f"{{Time {time}}} "
    return f"SEN {at}{{Type Odometry}} {{Name Odometry}} {{Pose {x},{y},{heading}}}"


def located(kind: str, x: float, y: float, heading: float, time: float | None = None) -> str:
    at = "" if time is None else f"{{Time {time}}} "
    return f"SEN {at}{{Type {kind}}} {{Name {kind}}} {{Location {x},{y},0.1}} {{Orientation 0.0,0.0,{heading}}}"


def room(n_beams: int = 181, seed: int = 0) -> list[float]:
    return list(np.round(np.random.default_rng(seed).uniform(1.0, 9.0, n_beams), 3))


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_lines(*lines: str, end: str = "\r\n") -> Path:
        path = tmp_path / "robot.usarsim"
        path.write_bytes(("\r\n".join(lines) + end).encode())
        return path

    return write_lines


def test_reads_a_scan_with_its_time_and_odometry_turned_into_our_frame(write: Write) -> None:
    readings = room()
    log = read_usarsim(write(odometry(1.0, 2.0, 0.5, 6.0), sweep(readings, time=6.0)))
    assert_array_equal(log.ranges, np.array([readings], dtype=np.float32))
    assert_allclose(log.odometry, [[1.0, -2.0, -0.5]])
    assert_allclose(log.stamps, [6.0])
    assert log.has_odometry
    assert log.truth is None
    assert log.message_counts == {"SEN Odometry": 1, "SEN RangeScanner": 1}


def test_the_step_is_the_field_of_view_by_the_beams_whatever_the_resolution_says(write: Write) -> None:
    bearings = read_usarsim(write(sweep(room()))).geometry.bearings
    assert_allclose(np.degrees(bearings), np.arange(-90, 91), atol=1e-9)
    narrow = read_usarsim(write(sweep(room(91), fov=2.0))).geometry.bearings
    assert_allclose(narrow, np.linspace(-1.0, 1.0, 91), atol=1e-9)


def test_a_field_of_view_in_degrees_is_told_by_its_size(write: Write) -> None:
    log = read_usarsim(write(sweep(room(91), fov=240.0)))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-120, 120, 91), atol=1e-9)
    assert any("degrees" in warning for warning in log.warnings)


def test_keys_come_in_any_order_and_case_and_several_in_a_brace(write: Write) -> None:
    readings = room()
    line = f"sen  {{RANGE {joined(readings)}}}{{fov 3.1415}} {{name Scanner1 type rangescanner Time 4.5}}"
    pose = "Sen {pose 1.0, 2.0,  0.25} {Name Odometry Type ODOMETRY TIME 4.5}"
    log = read_usarsim(write(pose, line))
    assert_array_equal(log.ranges, np.array([readings], dtype=np.float32))
    assert_allclose(log.odometry, [[1.0, -2.0, -0.25]])
    assert_allclose(log.stamps, [4.5])


def test_numbers_may_be_parted_by_blanks(write: Write) -> None:
    readings = room()
    line = "SEN {Type RangeScanner} {Name S FOV 3.1415 Range " + " ".join(map(str, readings)) + "}"
    assert_array_equal(read_usarsim(write(line)).ranges, np.array([readings], dtype=np.float32))


TWO_LASERS = """GEO {Type RangeScanner} {Name Rear Location 9,9,9 Orientation 0,0,0 Mount HARD} \
{Name Scanner1 Location 0.144,0.1,-0.09 Orientation 0.0,0.0,0.2 Mount HARD}"""


@pytest.mark.parametrize(
    "geometry",
    [
        "GEO {Type RangeScanner} {Name Scanner1 Location 0.144,0.1,-0.09 Orientation 0.0,0.0,0.2 Mount HARD}",
        TWO_LASERS,
        "GEO {Type RangeScanner} {Orientation 0.0,0.0,0.2} {Location 0.144,0.1,-0.09} {Name Scanner1} {Mount HARD}",
    ],
)
def test_geo_says_where_the_laser_sits(write: Write, geometry: str) -> None:
    log = read_usarsim(write(geometry, sweep(room())))
    assert_allclose(log.geometry.T_robot_laser, [0.144, -0.1, -0.2])
    assert not any("robot's centre" in warning for warning in log.warnings)


def test_without_geo_the_laser_sits_at_the_centre_and_that_is_said(write: Write) -> None:
    log = read_usarsim(write(sweep(room())))
    assert_array_equal(log.geometry.T_robot_laser, [0.0, 0.0, 0.0])
    assert any("where the laser sits" in warning for warning in log.warnings)


def test_a_laser_that_hangs_upside_down_has_its_beams_put_in_order(write: Write) -> None:
    readings = room()
    geometry = "GEO {Type RangeScanner} {Name Scanner1 Location 0,0,0 Orientation 3.1416,0,0 Mount HARD}"
    log = read_usarsim(write(geometry, sweep(readings)))
    assert_array_equal(log.ranges[0], np.array(readings[::-1], dtype=np.float32))
    assert any("upside down" in warning for warning in log.warnings)


def test_a_laser_on_something_that_moves_is_a_warning(write: Write) -> None:
    geometry = "GEO {Type RangeScanner} {Name Scanner1 Location 0,0,0 Orientation 0,0,0 Mount TiltUnit}"
    assert any("'TiltUnit'" in warning for warning in read_usarsim(write(geometry, sweep(room()))).warnings)


def test_conf_limits_the_range(write: Write) -> None:
    readings = room()
    readings[:4] = [20.0, 20.5, 0.05, 0.15]
    limits = "CONF {Type RangeScanner} {Name Scanner1} {MaxRange 20.0000} {MinRange 0.1000} {Fov 3.1415} {Paning True}"
    log = read_usarsim(write(limits, sweep(readings)))
    assert (log.geometry.range_min, log.geometry.range_max) == (0.1, 20.0)
    assert_array_equal(np.isnan(log.ranges[0, :5]), [True, True, True, False, False])
    mine = read_usarsim(write(limits, sweep(readings)), range_min=0.2, range_max=5.0)
    assert (mine.geometry.range_min, mine.geometry.range_max) == (0.2, 5.0)
    assert np.nanmax(mine.ranges) <= 5.0
    assert np.isnan(mine.ranges[0, 3])


def test_conf_gives_the_field_of_view_where_the_scans_do_not(write: Write) -> None:
    limits = "CONF {Type RangeScanner} {Name S} {Fov 2.0}"
    log = read_usarsim(write(limits, f"SEN {{Type RangeScanner}} {{Name S}} {{Range {joined(room(51))}}}"))
    assert_allclose(log.geometry.bearings, np.linspace(-1.0, 1.0, 51), atol=1e-9)


def test_without_conf_a_limit_of_so_many_metres_sharp_is_recognised(write: Write) -> None:
    readings = room()
    readings[:6] = [20.0] * 6
    readings[6] = 19.97
    log = read_usarsim(write(sweep(readings)))
    assert_array_equal(np.isnan(log.ranges[0, :8]), [True] * 6 + [False] * 2)


def test_values_that_are_no_returns_never_become_points(write: Write) -> None:
    readings = joined(room())
    line = sweep(room()).replace(readings, "nan,inf,-1,0," + ",".join(readings.split(",")[4:]))
    log = read_usarsim(write(line))
    assert_array_equal(np.isnan(log.ranges[0, :5]), [True] * 4 + [False])


def test_ins_stands_in_for_odometry(write: Write) -> None:
    lines = [line for k in range(3) for line in (located("INS", 0.1 * k, 0.2, 0.3, k), sweep(room(seed=k), time=k))]
    log = read_usarsim(write(*lines))
    assert_allclose(log.odometry, [[0.0, -0.2, -0.3], [0.1, -0.2, -0.3], [0.2, -0.2, -0.3]])
    assert any("INS is taken" in warning for warning in log.warnings)


def test_odometry_that_stands_still_makes_way_for_ins(write: Write) -> None:
    lines = [
        line
        for k in range(4)
        for line in (odometry(0, 0, 0, k), located("INS", 0.1 * k, 0, 0, k), sweep(room(seed=k), time=k))
    ]
    assert_allclose(read_usarsim(write(*lines)).odometry[:, 0], [0.0, 0.1, 0.2, 0.3])


def test_ground_truth_is_kept_and_never_taken_for_odometry(write: Write) -> None:
    lines = [line for k in range(3) for line in (located("GroundTruth", k, 1, 0, k), sweep(room(seed=k), time=k))]
    log = read_usarsim(write(*lines))
    assert log.truth is not None
    assert_allclose(log.truth, [[0, -1, 0], [1, -1, 0], [2, -1, 0]])
    assert not log.has_odometry
    assert_array_equal(log.odometry, np.zeros((3, 3)))
    assert any("not taken for odometry" in warning for warning in log.warnings)


def test_a_log_without_any_pose_says_so(write: Write) -> None:
    log = read_usarsim(write(sweep(room())))
    assert not log.has_odometry
    assert log.truth is None
    assert "there is no odometry" in log.warnings


def test_poses_between_two_messages_by_time(write: Write) -> None:
    lines = [odometry(0, 0, 3.0, 10.0), sweep(room(), time=10.25), odometry(1, 2, -3.0, 11.0), sweep(room(), time=12.0)]
    log = read_usarsim(write(*lines))
    turn = 2 * math.pi - 6.0
    assert_allclose(log.odometry[0], [0.25, -0.5, -(3.0 + 0.25 * turn)], atol=1e-12)
    assert_allclose(log.odometry[1], [1.0, -2.0, 3.0])


def test_a_pose_of_the_same_time_counts_though_it_follows(write: Write) -> None:
    lines = [odometry(0, 0, 0, 1.0), sweep(room(), time=2.0), odometry(1, 0, 0, 2.0), sweep(room(seed=1), time=3.0)]
    assert_allclose(read_usarsim(write(*lines)).odometry[0], [1, 0, 0])


def test_without_times_the_pose_before_counts_where_they_alternate(write: Write) -> None:
    lines = [line for k in range(5) for line in (odometry(k, 0, 0), sweep(room(seed=k)))]
    assert_allclose(read_usarsim(write(*lines)).odometry[:, 0], range(5))


def test_without_times_scans_share_the_way_between_poses_where_they_do_not(write: Write) -> None:
    lines = [odometry(0, 0, 0), *(sweep(room(seed=k)) for k in range(3)), odometry(4, 0, 0)]
    assert_allclose(read_usarsim(write(*lines)).odometry[:, 0], [1, 2, 3])


@pytest.mark.parametrize("right_handed", [False, True])
def test_the_side_of_the_headings_is_found_in_the_scans(write: Write, right_handed: bool) -> None:
    drive = room_drive()
    log = drive.log
    signs = np.array([1.0, 1.0, 1.0] if right_handed else [1.0, -1.0, -1.0])
    lines = []
    for index in range(0, len(log), 1):
        x, y, heading = (drive.truth[index] * signs).tolist()
        lines += [odometry(x, y, heading), sweep(np.nan_to_num(log.ranges[index], nan=20.0).tolist())]
    read = read_usarsim(write(*lines))
    assert_allclose(read.odometry, drive.truth, atol=1e-12)
    assert any("as they stand" in warning for warning in read.warnings) == right_handed
    assert not any("do not tell" in warning for warning in read.warnings)


def test_a_side_that_cannot_be_told_is_said_and_the_simulators_own_assumed(write: Write) -> None:
    lines = [line for k in range(5) for line in (odometry(k, 0.5, 0.001 * k, k), sweep(room(seed=k), time=k))]
    log = read_usarsim(write(*lines))
    assert_allclose(log.odometry[:, 1], -0.5)
    assert any("do not tell" in warning for warning in log.warnings)


def test_scans_without_time_take_the_latest_of_any_message(write: Write) -> None:
    log = read_usarsim(write("STA {Time 3.5} {Battery 99}", sweep(room()), "STA {Time 4.0}", sweep(room(seed=1))))
    assert_allclose(log.stamps, [3.5, 4.0])
    assert log.message_counts == {"STA": 2, "SEN RangeScanner": 2}


def test_of_several_lasers_the_one_with_most_scans_or_the_one_named(write: Write) -> None:
    lines = [sweep(room(seed=k), name=name) for k, name in enumerate(["Small", "Big", "Big"])]
    assert len(read_usarsim(write(*lines))) == 2
    assert any("several range scanners" in warning for warning in read_usarsim(write(*lines)).warnings)
    assert len(read_usarsim(write(*lines), laser="small")) == 1
    with pytest.raises(LogError, match=r"'Third'.*Small, Big"):
        read_usarsim(write(*lines), laser="Third")


def test_scans_with_other_beams_are_placed_on_the_usual_bearings(write: Write) -> None:
    few = room(91, seed=5)
    log = read_usarsim(write(sweep(room()), sweep(room(seed=1)), sweep(few, fov=math.pi)))
    assert log.ranges.shape == (3, 181)
    assert_array_equal(log.ranges[2, ::2], np.array(few, dtype=np.float32))
    assert any("beams change" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("line", "found", "expected"),
    [
        ("SEN {Time 1.0} {Type RangeScanner", "'{Type RangeScanner'", "'}'"),
        ("SEN {Time 1.0} x {Type RangeScanner}", "'{Time 1.0} x", "'}'"),
        ("SEN {Time 1.0} {Name Scanner1}", "without {Type}", "type"),
        ("SEN {Type RangeScanner} {Name S}", "no {range}", "SEN message"),
        ("SEN {Type RangeScanner} {Range 1.0,2.0,x}", "'x'", "number 3 of 3"),
        ("SEN {Type RangeScanner} {FOV wide} {Range 1,2}", "'wide'", "fov"),
        ("SEN {Type Odometry} {Name O}", "no {location}", "odometry"),
        ("SEN {Type Odometry} {Pose 1,2}", "2 numbers", "3"),
        ("SEN {Type Odometry} {Pose 1,2,nan}", "nan", "finite"),
        ("SEN {Type INS} {Location 1,2,3}", "no {orientation}", "INS"),
        ("SEN {Time soon} {Type INS}", "'soon'", "time"),
        ("GEO {Type RangeScanner} {Name S Location 1,2 Orientation 0,0,0}", "2 numbers", "3"),
        ("1234 {Type INS}", "'1234 {Type INS}'", "SEN {Type"),
        ("no message at all", "'no message at all'", "SEN {Type"),
    ],
)
def test_a_malformed_line_is_named_or_passed_over(write: Write, line: str, found: str, expected: str) -> None:
    path = write(sweep(room()), line, sweep(room(seed=1)))
    with pytest.raises(LogError) as caught:
        read_usarsim(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:2: found ")
    what, want = message.split(", expected ")
    assert found in what
    assert expected.lower() in want.lower()
    log = read_usarsim(path, skip_bad_lines=True)
    assert len(log) == 2
    assert log.skipped_lines == 1
    assert any("1 malformed line" in warning for warning in log.warnings)


def test_a_last_line_that_was_cut_off_is_a_warning(write: Write) -> None:
    whole = sweep(room(seed=1))
    for kept in (5, 30, 80, len(whole) - 1):
        log = read_usarsim(write(sweep(room()), whole[:kept], end=""))
        assert len(log) == 1
        assert any("cut off" in warning for warning in log.warnings)
    assert len(read_usarsim(write(sweep(room()), whole, end=""))) == 2


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ((), "empty"),
        (("# nothing", "STA {Time 1.0}"), "no scan; the log holds 1 STA"),
        ((odometry(0, 0, 0),), "1 SEN Odometry"),
        (("SEN {Type RangeScanner} {Range 1.0}",), "two beams"),
    ],
)
def test_a_log_without_scans_is_an_error_that_says_what_there_is(
    write: Write, lines: tuple[str, ...], said: str
) -> None:
    with pytest.raises(LogError, match=said):
        read_log(write(*lines))


def test_the_format_is_told_by_the_content_and_packed_logs_are_read(write: Write, tmp_path: Path) -> None:
    path = write("# a comment", sweep(room()))
    packed = tmp_path / "robot.log.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert len(read_log(packed)) == 1
    assert not READERS["usarsim"].recognises(b"FLASER 2 1.0 1.0 0 0 0 0 0 0 1 host 1\n")
    assert not READERS["carmen"].recognises(path.read_bytes())


def test_a_simulation_reads_back_from_both_its_logs_to_the_last_bit(tmp_path: Path) -> None:
    simulation = room_drive()
    write_simulation(tmp_path, simulation)
    log, other = read_log(tmp_path / "log.usarsim"), read_log(tmp_path / "log.clf")
    _assert_same(log, replace(simulation.log, truth=simulation.truth))
    assert log.warnings == ()
    assert_array_equal(log.ranges, other.ranges)
    assert_allclose(log.odometry, other.odometry, atol=1e-6)
    assert "SEN GroundTruth" in str(describe_log(log))


def test_the_same_log_gives_the_same_bytes_plain_and_packed(tmp_path: Path) -> None:
    log = _part(room_drive(), 20)
    for name in ("a.usarsim", "b.usarsim", "a.usarsim.gz", "b.usarsim.gz"):
        write_usarsim(tmp_path / name, log)
    assert (tmp_path / "a.usarsim").read_bytes() == (tmp_path / "b.usarsim").read_bytes()
    assert (tmp_path / "a.usarsim.gz").read_bytes() == (tmp_path / "b.usarsim.gz").read_bytes()
    assert gzip.decompress((tmp_path / "a.usarsim.gz").read_bytes()) == (tmp_path / "a.usarsim").read_bytes()
    assert len(list(tmp_path.iterdir())) == 4


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    log = _part(room_drive(), 3)
    uneven = replace(log.geometry, bearings=np.sort(np.random.default_rng(0).uniform(-1.5, 1.5, 181)))
    with pytest.raises(LogError, match="unevenly spread"):
        write_usarsim(tmp_path / "log.usarsim", replace(log, geometry=uneven))
    with pytest.raises(LogError, match="cannot be written"):
        write_usarsim(tmp_path / "missing" / "log.usarsim", log)


numbers = st.floats(-1e4, 1e4, allow_subnormal=False)
headings = st.floats(-math.pi, math.pi, exclude_min=True, allow_subnormal=False)
places = st.floats(-300, 300, allow_subnormal=False)
poses = st.tuples(places, places, headings)


@st.composite
def logs(draw: st.DrawFn) -> Log:
    n_scans, n_beams = draw(st.integers(1, 5)), draw(st.integers(2, 12))
    reading = st.just(math.nan) | st.floats(0.125, 80, width=32)
    ranges = np.array(draw(st.lists(reading, min_size=n_scans * n_beams, max_size=n_scans * n_beams)), np.float32)
    first, view = draw(st.floats(-2, 0)), draw(st.floats(0.1, 4))
    rows = st.lists(poses, min_size=n_scans, max_size=n_scans)
    return Log(
        ranges=ranges.reshape(n_scans, n_beams),
        odometry=np.array(draw(rows)),
        stamps=np.array(draw(st.lists(numbers, min_size=n_scans, max_size=n_scans))),
        geometry=ScanGeometry(
            bearings=np.linspace(first, first + view, n_beams),
            range_min=draw(st.floats(0, 0.125)),
            range_max=draw(st.floats(80.5, 100)),
            T_robot_laser=np.array(draw(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)))),
        ),
        path=Path("drawn.usarsim"),
        has_odometry=draw(st.booleans()),
        truth=np.array(draw(rows)) if draw(st.booleans()) else None,
    )


@given(log=logs())
@settings(max_examples=60)
def test_whatever_is_written_reads_back(log: Log, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("logs") / "log.usarsim"
    write_usarsim(path, log)
    back = read_usarsim(path)
    assert_array_equal(back.ranges, log.ranges)
    assert_array_equal(back.stamps, log.stamps)
    assert (back.geometry.range_min, back.geometry.range_max) == (log.geometry.range_min, log.geometry.range_max)
    assert_allclose(_beams(back.geometry), _beams(log.geometry), atol=1e-9)
    assert_array_equal(back.geometry.T_robot_laser[:2], log.geometry.T_robot_laser[:2])
    if log.truth is None:
        assert back.truth is None
    else:
        assert back.truth is not None
        assert_array_equal(back.truth, log.truth + 0.0)
    moves = len(log) > 1 and float(np.ptp(log.odometry, axis=0).max()) > 1e-6
    if log.has_odometry and moves:
        assert back.has_odometry
        assert_array_equal(back.odometry, log.odometry + 0.0)


@given(log=logs())
@settings(max_examples=30)
def test_a_reading_as_long_as_the_range_survives_too(log: Log, tmp_path_factory: pytest.TempPathFactory) -> None:
    longest = float(np.fmax.reduce(log.ranges, axis=None, initial=1.0))
    tight = replace(log, geometry=replace(log.geometry, range_max=longest))
    path = tmp_path_factory.mktemp("logs") / "log.usarsim"
    write_usarsim(path, tight)
    assert_array_equal(read_usarsim(path).ranges, log.ranges)


@given(log=logs())
@settings(max_examples=30)
def test_carmen_keeps_what_its_decimals_can(log: Log, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("logs") / "log.clf"
    rounded = replace(log, ranges=np.round(log.ranges, 3))
    write_carmen(path, rounded)
    back = read_log(path, log_format="carmen", range_min=0.0, range_max=81.0)
    assert_array_equal(np.isnan(back.ranges), np.isnan(rounded.ranges))
    assert_allclose(back.ranges, rounded.ranges, atol=1e-3)
    assert_allclose(back.stamps, rounded.stamps, atol=1e-6)


@given(
    text=st.text(alphabet="SEN GOCF{}TypeRangScw,.0123456789-nif\n", max_size=300)
    | st.lists(st.sampled_from([sweep(room(5)), odometry(1, 2, 3, 4), "GEO {", "SEN {Type INS}", "{Range 1,2}"])).map(
        "\n".join
    )
)
def test_any_text_is_a_log_or_a_log_error(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("logs") / "log.usarsim"
    path.write_text(text)
    for skip in (False, True):
        with suppress(LogError):
            assert len(read_usarsim(path, skip_bad_lines=skip)) > 0


def test_scan_pairs_of_the_real_simulator(data_dir: Path) -> None:
    log = read_log(data_dir / "usarsim-scan-pairs.txt.gz")
    assert log.ranges.shape == (378, 181)
    assert_allclose(np.degrees(log.geometry.bearings), np.arange(-90, 91), atol=1e-9)
    assert log.message_counts == {"SEN EST": 189, "SEN INS": 189, "SEN RangeScanner": 378}
    assert np.isnan(log.ranges).sum() == 226
    assert any("all stamps are 6.62 s" in warning for warning in log.warnings)
    assert_array_equal(log.ranges[0], log.ranges[2])


def _part(simulation: Simulation, n: int) -> Log:
    log = simulation.log
    return replace(
        log, ranges=log.ranges[:n], odometry=log.odometry[:n], stamps=log.stamps[:n], truth=simulation.truth[:n]
    )


def _beams(geometry: ScanGeometry) -> NDArray[np.float64]:
    return geometry.directions_robot


def _assert_same(log: Log, other: Log) -> None:
    assert_array_equal(log.ranges, other.ranges)
    assert_array_equal(log.odometry, other.odometry)
    assert_array_equal(log.stamps, other.stamps)
    assert log.truth is not None
    assert other.truth is not None
    assert_array_equal(log.truth, other.truth)
    assert_array_equal(log.geometry.T_robot_laser, other.geometry.T_robot_laser)
    assert (log.geometry.range_min, log.geometry.range_max) == (other.geometry.range_min, other.geometry.range_max)

"""CARMEN logs: every message, every kind of damage, and what is derived from a log."""

import math
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from frontends.logs import LogError, read_log
from frontends.logs.carmen import read_carmen

Pose = tuple[float, float, float]


def joined(values: Sequence[float]) -> str:
    return " ".join(f"{value:.6f}" for value in values)


def flaser(
    ranges: Sequence[float],
    robot: Pose = (0.0, 0.0, 0.0),
    laser: Pose | None = None,
    stamp: float = 100.0,
    name: str = "FLASER",
    logger: float = 0.0,
) -> str:
    poses = joined([*(robot if laser is None else laser), *robot])
    return f"{name} {len(ranges)} {joined(ranges)} {poses} {stamp:.6f} host {logger:.6f}"


def described(ranges: Sequence[float], start: float, view: float, step: float, range_max: float) -> str:
    return f"99 {start:.6f} {view:.6f} {step:.6f} {range_max:.6f} 0.01 0 {len(ranges)} {joined(ranges)}"


def robotlaser(
    ranges: Sequence[float],
    robot: Pose = (0.0, 0.0, 0.0),
    *,
    start: float = -math.pi / 2,
    view: float = math.pi,
    step: float = math.radians(1.0),
    range_max: float = 81.9,
    name: str = "ROBOTLASER1",
    remissions: Sequence[float] = (),
) -> str:
    head = described(ranges, start, view, step, range_max)
    seen = " ".join([str(len(remissions)), *map(str, remissions)])
    return f"{name} {head} {seen} {joined([*robot, *robot])} 0.1 0.2 0.5 0.3 1e+06 100.5 host 0.5"


def rawlaser(ranges: Sequence[float], *, stamp: float = 1.0, name: str = "RAWLASER1") -> str:
    return f"{name} {described(ranges, -math.pi / 2, math.pi, math.radians(1.0), 81.9)} 0 {stamp} host {stamp}"


def odom(x: float, y: float, heading: float) -> str:
    return f"ODOM {x} {y} {heading} 0.1 0.0 0.0 5.0 host 5.0"


def room(n_beams: int, seed: int = 0) -> list[float]:
    """Readings without any repetition."""
    return list(np.round(np.random.default_rng(seed).uniform(1.0, 9.0, n_beams), 3))


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def write_lines(*lines: str, end: str = "\n") -> Path:
        path = tmp_path / "robot.clf"
        path.write_text("\n".join(lines) + end)
        return path

    return write_lines


Write = Callable[..., Path]


def test_reads_one_scan_with_all_that_belongs_to_it(write: Write) -> None:
    readings = room(181)
    log = read_carmen(write(flaser(readings, robot=(1.0, 2.0, 0.5), stamp=12.25)))
    assert len(log) == 1
    assert_array_equal(log.ranges, np.array([readings], dtype=np.float32))
    assert_allclose(log.odometry, [[1.0, 2.0, 0.5]])
    assert_allclose(log.stamps, [12.25])
    assert_allclose(log.geometry.T_robot_laser, 0.0)
    assert log.has_odometry
    assert log.warnings == ()
    assert log.message_counts == {"FLASER": 1}


@pytest.mark.parametrize(
    ("n_beams", "first", "last"), [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (1081, -135, 135)]
)
def test_bearings_follow_from_the_number_of_beams(write: Write, n_beams: int, first: float, last: float) -> None:
    bearings = read_carmen(write(flaser(room(n_beams)))).geometry.bearings
    assert_allclose(np.degrees(bearings), np.linspace(first, last, n_beams), atol=1e-9)


def test_unknown_number_of_beams_spreads_over_the_half_circle_and_is_said(write: Write) -> None:
    log = read_carmen(write(flaser(room(91))))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-90, 90, 91), atol=1e-9)
    assert "no scanner with 91 beams" in log.warnings[0]


@given(st.lists(st.sampled_from(["FLASER", "ROBOTLASER1", "RLASER"]), min_size=1, max_size=12))
def test_the_fullest_message_is_used_unless_another_one_is_twice_as_frequent(names: list[str]) -> None:
    ranges = room(181)
    lines = [robotlaser(ranges) if name == "ROBOTLASER1" else flaser(ranges, name=name) for name in names]
    counts = Counter(names)
    best = next(name for name in ("ROBOTLASER1", "FLASER", "RLASER") if 2 * counts[name] >= max(counts.values()))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.clf"
        path.write_text("\n".join(lines) + "\n")
        log = read_carmen(path)
    assert len(log) == counts[best]
    assert log.message_counts == counts
    if len(counts) > 1:
        assert f"{best} is used" in log.warnings[0]


def test_parameters_describe_an_unknown_scanner(write: Write) -> None:
    parameters = ("PARAM laser_front_laser_fov 240 nohost 0", "PARAM laser_front_laser_resolution 0.5 nohost 0")
    log = read_carmen(write(*parameters, flaser(room(481))))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-120, 120, 481), atol=1e-9)
    assert log.warnings == ()


def test_robotlaser_says_its_own_beams(write: Write) -> None:
    readings = room(271)
    line = robotlaser(readings, start=-2.356194, view=4.712389, step=0.017453, remissions=[1, 2, 3])
    log = read_carmen(write(line))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-135, 135, 271), atol=0.01)
    assert_array_equal(log.ranges[0], np.array(readings, dtype=np.float32))
    assert_allclose(log.stamps, [100.5])


def test_printed_angles_of_a_known_scanner_are_made_exact(write: Write) -> None:
    log = read_carmen(write(robotlaser(room(180), start=-1.570796, view=3.141593, step=0.017453)))
    assert_allclose(np.degrees(log.geometry.bearings), np.arange(-90, 90), atol=1e-12)


def test_robotlaser_that_turns_clockwise_is_put_in_order(write: Write) -> None:
    readings = room(181)
    log = read_carmen(write(robotlaser(readings, start=math.pi / 2, step=-math.radians(1.0))))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-90, 90, 181), atol=0.01)
    assert_array_equal(log.ranges[0], np.array(readings[::-1], dtype=np.float32))


def test_step_that_contradicts_the_field_of_view_is_said(write: Write) -> None:
    log = read_carmen(write(robotlaser(room(91), step=0.0)))
    assert_allclose(np.degrees(log.geometry.bearings), np.linspace(-90, 90, 91), atol=1e-4)
    assert "does not spread 91 beams" in log.warnings[0]


def test_readings_at_the_stated_limit_are_no_returns(write: Write) -> None:
    readings = [2.0, 3.0, 29.99, 30.0, 30.0, *room(175)]
    log = read_carmen(write(robotlaser(readings, range_max=30.0)))
    assert_array_equal(np.flatnonzero(np.isnan(log.ranges[0])), [3, 4])
    assert log.geometry.range_max == pytest.approx(29.99)


def test_old_rawlaser_has_no_description(write: Write) -> None:
    readings = room(180)
    log = read_carmen(write(odom(1, 2, 0.3), f"RAWLASER1 180 {joined(readings)} 7.5 host 0.5"))
    assert_array_equal(log.ranges[0], np.array(readings, dtype=np.float32))
    assert_allclose(log.stamps, [7.5])
    assert_allclose(log.odometry, [[1, 2, 0.3]])


def test_rawlaser_takes_odometry_by_file_order(write: Write) -> None:
    scans = [rawlaser(room(181, seed), stamp=float(seed)) for seed in range(6)]
    path = write(
        scans[0],
        odom(0, 0, 3.1),
        scans[1],
        odom(1, 0, -3.1),
        scans[2],
        scans[3],
        scans[4],
        odom(5, 4, -3.1),
        scans[5],
    )
    log = read_carmen(path)
    assert_allclose(log.odometry[:, 0], [0.0, 0.5, 2.0, 3.0, 4.0, 5.0])
    assert_allclose(log.odometry[:, 1], [0.0, 0.0, 1.0, 2.0, 3.0, 4.0])
    assert abs(log.odometry[1, 2]) == pytest.approx(math.pi)
    assert_allclose(log.odometry[2:, 2], -3.1)


def test_rawlaser_without_odometry_has_none(write: Write) -> None:
    log = read_carmen(write(*(rawlaser(room(181, seed)) for seed in range(3))))
    assert not log.has_odometry
    assert_array_equal(log.odometry, np.zeros((3, 3)))
    assert any("no odometry" in warning for warning in log.warnings)
    assert any("does not say where the laser sits" in warning for warning in log.warnings)


def test_processed_messages_win_over_raw_ones_of_the_same_scans(write: Write) -> None:
    raw = [rawlaser(room(181, seed)) for seed in range(3)]
    cooked = [flaser(room(181, 10 + seed), robot=(seed, 0.0, 0.0), stamp=seed) for seed in range(3)]
    pairs = [line for pair in zip(raw, cooked, strict=True) for line in pair]
    log = read_carmen(write(*pairs))
    assert len(log) == 3
    assert_array_equal(log.ranges[0], np.array(room(181, 10), dtype=np.float32))
    assert "3 FLASER, 3 RAWLASER1): FLASER is used" in log.warnings[0]


def test_front_laser_is_used_unless_another_is_asked_for(write: Write) -> None:
    front, rear = room(181, 1), room(181, 2)
    path = write(flaser(rear, name="RLASER", laser=(-0.3, 0.0, math.pi)), flaser(front))
    log = read_carmen(path)
    assert_array_equal(log.ranges[0], np.array(front, dtype=np.float32))
    assert "FLASER is used" in log.warnings[0]
    for laser in ("rear", "RLASER"):
        log = read_carmen(path, laser=laser)
        assert_array_equal(log.ranges[0], np.array(rear, dtype=np.float32))
        assert_allclose(log.geometry.T_robot_laser[:2], [-0.3, 0.0], atol=1e-9)
        assert abs(log.geometry.T_robot_laser[2]) == pytest.approx(math.pi, abs=1e-5)


def test_a_lone_rear_laser_is_used(write: Write) -> None:
    assert len(read_carmen(write(flaser(room(181), name="RLASER")))) == 1


def test_wanted_laser_that_is_absent_or_unknown(write: Write) -> None:
    path = write(flaser(room(181)), odom(0, 0, 0))
    with pytest.raises(LogError, match="no scan of the wanted laser; the log holds 1 FLASER, 1 ODOM"):
        read_carmen(path, laser="rear")
    with pytest.raises(LogError, match=r"no laser is called 'left': expected 'front'"):
        read_carmen(path, laser="left")


def test_laser_place_from_the_two_poses(write: Write) -> None:
    lines = []
    for seed, heading in enumerate((0.3, -2.0, 3.1)):
        robot = (10.0 * seed, -3.0, heading)
        laser = (
            robot[0] + 0.2 * math.cos(heading) - 0.1 * math.sin(heading),
            robot[1] + 0.2 * math.sin(heading) + 0.1 * math.cos(heading),
            heading + 0.5,
        )
        lines.append(flaser(room(181, seed), robot=robot, laser=laser, stamp=seed))
    log = read_carmen(write(*lines))
    assert_allclose(log.geometry.T_robot_laser, [0.2, 0.1, 0.5], atol=1e-5)
    assert log.warnings == ()


def test_laser_place_from_parameters_where_both_poses_are_the_same(write: Write) -> None:
    parameters = ("PARAM robot_frontlaser_offset 0.16 nohost 0", "PARAM robot_frontlaser_side_offset -0.02 nohost 0")
    log = read_carmen(write(*parameters, flaser(room(181))))
    assert_allclose(log.geometry.T_robot_laser, [0.16, -0.02, 0.0])
    assert "PARAM is taken" in log.warnings[0]


def test_poses_win_over_contradicting_parameters(write: Write) -> None:
    log = read_carmen(write("PARAM robot_frontlaser_offset 0.5 nohost 0", flaser(room(181), laser=(0.2, 0.0, 0.0))))
    assert_allclose(log.geometry.T_robot_laser, [0.2, 0.0, 0.0])
    assert "the poses are taken" in log.warnings[0]


def test_angular_offset_beyond_a_turn_is_degrees(write: Write) -> None:
    path = write("PARAM robot_rearlaser_angular_offset 180 nohost 0", rawlaser(room(181), name="RAWLASER2"))
    log = read_carmen(path, laser="rear")
    assert abs(log.geometry.T_robot_laser[2]) == pytest.approx(math.pi)
    assert any("read as degrees" in warning for warning in log.warnings)


def test_flipped_laser_needs_no_turning(write: Write) -> None:
    readings = room(181)
    log = read_carmen(write("PARAM laser_front_laser_flipped 1 nohost 0", flaser(readings)))
    assert_array_equal(log.ranges[0], np.array(readings, dtype=np.float32))
    assert "upside down" in log.warnings[0]


def test_corrected_trajectory_in_place_of_the_laser_pose(write: Write) -> None:
    lines = [
        flaser(room(181, k), robot=(0.1 * k, 0.0, 0.0), laser=(0.09 * k, 0.02 * k, 0.01 * k), stamp=k)
        for k in range(50)
    ]
    log = read_carmen(write(*lines))
    assert_allclose(log.geometry.T_robot_laser, 0.0)
    assert_allclose(log.odometry[:, 0], 0.1 * np.arange(50))
    assert "perhaps a corrected trajectory" in log.warnings[0]


def test_a_few_odd_laser_poses_are_outvoted(write: Write) -> None:
    lasers = [(0.2, 0.0, 0.0)] * 19 + [(0.3, 0.0, 0.0)]
    lines = [flaser(room(181, k), laser=laser, stamp=k, robot=(0.0, 0.0, 0.0)) for k, laser in enumerate(lasers)]
    log = read_carmen(write(*lines))
    assert_allclose(log.geometry.T_robot_laser, [0.2, 0.0, 0.0])
    assert "differs in 1 scans" in log.warnings[0]


@pytest.mark.parametrize("odd", ["0.0", "-1.5", "nan", "inf", "0.019", "81.91", "-inf", "NaN"])
def test_no_return_values_never_become_points(write: Write, odd: str) -> None:
    readings = room(181)
    line = flaser(readings).replace(joined(readings[7:8]), odd, 1)
    log = read_carmen(write(line))
    assert math.isnan(log.ranges[0, 7])
    assert np.isfinite(log.ranges[0]).sum() == 180
    assert len(log.scan(0).points) == 180


def test_the_far_constant_is_found(write: Write) -> None:
    lines = [flaser([*room(160, k), *[20.0] * 21], stamp=k) for k in range(5)]
    log = read_carmen(write(*lines))
    assert_array_equal(np.isnan(log.ranges).sum(axis=1), [21] * 5)
    assert log.geometry.range_max < 9.0


def test_explicit_range_limits_do_not_bring_the_far_constant_back(write: Write) -> None:
    lines = [flaser([*room(160, k), *[20.0] * 21], stamp=k) for k in range(5)]
    log = read_carmen(write(*lines), range_max=60.0, range_min=2.0)
    assert np.nanmax(log.ranges) < 9.0
    assert np.nanmin(log.ranges) >= 2.0
    assert log.geometry.range_min == 2.0


def test_far_readings_are_cut_at_forty_metres_unless_set(write: Write) -> None:
    path = write(flaser([*room(180), 45.3]))
    assert np.isnan(read_carmen(path).ranges[0, -1])
    assert read_carmen(path).geometry.range_max < 40.0
    log = read_carmen(path, range_max=50.0)
    assert log.ranges[0, -1] == pytest.approx(45.3)
    assert log.geometry.range_max == 50.0


def test_readings_that_are_all_the_same_are_kept(write: Write) -> None:
    assert np.isfinite(read_carmen(write(flaser([5.0] * 181), flaser([5.0] * 181))).ranges).all()


def test_a_log_without_any_return_is_read_with_a_warning(write: Write) -> None:
    log = read_carmen(write(flaser([0.0] * 181)))
    assert np.isnan(log.ranges).all()
    assert "no beam of any scan has a usable return" in log.warnings


def test_changing_beam_counts_end_up_on_the_usual_bearings(write: Write) -> None:
    fine, coarse = room(361), room(181, 1)
    log = read_carmen(write(flaser(coarse), flaser(coarse), flaser(fine), flaser(room(180, 2)), flaser([])))
    assert log.ranges.shape == (5, 181)
    assert_array_equal(log.ranges[2], np.array(fine[::2], dtype=np.float32))
    assert math.isnan(log.ranges[3, -1])
    assert_array_equal(log.ranges[3, :-1], np.array(room(180, 2), dtype=np.float32))
    assert np.isnan(log.ranges[4]).all()
    assert any("1 scans with 0, 1 scans with 180, 1 scans with 361" in warning for warning in log.warnings)


def test_coarse_scan_among_fine_ones_leaves_gaps(write: Write) -> None:
    coarse = room(181)
    log = read_carmen(write(flaser(room(361)), flaser(room(361, 1)), flaser(coarse)))
    assert_array_equal(log.ranges[2, ::2], np.array(coarse, dtype=np.float32))
    assert np.isnan(log.ranges[2, 1::2]).all()


def test_empty_log(write: Write, tmp_path: Path) -> None:
    for reader in (read_log, read_carmen):
        with pytest.raises(LogError, match=r"robot\.clf: "):
            reader(write(end=""))
    with pytest.raises(LogError, match="no message found, expected a CARMEN log"):
        read_carmen(write("# nothing but a comment", ""))
    with pytest.raises(LogError, match="cannot be read"):
        read_carmen(tmp_path / "absent.clf")


def test_log_without_scans(write: Write) -> None:
    with pytest.raises(LogError, match="the log holds 2 ODOM, 1 SYNC"):
        read_log(write(odom(0, 0, 0), odom(1, 0, 0), "SYNC start 1.0 host 1.0"))


def test_scans_of_one_beam_are_no_scans(write: Write) -> None:
    with pytest.raises(LogError, match="two beams or more"):
        read_carmen(write(flaser([1.0]), flaser([])))


def test_odometry_that_never_moves_while_the_scans_change_is_none(write: Write) -> None:
    log = read_carmen(write(*(flaser(room(181, k), robot=(3.0, 4.0, 1.0), stamp=k) for k in range(10))))
    assert not log.has_odometry
    assert any("stays the same while the scans change" in warning for warning in log.warnings)


def test_a_robot_that_stands_still_has_odometry(write: Write) -> None:
    log = read_carmen(write(*(flaser(room(181), robot=(3.0, 4.0, 1.0), stamp=k) for k in range(10))))
    assert log.has_odometry
    assert log.warnings == ()


def test_headings_are_wrapped(write: Write) -> None:
    log = read_carmen(write(flaser(room(181), robot=(0.0, 0.0, -6.749570))))
    assert_allclose(log.odometry[0, 2], -6.749570 + 2 * math.pi)


def test_stamps_that_step_back_keep_file_order(write: Write) -> None:
    log = read_carmen(write(*(flaser(room(181, k), stamp=stamp) for k, stamp in enumerate((5.0, 3.0, 9.0)))))
    assert_allclose(log.stamps, [5.0, 3.0, 9.0])
    assert any("step back 1 times" in warning for warning in log.warnings)


def test_coarse_stamps_give_way_to_the_loggers(write: Write) -> None:
    lines = [flaser(room(181, k), robot=(k, 0.0, 0.0), stamp=976053000.0, logger=0.2 * k) for k in range(10)]
    log = read_carmen(write(*lines))
    assert_allclose(log.stamps, 0.2 * np.arange(10))
    assert any("the logger's stamps are taken" in warning for warning in log.warnings)


def test_stamps_that_are_all_zero_are_said(write: Write) -> None:
    log = read_carmen(write(*(flaser(room(181, k), robot=(k, 0.0, 0.0), stamp=0.0) for k in range(3))))
    assert any("all stamps are 0 s" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("broken", "found", "expected"),
    [
        ("FLASER 3 1.0 2.0 oops 0 0 0 0 0 0 1.0 host 1.0", "'oops'", "number 3 of 3 of the ranges"),
        ("FLASER 3 1.0 2.0 3.0 0 0 0 0 0", "the end of the line", "number 6 of 6 of the laser and robot pose"),
        ("FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 1.0", "'1.0' after", "the stamps"),
        ("FLASER 2 1.0 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0", "after the other fields", "the stamps"),
        ("FLASER 2.5 1.0 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0", "num_readings 2.5", "a whole number"),
        ("FLASER -2 1.0 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0", "num_readings -2", "a whole number"),
        ("FLASER 999999999999 1.0", "num_readings 1e+12", "a whole number"),
        ("FLASER", "the end of the line", "num_readings"),
        ("FLASER 2 1.0 2.0 0 0 nan 0 0 0 1.0 host 1.0", "nan", "a finite pose"),
        ("FLASER 2 1.0 2.0 0 0 0 0 0 0 inf host 1.0", "inf", "finite numbers"),
        ("FLASER 2 1_0 2.0 0 0 0 0 0 0 1.0 host 1.0", "'1_0'", "number 1 of 2 of the ranges"),
        ("ROBOTLASER1 0 nan 3.14 0.01 80 0.01 0 2 1 2 0 0 0 0 0 0 0 0 0 0 0 0 1 host 1", "nan", "description"),
        ("RAWLASER1 0 -1.57 3.14 0.01 80 0.01 0 2 1 2 4 0 0 1 host 1", "'host'", "remissions"),
        ("PARAM robot_frontlaser_offset", "1 words", "a name and a value"),
        ("ODOM 0 0 zero 0 0 0 1.0 host 1.0", "'zero'", "number 3 of 6"),
        ("\x01\x02\x7f rubbish", "'", "a message name"),
        ("976052857.337530 host 0.0", "'976052857.337530'", "a message name"),
    ],
)
def test_malformed_line_says_where_what_and_what_instead(write: Write, broken: str, found: str, expected: str) -> None:
    good = rawlaser(room(181)) if broken.startswith("ODOM") else "# a comment"
    path = write(good, broken, flaser(room(181)))
    with pytest.raises(LogError) as caught:
        read_carmen(path)
    place, _, statement = str(caught.value).partition(": found ")
    shown, _, wanted = statement.partition(", expected ")
    assert place == f"{path}:2"
    assert found in shown
    assert expected in wanted
    log = read_carmen(path, skip_bad_lines=True)
    assert log.skipped_lines == 1
    assert len(log) == 1
    assert any(f"1 malformed lines passed over, the first: {path}:2: found" in warning for warning in log.warnings)


def test_nothing_but_malformed_lines(write: Write) -> None:
    with pytest.raises(LogError, match=r"no message found.*2 malformed lines passed over, the first: .*:1: found"):
        read_carmen(write("FLASER 1 x", "FLASER 2 y"), skip_bad_lines=True)


@given(cut=st.integers(1, 10_000))
@settings(max_examples=60)
def test_wherever_the_last_line_is_cut_the_rest_is_read(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    line = flaser(room(181))
    cut = 1 + cut % (len(line) - 1)
    path = tmp_path_factory.mktemp("cut") / "robot.clf"
    path.write_text(f"{line}\n{line[:cut]}")
    log = read_carmen(path)
    whole = line[:cut].endswith(tuple(f"host {line.rsplit(' ', 1)[1][:n]}" for n in range(1, 9)))
    assert len(log) == (2 if whole else 1)
    assert any("the last line is cut off" in warning and "line 2" in warning for warning in log.warnings) == (not whole)


def test_complete_last_line_needs_no_newline(write: Write) -> None:
    log = read_carmen(write(flaser(room(181)), end=""))
    assert (len(log), log.warnings) == (1, ())


def test_only_a_cut_line_is_a_log_without_scans(write: Write) -> None:
    with pytest.raises(LogError, match="the last line is cut off"):
        read_carmen(write("FLASER 181 1.0 2.0", end=""))


def test_line_ends_tabs_comments_and_unknown_messages(tmp_path: Path) -> None:
    line = flaser(room(181))
    lines = ["# header", "", "   ", line.replace(" ", "\t"), "  " + line, "NEWSENSOR 1 2 3", "SYNC a 1 h 1", "\t# note"]
    path = tmp_path / "robot.clf"
    path.write_bytes("\r\n".join([*lines, ""]).encode())
    log = read_log(path)
    assert len(log) == 2
    assert log.message_counts == {"FLASER": 2, "NEWSENSOR": 1, "SYNC": 1}

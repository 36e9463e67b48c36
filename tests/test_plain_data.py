"""Plain data: arrays and tables of scans, and logs written in another format."""

import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray
from pyarrow import parquet

import iceg
from frontends.logs import read_log
from frontends.logs.errors import LogError
from frontends.logs.writers import WRITERS, write_log
from frontends.matchers.bearing_scan import BearingScan
from frontends.scan import Log, Scan, ScanError
from iceg.cli import main
from iceg.tum import format_tum

TABLES = ("log.csv", "log.csv.gz", "log.npz", "log.parquet")


def moving_log(n_scans: int = 20, n_beams: int = 31) -> Log:
    """A log with everything in it."""
    random = np.random.default_rng(0)
    ranges = random.uniform(0.5, 8.0, (n_scans, n_beams)).astype(np.float32)
    ranges[random.uniform(size=ranges.shape) < 0.1] = np.nan
    poses = np.cumsum(random.uniform(-0.1, 0.1, (n_scans, 3)), axis=0)
    return Log.from_arrays(
        ranges,
        bearings=np.radians(-90.0 + 6.0 * np.arange(n_beams)),
        odometry=poses,
        truth=poses + 1.0,
        stamps=1e9 + 0.1 * np.arange(n_scans),
        T_robot_laser=(0.2, -0.1, 0.3),
        sweep=-0.05,
        range_min=0.1,
        range_max=8.0,
    )


def test_a_log_from_arrays() -> None:
    log = Log.from_arrays([[1.0, 0.0, math.inf, 2.0], [1.0, math.nan, -1.0, 5.0]], field_of_view=math.pi, range_max=5.0)
    assert np.flatnonzero(np.isfinite(log.ranges)).tolist() == [0, 3, 4]
    np.testing.assert_allclose(log.geometry.bearings, np.linspace(-math.pi / 2, math.pi / 2, 4))
    assert not log.has_odometry
    assert log.stamps.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("factor", "unit"), [(1.0, ""), (1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
def test_stamps_in_another_unit_are_told(tmp_path: Path, factor: float, unit: str) -> None:
    ranges, stamps = np.linspace(1.0, 4.0, 60).reshape(20, 3), factor * (1e9 + 0.05 * np.arange(20))
    log = Log.from_arrays(ranges, field_of_view=2.0, stamps=stamps)
    told = [said.rpartition(" ")[2] for said in log.warnings if "apart by their stamps" in said]
    assert told == ([f"{unit}seconds?"] if unit else [])
    write_log(tmp_path / "log.csv", log)
    assert read_log(tmp_path / "log.csv").warnings == log.warnings


def test_beams_from_left_to_right_are_turned_about() -> None:
    log = Log.from_arrays([[1.0, 2.0, 3.0]], bearings=[0.5, 0.0, -0.5])
    assert log.ranges[0].tolist() == [3.0, 2.0, 1.0]
    assert log.geometry.bearings.tolist() == [-0.5, 0.0, 0.5]


@pytest.mark.parametrize("field_of_view", [2.0 * math.pi, 6.2832, 2.0 * math.pi + 2e-3])
def test_a_whole_turn_may_be_printed_rounded(field_of_view: float) -> None:
    bearings = np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, 361)
    for log in (
        Log.from_arrays(np.ones((2, 361)), field_of_view=field_of_view),
        Log.from_arrays(np.ones((2, 361)), bearings=bearings),
    ):
        assert log.geometry.field_of_view == pytest.approx(field_of_view, abs=1e-12)
    scan = Scan.from_ranges(np.ones(361), field_of_view=field_of_view)
    links = BearingScan.of(scan).links(0.5)
    assert links.all()
    with pytest.raises(ScanError, match="expected more than 0 and at most 2π"):
        Scan.from_ranges(np.ones(361), field_of_view=2.0 * math.pi + 3e-3)


RANGES = np.ones((3, 4))


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ({"ranges": [1.0, 2.0], "field_of_view": 1.0}, r"ranges of shape \(2,\), expected 2 dimensions"),
        ({"ranges": np.ones((3, 1)), "field_of_view": 1.0}, r"ranges of shape \(3, 1\)"),
        ({"ranges": [["a", "b"]], "field_of_view": 1.0}, "no array of numbers"),
        ({}, "exactly one"),
        ({"field_of_view": 7.0}, "field of view of 7 rad, expected more than 0 and at most 2π: 7° is 0.122173"),
        ({"bearings": [0.0, 1.0]}, r"bearings of shape \(2,\), expected \(4,\)"),
        ({"bearings": [0.0, 0.2, 0.1, 0.3]}, "neither increase nor decrease"),
        ({"bearings": [0.0, 0.1, 0.2, 2.0]}, "unevenly"),
        ({"bearings": [-90.0, -30.0, 30.0, 90.0]}, "in radians"),
        ({"field_of_view": 1.0, "odometry": np.zeros((2, 3))}, r"odometry of shape \(2, 3\), expected \(3, 3\)"),
        ({"field_of_view": 1.0, "odometry": np.full((3, 3), np.nan)}, "NaN or infinity in odometry"),
        (
            {"field_of_view": 1.0, "stamps": np.array([0, 1, 2], "datetime64[s]")},
            r'stamps: found datetime64, expected seconds: \(t - t\[0\]\) / np.timedelta64\(1, "s"\)',
        ),
        ({"field_of_view": 1.0, "stamps": np.array([0, 1, 2], "timedelta64[s]")}, "stamps: found timedelta64"),
        (
            {"field_of_view": 1.0, "stamps": np.ma.array([0, 1, 2], mask=[False, True, False])},
            "NaN or infinity in stamps",
        ),
        ({"field_of_view": 1.0, "stamps": [0.0, 1.0, math.inf]}, r"infinity in stamps\[2\], expected finite numbers"),
        ({"field_of_view": 1.0, "odometry": [[0, 0, 0], [0, math.nan, 0], [0, 0, math.nan]]}, r"in odometry\[1\]"),
        ({"field_of_view": 1.0, "stamps": [0.0]}, r"stamps of shape \(1,\), expected \(3,\)"),
        ({"field_of_view": 1.0, "T_robot_laser": [0.0]}, r"T_robot_laser of shape \(1,\), expected \(3,\)"),
        ({"field_of_view": 1.0, "T_robot_laser": [0.0, 0.0, 180.0]}, r"180 rad, expected radians \(180° is 3.14159\)"),
        ({"field_of_view": 1.0, "range_min": 3.0, "range_max": 2.0}, "range_min < range_max"),
    ],
)
def test_arrays_that_are_no_log(arguments: dict[str, object], found: str) -> None:
    with pytest.raises(ScanError, match=found):
        Log.from_arrays(**{"ranges": RANGES, **arguments})  # type: ignore[arg-type]


@pytest.mark.parametrize("stamped", [True, False])
def test_odometry_in_wrong_units_is_told(stamped: bool) -> None:
    n = 60
    headings = 0.05 * np.sin(0.5 * np.arange(n)) + np.repeat([0.0, 0.1], n // 2).cumsum()
    poses = np.column_stack([0.05 * np.arange(n), np.zeros(n), headings])
    stamps = 0.1 * np.arange(n) if stamped else None

    def told(scale: tuple[float, float, float]) -> str:
        odometry, ranges = poses * scale, np.ones((n, 3))
        return " ".join(Log.from_arrays(ranges, field_of_view=1.0, odometry=odometry, stamps=stamps).warnings)

    assert "found odometry" not in told((1.0, 1.0, 1.0))
    assert "is the heading in degrees?" in told((1.0, 1.0, math.degrees(1.0)))
    assert ("goes 500 m/s on average: metres and" in told((1000.0, 1000.0, 1.0))) == stamped


def test_readings_in_millimetres_are_told_by_their_size() -> None:
    log = Log.from_arrays([[410.0, 19970.0, 5000.0]], field_of_view=1.0)
    assert log.warnings[0] == (
        "no beam of any scan has a usable return: readings run from 410 to 19970, and only those from 0.02 m to 40 m "
        "count: are they in millimetres?"
    )
    assert Log.from_arrays([[0.0, 0.0]], field_of_view=1.0).warnings[0] == "no beam of any scan has a usable return"


def test_masked_readings_are_no_returns() -> None:
    masked = np.ma.array([[1, 2, 3], [4, 5, 6]], mask=[[False, True, False], [False] * 3])
    for ranges in (masked, list(masked)):
        log = Log.from_arrays(ranges, field_of_view=1.0)
        np.testing.assert_array_equal(log.ranges, np.array([[1, np.nan, 3], [4, 5, 6]], np.float32))
    np.testing.assert_array_equal(Scan.from_ranges(masked[0], field_of_view=1.0).ranges, [1.0, np.nan, 3.0])


@pytest.mark.parametrize("name", ["log.npz", "log.parquet"])
def test_dates_in_tables_are_no_seconds(tmp_path: Path, name: str) -> None:
    stamps = np.array([0, 1], "datetime64[ns]")
    if name == "log.npz":
        np.savez(tmp_path / name, ranges=np.ones((2, 3)), stamps=stamps, field_of_view_rad=1.0)
    else:
        columns = {"range_0": [1.0, 1.0], "range_1": [1.0, 1.0], "field_of_view_rad": [1.0, 1.0]}
        parquet.write_table(pa.table({"stamp_s": stamps, **columns}), tmp_path / name)
    with pytest.raises(LogError, match=r"log\.\w+: stamp.*: found datetime64, expected seconds"):
        read_log(tmp_path / name)


@pytest.mark.parametrize("name", TABLES)
def test_a_table_holds_all_of_a_log(tmp_path: Path, name: str) -> None:
    log = moving_log()
    assert write_log(tmp_path / name, log) == ()
    again = read_log(tmp_path / name)
    for attribute in ("ranges", "odometry", "stamps", "truth"):
        np.testing.assert_array_equal(getattr(again, attribute), getattr(log, attribute))
    for attribute in ("bearings", "T_robot_laser", "range_min", "range_max"):
        np.testing.assert_array_equal(getattr(again.geometry, attribute), getattr(log.geometry, attribute))
    assert again.sweep == log.sweep
    assert again.warnings == ()


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_the_same_bytes_each_time(tmp_path: Path, name: str) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder / name, moving_log())
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_table_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("# field_of_view_rad = 2\n# a remark\nstamp_s,range_0,range_1,range_2\n0.5,1,,3\n0.6,1,inf,3\n")
    log = read_log(path)
    np.testing.assert_array_equal(log.ranges, np.array([[1, np.nan, 3], [1, np.nan, 3]], np.float32))
    assert log.geometry.bearings.tolist() == [-1.0, 0.0, 1.0]
    assert log.stamps.tolist() == [0.5, 0.6]


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("range_0,range_1\n1,2\n", "no directions of the beams"),
        ("# field_of_view_rad = x\nrange_0,range_1\n1,2\n", ":1: found 'x'"),
        (
            "# field_of_view_rad = 1\n# laser_theta_rad = 180\nrange_0,range_1\n1,2\n",
            "heading of 180 rad, expected rad",
        ),
        ("# field_of_view_rad = 1\nrange_0,range_2\n1,2\n", "2 columns from range_0 to range_2"),
        ("# field_of_view_rad = 1\nrange_0,range_1,Range_2\n1,2,3\n", ":2: found the column 'Range_2', did you mean"),
        ("# field_of_view_rad = 1\nrange_0,range_1,range_1\n1,2,3\n", ":2: found the column 'range_1' twice"),
        ("# field_of_view_rad = 1\nrange_0;range_1\n1,5;2\n", ":3: found '1,5', expected a number with a point"),
        ("# field_of_view_rad = 1,5\nrange_0;range_1\n1;2\n", ":1: found '1,5', expected numbers for .* with a point"),
        ("# a remark\nStamp_s,Range_0,Range_1\n0,1,2\n", ":2: found the column 'Stamp_s', did you mean 'stamp_s'"),
        ("# a remark\ntime;r0;r1\n1;2;3\n", "found 'time;r0;r1', expected a log"),
        ("# field_of_view_rad = 1\nrange_0,range_1\n1,2\n1\n1,2\n", ":4: found 1 fields, expected 2"),
        ("# field_of_view_rad = 1\nrange_0,range_1\n1,2\n1,b\n1,2\n", ":4: found 'b', expected a number"),
        (
            "# field_of_view_rad = 1\nrange_0,stamp_s,range_1\n1,0,2\n1,,2\n1,2,2\n",
            ":4: found '' for stamp_s, expected",
        ),
        ("# field_of_view_rad = 1\nrange_0,range_1\n", "no scan"),
        ("# field_of_view_rad = 1\nodom_x_m,range_0,range_1\n1,1,2\n", "expected all of odom_x_m, odom_y_m"),
    ],
)
def test_tables_with_a_mistake(tmp_path: Path, content: str, found: str) -> None:
    path = tmp_path / "scans.csv"
    path.write_text(content)
    with pytest.raises(LogError, match=found):
        read_log(path)


@given(
    separator=st.sampled_from([",", ";", "\t"]),
    ranges=npst.arrays(np.float32, (3, 4), elements=st.floats(0.125, 8.0, width=32), unique=True),
    is_quoted=st.booleans(),
    is_padded=st.booleans(),
)
def test_a_table_may_be_separated_by_commas_semicolons_or_tabs(
    separator: str, ranges: NDArray[np.float32], is_quoted: bool, is_padded: bool
) -> None:
    names = ["stamp_s", *(f"range_{beam}" for beam in range(4))]
    rows = [[repr(0.1 * k), *(reading.astype(str) for reading in row)] for k, row in enumerate(ranges)]
    lines = [[f'"{name}"' for name in names] if is_quoted else names, *rows]
    padding = 4 * separator if is_padded else ""  # as spreadsheets write short lines
    settings = [f"# {said}{padding}" for said in ("field_of_view_rad = 2", "range_max_m = 9")]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scans.csv"
        path.write_text("\n".join([*settings, *map(separator.join, lines)]) + "\n")
        log = read_log(path)
    np.testing.assert_array_equal(log.ranges, ranges)
    np.testing.assert_allclose(log.stamps, [0.0, 0.1, 0.2])


def test_malformed_rows_may_be_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("# field_of_view_rad = 1\nrange_0,range_1\n1,2\nbad\n1,2\n1,")
    log = read_log(path, skip_bad_lines=True)
    assert (len(log), log.skipped_lines) == (3, 1)


@pytest.mark.parametrize("name", ["log.npz", "log.parquet"])
def test_damaged_tables_are_refused_or_read(tmp_path: Path, name: str) -> None:
    write_log(tmp_path / name, moving_log())
    whole, random = (tmp_path / name).read_bytes(), np.random.default_rng(0)
    copies = [whole[: len(whole) * k // 11] for k in range(1, 11)]
    for _ in range(30):
        flipped = bytearray(whole)
        flipped[int(random.integers(len(whole)))] ^= 1 << int(random.integers(8))
        copies.append(bytes(flipped))
    refused = 0
    for copy in copies:
        (tmp_path / name).write_bytes(copy)
        try:
            read_log(tmp_path / name)
        except LogError:
            refused += 1
    assert refused >= 10


def test_an_array_that_is_missing(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", scans=np.ones((2, 3)))
    with pytest.raises(LogError, match="'ranges' is missing"):
        read_log(tmp_path / "log.npz")


def test_a_misspelt_array_is_refused_and_another_one_told(tmp_path: Path) -> None:
    wrong = {"laser_x": "laser_x_m", "timestamps": "stamps", "Odometry": "odometry"}
    for name, right in wrong.items():
        arrays: dict[str, Any] = {"ranges": np.ones((2, 3)), "field_of_view_rad": 1.0, name: np.zeros(2)}
        np.savez(tmp_path / "log.npz", **arrays)
        with pytest.raises(LogError, match=f"found the array '{name}', did you mean '{right}'"):
            read_log(tmp_path / "log.npz")
    np.savez(tmp_path / "log.npz", ranges=np.ones((2, 3)), field_of_view_rad=1.0, robot=np.array(["a", "b"]))
    assert read_log(tmp_path / "log.npz").warnings[0].startswith("found the arrays 'robot', expected ranges, stamps, ")


def test_a_misspelt_setting_of_a_csv_is_told_and_a_remark_is_none(tmp_path: Path) -> None:
    path = tmp_path / "scans.csv"
    path.write_text("# speed = 3 m/s\n# laser_x = 0.2\n# field_of_view_rad = 2\nrange_0,range_1\n1,2\n")
    log = read_log(path)
    assert log.warnings[0] == "line 2: found laser_x, which is left out: did you mean laser_x_m?"
    assert not any("speed" in warning for warning in log.warnings)


def write_table(path: Path, columns: dict[str, list[float]]) -> Path:
    """The same columns in whatever format the name tells, over a view of 2 rad."""
    if path.suffix == ".parquet":
        table = pa.table(columns).replace_schema_metadata({"iceg": json.dumps({"field_of_view_rad": [2.0]})})
        parquet.write_table(table, path)
    else:
        rows = zip(*columns.values(), strict=True)
        lines = ["# field_of_view_rad = 2", ",".join(columns), *(",".join(map(str, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_misspelt_column_is_refused_and_another_one_told(tmp_path: Path, name: str) -> None:
    columns = {"range_0": [1.0, 2.0], "range_1": [2.0, 3.0]}
    for wrong, right in {"odom_x": "odom_x_m", "Range_17": "range_0", "stamps": "stamp_s"}.items():
        path = write_table(tmp_path / name, {**columns, wrong: [0.0, 1.0]})
        with pytest.raises(LogError, match=f"found the column '{wrong}', did you mean '{right}'"):
            read_log(path)
    log = read_log(write_table(tmp_path / name, {"speed": [0.0, 1.0], **columns}))
    np.testing.assert_array_equal(log.ranges, [[1.0, 2.0], [2.0, 3.0]])
    assert log.warnings[0].startswith("found the columns 'speed', expected stamp_s, odom_…")


def test_a_misspelt_setting_of_parquet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    table = pa.table({"range_0": [1.0], "range_1": [2.0]})
    said = json.dumps({"field_of_view_rad": [2.0], "laser_x": [0.2]})
    parquet.write_table(table.replace_schema_metadata({"iceg": said}), path)
    with pytest.raises(LogError, match="found the setting 'laser_x', did you mean 'laser_x_m'"):
        read_log(path)


CONVERTED = ("log.clf", "log.usarsim", "log.bag", "log.db3", "log.mcap", "log.parquet", "log.csv", "log.npz")


@pytest.fixture(scope="module")
def demo() -> Log:
    """The beginning of the embedded log."""
    return read_log(iceg.demo_log_path()).select(slice(0, 300))


@pytest.fixture(scope="module")
def trajectory(demo: Log) -> NDArray[np.float64]:
    """Its trajectory."""
    return iceg.run(demo).trajectory


@pytest.mark.parametrize("name", CONVERTED)
def test_a_converted_log_gives_the_same_trajectory(
    tmp_path: Path, demo: Log, trajectory: NDArray[np.float64], name: str
) -> None:
    write_log(tmp_path / name, demo)
    again = iceg.run(read_log(tmp_path / name)).trajectory
    np.testing.assert_allclose(again, trajectory, atol=1e-4)


@pytest.mark.parametrize("log_format", ["ros1", "ros2", "mcap"])
def test_a_bag_carries_sweep_mount_and_truth(tmp_path: Path, log_format: str) -> None:
    log = moving_log()
    assert write_log(tmp_path / "log", log, log_format=log_format) == ()
    again = read_log(tmp_path / "log")
    np.testing.assert_array_equal(again.ranges, log.ranges)
    assert again.sweep == pytest.approx(log.sweep)
    for attribute in ("odometry", "truth", "stamps"):
        np.testing.assert_allclose(getattr(again, attribute), getattr(log, attribute), atol=1e-5)
    np.testing.assert_allclose(again.geometry.T_robot_laser, log.geometry.T_robot_laser, atol=1e-6)
    np.testing.assert_allclose(again.geometry.bearings, log.geometry.bearings, atol=1e-6)


def test_stamps_that_a_bag_cannot_carry_are_moved_and_told(tmp_path: Path) -> None:
    log = replace(moving_log(), stamps=np.tile([0.0, 2.0, 1.0, 1.0], 5), truth=None, sweep=None)
    (told,) = write_log(tmp_path / "log.bag", log)
    assert "step back" in told
    np.testing.assert_array_equal(read_log(tmp_path / "log.bag").ranges, log.ranges)


def test_what_a_format_cannot_carry_is_told(tmp_path: Path) -> None:
    (told,) = write_log(tmp_path / "log.clf", moving_log())
    assert told == "carmen cannot carry the true poses, how long a sweep takes"


def test_unknown_names_of_formats(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"\.bag, \.db3, \.mcap"):
        write_log(tmp_path / "log.xyz", moving_log())
    with pytest.raises(LogError, match=", ".join(WRITERS)):
        write_log(tmp_path / "log", moving_log(), log_format="xyz")


def test_a_recording_that_is_there_is_replaced_only_if_asked(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("the only copy")
    with pytest.raises(LogError, match=r"is there already.*overwrite=True"):
        iceg.write_log(path, moving_log())
    assert path.read_text() == "the only copy"
    iceg.write_log(path, moving_log(), overwrite=True)
    assert len(read_log(path)) == 20
    with pytest.raises(LogError, match="is a folder"):
        iceg.write_log(tmp_path, moving_log(), log_format="ros2", overwrite=True)


def test_convert_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "log.npz", moving_log())
    words = ["convert", str(tmp_path / "log.npz"), str(tmp_path / "log.clf")]
    assert main(words) == 0
    assert "cannot carry the true poses" in capsys.readouterr().err
    assert main(words) == 1  # as `iceg run` into a folder of results
    assert f"{words[2]}: is there already" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    assert main(["convert", str(tmp_path / "none.clf"), str(tmp_path / "log.xyz")]) == 2
    assert main(["convert", str(tmp_path / "log.clf"), str(tmp_path / "bag"), "--to", "ros2"]) == 0
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert len(read_log(tmp_path / "bag")) == 20


def test_info_tells_what_a_run_would_choose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "log.mcap", moving_log())
    assert main(["info", str(tmp_path / "log.mcap")]) == 0
    told = capsys.readouterr().out
    for sentence in ("laser: /scan", "odometry: /odom", "mount: the pose of 'laser'", "truth: /ground_truth"):
        assert sentence in told
    assert main(["info", str(tmp_path / "log.mcap"), "--log.scan-topic", "/other"]) == 1
    assert "expected one of /scan" in capsys.readouterr().err


def test_a_bag_that_holds_the_truth_judges_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = moving_log()
    write_log(tmp_path / "log.bag", log)
    (tmp_path / "trajectory.tum").write_text(format_tum(log.stamps, log.odometry))
    assert main(["eval", str(tmp_path / "trajectory.tum"), "--truth", str(tmp_path / "log.bag"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ate_rmse"] == pytest.approx(0.0, abs=1e-5)
    write_log(tmp_path / "log.clf", log)
    assert main(["eval", str(tmp_path / "trajectory.tum"), "--truth", str(tmp_path / "log.clf")]) == 1
    assert "does not hold the true poses" in capsys.readouterr().err


def test_settings_that_a_format_has_no_use_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(iceg.demo_log_path()), "--log.scan-topic", "/scan"]) == 1
    assert "carmen has no option scan_topic" in capsys.readouterr().err


def test_a_file_that_nothing_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "pose.txt").write_text("hello\n")
    assert main(["run", str(tmp_path / "pose.txt"), "-o", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    for word in ("carmen", "bag", "csv", "Log.from_arrays"):
        assert word in line


def test_a_table_that_does_not_say_where_the_laser_sits_stays_silent(tmp_path: Path) -> None:
    silent = tmp_path / "silent.csv"
    columns = "odom_x_m,odom_y_m,odom_theta_rad,range_0,range_1"
    silent.write_text(f"# field_of_view_rad = 3.0\n{columns}\n0,0,0,1,2\n1,0,0,1,2\n")
    log = read_log(silent)
    assert not log.is_mount_known
    assert any("where the laser sits" in warning for warning in log.warnings)
    write_log(tmp_path / "again.csv", log)
    assert not read_log(tmp_path / "again.csv").is_mount_known
    assert not Log.from_arrays(RANGES, field_of_view=1.0).is_mount_known
    assert Log.from_arrays(RANGES, field_of_view=1.0, T_robot_laser=np.zeros(3)).is_mount_known
    told = read_log(silent, laser_x=0.0)
    write_log(tmp_path / "told.csv", told)
    assert read_log(tmp_path / "told.csv").is_mount_known

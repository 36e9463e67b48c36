"""What comes in is bounded: the table of limits, and how it is kept to."""

import gzip
import math
import os
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import frontends.logs.budget
import frontends.logs.text
import graph.limits
from frontends.logs import LogError, read_log
from frontends.logs.beams import BeamDescription, Setup, find_beams
from frontends.logs.writers import write_log
from frontends.scan import Log, ScanError, ScanGeometry
from graph.errors import IcegError
from graph.files import check_file
from graph.limits import LIMITS, LimitError, Limits, parse_limits
from graph.ranges import number_in
from tests.fuzz.seeds import flaser, flaser_log

DOCUMENT = Path(__file__).parent.parent / "docs" / "limits.md"


def test_limits_are_changed_by_name() -> None:
    assert parse_limits("") == Limits()
    changed = parse_limits(" scans = 2e6, log_bytes=8e9 ")
    assert changed == replace(Limits(), scans=2_000_000, log_bytes=8_000_000_000)
    assert isinstance(changed.scans, int)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("scan=1", "found 'scan=1', expected NAME=VALUE with one of coordinate, "),
        ("scans=many", "found 'scans=many', expected a positive number for scans"),
        ("scans=inf", "found 'scans=inf', expected a positive number for scans"),
        ("scans=0", "the limit scans is 0, expected a positive number"),
        ("coordinate=nan", "the limit coordinate is nan, expected a positive number"),
    ],
)
def test_a_table_of_limits_that_is_none_is_refused(text: str, complaint: str) -> None:
    with pytest.raises(LimitError, match=re.escape(complaint)):
        parse_limits(text)


def test_the_environment_raises_a_limit_for_a_process(tmp_path: Path) -> None:
    (tmp_path / "x.clf").write_text(flaser_log(3))
    told = {}
    for limits in ("scans=2", "scans=3", "scans=many"):
        command = [sys.executable, "-m", "iceg", "info", str(tmp_path / "x.clf")]
        done = subprocess.run(
            command, env={**os.environ, "ICEG_LIMITS": limits}, capture_output=True, text=True, check=False
        )
        told[limits] = (done.returncode, done.stderr.strip())
    assert told["scans=2"][0] == 1
    assert told["scans=2"][1].endswith(
        "x.clf: found more scans, expected at most 2 (ICEG_LIMITS=scans=… in the environment raises this limit)"
    )
    assert told["scans=3"] == (0, "")
    assert told["scans=many"][0] == 2
    assert told["scans=many"][1].startswith("iceg: ICEG_LIMITS: found 'scans=many'")


def test_the_document_lists_every_limit() -> None:
    listed = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE))
    assert {name: float(most.replace(" ", "")) for name, most in listed.items()} == {
        field.name: float(getattr(Limits(), field.name)) for field in fields(Limits)
    }


@pytest.mark.parametrize("name", ["line_bytes", "log_bytes", "lines"])
def test_a_packed_log_is_unpacked_no_farther_than_its_budget(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.clf.gz"
    filler = b"1 " if name == "line_bytes" else b"#\n"
    path.write_bytes(gzip.compress(f"{flaser(0)}\n".encode()) + gzip.compress(filler * 1_000_000) * 50)
    monkeypatch.setattr(frontends.logs.text, "LIMITS", replace(LIMITS, **{name: 3_000_000}))
    with pytest.raises(LogError, match=rf"x.clf.gz: found .*expected at most .*\(ICEG_LIMITS={name}="):
        read_log(path)


def test_scans_that_grow_when_they_are_brought_to_the_usual_beams_are_counted_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.clf"
    few = "FLASER 2 1 1 0 0 0 0 0 0 0 h 0"
    path.write_text("\n".join([*(flaser(k) for k in range(3)), few, few]) + "\n")
    read_log(path)
    monkeypatch.setattr(frontends.logs.budget, "LIMITS", replace(LIMITS, readings=600))
    with pytest.raises(LogError, match="found 5 scans that would all have the usual 180 beams"):
        read_log(path)


@pytest.mark.parametrize("name", ["log.npz", "log.parquet"])
@pytest.mark.parametrize(("limit", "most"), [("scans", 9), ("beams", 19), ("readings", 199)])
def test_a_packed_table_is_unpacked_no_farther_than_its_limits(
    limit: str, most: int, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_log(tmp_path / name, Log.from_arrays(np.ones((10, 20)), field_of_view=1.0))
    read_log(tmp_path / name)
    monkeypatch.setattr(graph.limits, "LIMITS", replace(LIMITS, **{limit: most}))
    with pytest.raises(LogError, match=rf"{name}: found (the array|10 rows) .*at most {most} \(ICEG_LIMITS={limit}="):
        read_log(tmp_path / name)


def test_arrays_unpack_to_no_more_than_a_log_may_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.npz"
    np.savez_compressed(path, ranges=np.ones((2, 3)), field_of_view_rad=1.0, other=np.zeros(200_000))
    read_log(path)
    monkeypatch.setattr(graph.limits, "LIMITS", replace(LIMITS, log_bytes=1_000_000))
    assert path.stat().st_size < 10_000
    with pytest.raises(LogError, match=r"found 16\d+ bytes when unpacked, expected at most .*\(ICEG_LIMITS=log_bytes="):
        read_log(path)


def test_plain_arrays_hold_no_more_than_a_log_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graph.limits, "LIMITS", replace(LIMITS, readings=5))
    with pytest.raises(ScanError, match=r"found ranges of shape \(2, 3\), expected at most 5 \(ICEG_LIMITS=readings="):
        Log.from_arrays(np.ones((2, 3)), field_of_view=1.0)


@pytest.mark.parametrize("name", ["folder", "pipe", "/dev/zero", "absent", "n\0ul", "n" * 300])
def test_only_files_are_opened(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(IcegError, match="cannot be read as a thing: "):
        check_file(tmp_path / name, "table_bytes", IcegError, "a thing")


@pytest.mark.parametrize("text", ["nan", "inf", "1e300", "9" * 5000, "", "x", "-1", "11", "1e999"])
def test_a_number_out_of_its_range_is_refused(text: str) -> None:
    with pytest.raises(IcegError, match=r"here:1: found '.{0,40}', expected a length in metres from 0 to 10"):
        number_in(text, 0.0, 10.0, "a length in metres", IcegError, "here:1")


def test_a_number_in_its_range_is_read() -> None:
    assert [number_in(text, 0.0, 10.0, "x", IcegError) for text in ("0", "10", "2.5e0")] == [0.0, 10.0, 2.5]


@pytest.mark.parametrize(
    ("start", "view", "step"),
    [
        (-1.57, 1.8e-298, 1e-300),  # equal bearings
        (1e150, math.pi, math.radians(1.0)),
        (1e300, math.pi, math.radians(1.0)),
        (-1.57, 1e300, 1e298),
        (-1.57, 100.0, 100.0 / 179),  # sixteen turns
        (-1.57, -1.0, 1e-320),
    ],
)
def test_a_description_that_is_no_lasers_is_left_out_with_a_warning(start: float, view: float, step: float) -> None:
    beams = find_beams(Setup(180, BeamDescription(start, view, step, 81.91)), {})
    assert_array_equal(beams.bearings, find_beams(Setup(180, None), {}).bearings)
    assert any("which is no laser's" in warning for warning in beams.warnings)


@pytest.mark.parametrize(
    "bearings",
    [
        [0.0, 0.0, 1.0],
        [1.0, 0.0],
        [0.0, math.nan],
        [0.0, math.inf],
        [1e150, 2e150],
        [0.0, 7.0],
        [],
        [0.0],
        [[0.0, 1.0]],
    ],
)
def test_bearings_of_no_laser_are_refused(bearings: list[float]) -> None:
    with pytest.raises(ScanError):
        ScanGeometry(bearings=np.array(bearings), range_min=0.0, range_max=10.0)


@pytest.mark.parametrize("T_robot_laser", [[0.0, 0.0], [math.nan, 0.0, 0.0], [1e300, 0.0, 0.0]])
def test_a_laser_nowhere_on_its_robot_is_refused(T_robot_laser: list[float]) -> None:
    with pytest.raises(ScanError):
        ScanGeometry(
            bearings=np.array([0.0, 1.0]), range_min=0.0, range_max=10.0, T_robot_laser=np.array(T_robot_laser)
        )


@pytest.mark.parametrize(
    "changed",
    [
        {"odometry": np.full((2, 3), np.nan)},
        {"odometry": np.full((2, 3), 1e8)},
        {"odometry": np.zeros((3, 3))},
        {"ranges": np.full((2, 3), np.inf, dtype=np.float32)},
        {"ranges": np.full((2, 4), 1.0, dtype=np.float32)},
        {"stamps": np.array([0.0, np.nan])},
        {"stamps": np.zeros(3)},
        {"truth": np.full((2, 3), np.inf)},
    ],
)
def test_arrays_that_are_no_log_are_refused(changed: dict[str, Any]) -> None:
    geometry = ScanGeometry(bearings=np.array([-0.1, 0.0, 0.1]), range_min=0.0, range_max=10.0)
    sound = Log(
        ranges=np.ones((2, 3), dtype=np.float32),
        odometry=np.zeros((2, 3)),
        stamps=np.zeros(2),
        geometry=geometry,
        path=Path("made.clf"),
    )
    with pytest.raises(ScanError, match=r"made\.clf: "):
        replace(sound, **changed)


def test_odometry_that_jumps_farther_than_anything_drives_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.clf"
    path.write_text("\n".join(flaser(k, x="5000" if k == 3 else None) for k in range(6)) + "\n")
    with pytest.raises(LogError, match=r"x\.clf: found odometry that jumps by 4999\.8 m from scan 2 to the next"):
        read_log(path)

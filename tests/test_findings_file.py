"""`run.npz`: the same numbers and bytes again, and nothing believed that it may not hold."""

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Log
from iceg.findings_file.archive import read_arrays, write_arrays
from iceg.findings_file.codec import VERSION, read_findings, write_findings
from iceg.findings_file.errors import FindingsError
from iceg.findings_file.log_arrays import log_arrays, log_facts, log_of
from iceg.findings_file.table import Table
from tests.fuzz import seeds

Arrays = dict[str, NDArray[Any]]


@pytest.fixture(scope="module")
def content() -> bytes:
    return seeds.findings()


@pytest.fixture
def file(content: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    return path


def test_written_again_it_is_the_same_to_the_byte(file: Path, tmp_path: Path) -> None:
    findings = read_findings(file)
    assert [key.index for key in findings.track.keys] == [0, 2, 4]
    assert [attempt.reason for attempt in findings.solution.attempts] == ["fits"]
    assert [factor.kind for factor in findings.solution.factors] == ["prior", "odometry", "ice", "closure"]
    write_findings(tmp_path / "again.npz", findings)
    assert (tmp_path / "again.npz").read_bytes() == file.read_bytes()


def test_numpy_reads_it(file: Path) -> None:
    with np.load(file, allow_pickle=False) as arrays:
        assert arrays["log_ranges"].dtype == np.uint16, "ranges in whole centimetres need no more"
        assert json.loads(arrays["facts"].tobytes())["version"] == VERSION


@pytest.mark.parametrize("step", [0.01, 0.001, 0.003712])
def test_ranges_come_back_as_they_were(step: float, tmp_path: Path) -> None:
    readings = (np.arange(200).reshape(4, 50) * step + 0.05).astype(np.float32)
    readings[1, 3] = np.nan
    log = Log.from_arrays(readings, field_of_view=3.0, range_max=30.0)
    write_arrays(tmp_path / "log.npz", log_arrays(log))
    table = Table(tmp_path / "log.npz", read_arrays(tmp_path / "log.npz", "a log"))
    again = log_of(table, json.loads(json.dumps(log_facts(log))))
    np.testing.assert_array_equal(again.ranges, log.ranges)
    assert again.ranges.dtype == np.float32


def changed(path: Path, change: Callable[[Arrays], None]) -> Path:
    arrays = dict(read_arrays(path, "a run"))
    change(arrays)
    write_arrays(path, arrays)
    return path


def facts_with(**others: object) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        facts = {**json.loads(arrays["facts"].tobytes()), **others}
        arrays["facts"] = np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)

    return change


def break_with(**others: object) -> Callable[[Arrays], None]:
    found = {"key": 1, "outcome": "doubtful", "reason": "", "closures": 0, "moved": 0.0, "across": 0, "scan": None}

    def change(arrays: Arrays) -> None:
        solution = json.loads(arrays["facts"].tobytes())["solution"]
        facts_with(solution={**solution, "breaks": [{**found, **others}]})(arrays)

    return change


def array_of(name: str, value: object) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[name] = np.array(value)

    return change


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (facts_with(version=99), f"found version 99, expected {VERSION}: run the log again"),
        (facts_with(config="[grid]\nresolution = -1"), "resolution"),
        (facts_with(config="from os import system"), "not valid TOML"),
        (facts_with(calibration={}), "it lacks"),
        (facts_with(kept={"recorded_scans": 5, "kept": [[0, 5]]}), "of 5, expected some in order"),
        (facts_with(kept={"recorded_scans": 9, "kept": [[0, 6]]}), "and holds 6"),
        (break_with(probability=1.5), "found the probability 1.5, expected 0 to 1"),
        (break_with(probability=float("nan")), "found the probability nan, expected 0 to 1"),
        (break_with(probability="likely"), "found the probability likely, expected 0 to 1"),
        (break_with(), "it lacks 'probability'"),
        (array_of("key_scan", [0, 9, 4]), "'key_scan' holds numbers from 0 to 9"),
        (array_of("key_scan", [0, 4, 2]), "not in the order of the log"),
        (array_of("scan_key", [0, 0, 1, 1, 2, 7]), "'scan_key'"),
        (array_of("factor_ends", [[-1, 0], [0, 1], [1, 2], [0, 5]]), "'factor_ends'"),
        (array_of("factor_covariance", np.zeros((4, 3, 3))), "covariance"),
        (array_of("graph_poses", np.full((3, 3), np.nan)), "not finite"),
        (array_of("closure_n_places", [10**5]), "closure_places"),
        (array_of("closure_keys", [[2, 0]]), "earlier and a later"),
        (array_of("log_bearings", np.zeros(37)), "bearings"),
        (array_of("log_stamps", ["now"] * 6), "of type"),
        (lambda arrays: arrays.pop("facts"), "it holds no 'facts'"),
        (lambda arrays: arrays.pop("scan_T_key"), "it holds no 'scan_T_key'"),
    ],
)
def test_what_cannot_be_is_refused(file: Path, change: Callable[[Arrays], None], complaint: str) -> None:
    with pytest.raises(FindingsError, match=rf"run\.npz: cannot be read .*{complaint}"):
        read_findings(changed(file, change))


def of_entry(name: str, data: bytes, compression: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        archive.writestr(name, data)
    return stream.getvalue()


def header_of(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"PK\x03\x04",
        b"not a zip at all",
        of_entry("facts.npy", b"nothing of NumPy's"),
        of_entry("facts.npy", header_of((10**12,))),
        of_entry("facts.npy", header_of((-1, -8)) + bytes(64)),
        of_entry("facts.npy", header_of((1,), "|O") + bytes(8)),
        of_entry("facts.npy", header_of((10**6,)) + bytes(8 * 10**6), zipfile.ZIP_DEFLATED),
    ],
)
def test_no_archive_unpacks_to_more_than_it_is(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(FindingsError, match=r"run\.npz: cannot be read as the findings of a run"):
        read_findings(tmp_path / "run.npz")


def test_numbers_changed_at_random_are_read_or_refused(content: bytes, tmp_path: Path) -> None:
    # Beneath the checksums of the archive, as somebody may who means harm.
    random, path = np.random.default_rng(3), tmp_path / "run.npz"
    path.write_bytes(content)
    sound = read_arrays(path, "a run")
    names, refused = [name for name in sound if sound[name].size], 0
    for _ in range(60):
        name = names[int(random.integers(len(names)))]
        damaged = bytearray(sound[name].tobytes())
        damaged[int(random.integers(len(damaged)))] ^= 1 << int(random.integers(8))
        value = np.frombuffer(bytes(damaged), dtype=sound[name].dtype).reshape(sound[name].shape)
        write_arrays(path, {**sound, name: value})
        try:
            read_findings(path)
        except FindingsError:
            refused += 1
    assert 0 < refused < 60

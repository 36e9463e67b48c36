"""The benchmark's own arithmetic: which logs, thinned logs and relations, tables."""

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest

import iceg
from graph.se2 import between
from iceg.evaluation.bench.logs import BenchLog, find_logs
from iceg.evaluation.bench.runs import accuracy_and_speed, run_in_fresh_process
from iceg.evaluation.bench.tables import Row, format_markdown, write_csv
from iceg.evaluation.bench.thinned_logs import thinned, thinned_relations
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import Relations, relation_errors


def test_the_embedded_log_is_always_there_and_public_ones_as_found(tmp_path: Path) -> None:
    assert [log.name for log in find_logs(None)] == ["office (embedded)"]
    for name in ("aces.clf.gz", "aces.reference.csv", "intel.clf.gz", "mit-csail.relations.csv"):
        (tmp_path / name).touch()
    embedded, intel, aces = find_logs(tmp_path)
    assert embedded.relations is None
    assert intel.known is None
    assert intel.judge(tmp_path) == {}
    assert aces.known == tmp_path / "aces.reference.csv"


def test_a_thinned_log_keeps_every_fifth_scan() -> None:
    log = iceg.read_log(iceg.demo_log_path())
    kept = [thinned(log, phase) for phase in range(5)]
    assert sum(map(len, kept)) == len(log)
    np.testing.assert_array_equal(kept[3].odometry[7], log.odometry[38])
    np.testing.assert_array_equal(kept[3].ranges[7], log.ranges[38])


def test_thinned_relations_join_the_same_poses() -> None:
    rng = np.random.default_rng(0)
    poses = rng.uniform(-3, 3, (200, 3))
    scans = rng.integers(0, 200, (500, 2))
    relations = Relations(
        scans_i=scans[:, 0],
        scans_j=scans[:, 1],
        T_i_j=between(poses[scans[:, 0]], poses[scans[:, 1]]),
        dropped=0,
        path=Path("here.csv"),
    )
    left = [thinned_relations(relations, phase) for phase in range(5)]
    assert 0 < sum(map(len, left)) < 200
    for phase, some in enumerate(left):
        assert some.dropped == len(relations) - len(some)
        assert relation_errors(poses[phase::5], some).translation.max() < 1e-9


def test_tables_say_the_same_to_people_and_programs(tmp_path: Path) -> None:
    rows: list[Row] = [{"log": "a", "error [m]": 0.012345, "n": 7}, {"log": "b", "error [m]": None, "time [s]": 1.5}]
    lines = format_markdown(rows).splitlines()
    assert [cell.strip() for cell in lines[2].split("|")[1:-1]] == ["a", "0.0123", "7", ""]
    assert [cell.strip() for cell in lines[3].split("|")[1:-1]] == ["b", "", "", "1.50"]
    assert len({len(line) for line in lines}) == 1
    write_csv(rows, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        first, second = csv.DictReader(file)
    assert float(first["error [m]"]) == pytest.approx(0.012345)
    assert second["n"] == ""


def test_a_run_in_a_fresh_process_is_judged_and_timed(tmp_path: Path) -> None:
    with gzip.open(iceg.demo_log_path(), "rt") as lines:
        scans = [line for line in lines if line.startswith("FLASER")]
    (tmp_path / "short.clf").write_text("".join(scans[:40]))
    truth = tmp_path / "short.truth.csv"
    truth.write_text("".join(iceg.demo_truth_path().read_text().splitlines(keepends=True)[:41]))
    log = BenchLog(name="short", path=tmp_path / "short.clf", known=truth)
    accuracy, speed = accuracy_and_speed(log, "matching alone", tmp_path)
    assert accuracy["scans"] == speed["scans"] == 40
    assert accuracy["closures"] == 0
    assert 0 < float(accuracy["ATE [m]"] or 0) < 0.1
    assert float(speed["CPU [s]"] or 0) > 0
    assert (tmp_path / "short-matching-alone" / "summary.json").exists()


def test_a_run_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"nowhere\.clf"):
        run_in_fresh_process(tmp_path / "nowhere.clf", tmp_path / "out")

"""Results as tables for pandas, CSV and Parquet; every scan's covariance; what notebooks show."""

import base64
import csv
import io
import re
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import iceg
from frontends.scan import Log
from graph.factors import Factor
from iceg.evaluation.consistency import pose_nees
from iceg.evaluation.truth import read_truth
from iceg.result_tables import TABLES, TableExportError, TableName, write_csv_table, write_parquet_table
from iceg.run_result.run_summary import LaserSummary, OdometrySummary, RoundSummary, RunSummary
from iceg.run_result.scan_covariances import scan_covariances, tracking_covariances
from iceg.run_result.slam_result import SlamResult

N_SCANS = 300


@pytest.fixture(scope="module")
def result() -> SlamResult:
    whole = iceg.read_log(iceg.demo_log_path())
    log = Log(
        ranges=whole.ranges[:N_SCANS],
        odometry=whole.odometry[:N_SCANS],
        stamps=whole.stamps[:N_SCANS],
        geometry=whole.geometry,
        path=whole.path,
    )
    return iceg.run(log)


@pytest.fixture(scope="module")
def folder(result: SlamResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "run"
    iceg.write_results(result, path)
    return path


def test_frames_hold_what_the_result_does(result: SlamResult) -> None:
    frames = {name: result.to_frame(name) for name in TABLES}
    assert {name: len(frame) for name, frame in frames.items()} == {
        "trajectory": N_SCANS,
        "key_poses": len(result.key_scans),
        "closures": len(result.closures),
        "landmarks": len(result.landmarks),
        "factors": len(result.graph.factors),
    }
    np.testing.assert_array_equal(frames["trajectory"][["x_m", "y_m", "theta_rad"]].to_numpy(), result.trajectory)
    at_keys = frames["trajectory"].loc[frames["key_poses"]["scan"], ["xx", "xy", "thetatheta"]].to_numpy()
    np.testing.assert_allclose(at_keys, result.covariances[:, [0, 0, 2], [0, 1, 2]], atol=1e-15)
    factors = frames["factors"]
    assert factors["kind"].value_counts().to_dict() == {k: n for k, n in result.summary["factors"].items() if n}
    steps = factors[factors["kind"] == "odometry"]
    assert (steps["j"] == steps["i"] + 1).all()
    assert (steps["scan_j"] == result.key_scans[steps["j"]]).all()
    assert (factors[factors["kind"] == "prior"][["i", "scan_i"]] == -1).all(axis=None)


def test_the_folder_holds_the_same_tables(result: SlamResult, folder: Path) -> None:
    again = iceg.read_run_tables(folder)
    for name in TABLES:
        expected, found = result.to_frame(name), again.frame(name)
        given = [column for column in map(str, expected) if not column.startswith(("distance", "direction", "stamp"))]
        pd.testing.assert_frame_equal(found[given], expected[given], rtol=1e-4, atol=1e-6, check_dtype=False)


@pytest.mark.parametrize("name", TABLES)
def test_csv_and_parquet_read_back(result: SlamResult, tmp_path: Path, name: TableName) -> None:
    columns, frame = result.tables().columns(name), result.to_frame(name)
    write_csv_table(tmp_path / "t.csv", columns)
    write_parquet_table(tmp_path / "t.parquet", columns)
    with (tmp_path / "t.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert (header, len(rows)) == (list(frame), len(frame))
    x = [float(row[header.index("x_m")] or "nan") for row in rows]
    np.testing.assert_array_equal(x, frame["x_m"])
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "t.parquet"), frame, check_dtype=False)
    first = (tmp_path / "t.parquet").read_bytes()
    write_parquet_table(tmp_path / "t.parquet", columns)
    assert (tmp_path / "t.parquet").read_bytes() == first


def test_a_table_that_there_is_not(result: SlamResult) -> None:
    with pytest.raises(TableExportError, match="found the table 'poses', expected one of trajectory, key_poses"):
        result.tables().frame("poses")


def test_without_pandas_a_frame_says_what_to_install(result: SlamResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(TableExportError, match=r"pip install 'iceg\[tables\]'"):
        result.to_frame("closures")


def test_scans_between_key_scans_are_as_honest_as_these(result: SlamResult) -> None:
    truth = read_truth(iceg.demo_truth_path()).poses[:N_SCANS]
    covariances = result.scan_covariances()
    assert np.linalg.eigvalsh(covariances).min() > 0
    values = pose_nees(result.trajectory, truth, covariances)
    between = np.setdiff1d(np.arange(1, N_SCANS), result.key_scans) - 1
    keys = pose_nees(result.key_poses, truth[result.key_scans], result.covariances)
    assert 0.3 * keys.mean() < values[between].mean() < 1.5 * max(3.0, keys.mean())


def test_covariances_between_two_key_scans_by_hand() -> None:
    trajectory = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    at_keys = np.array([np.diag([0.01, 0.01, 0.0]), np.diag([0.03, 0.05, 0.0])])
    tracking = np.array([np.eye(3), np.diag([0.004, 0.008, 0.002])])
    found = scan_covariances(trajectory, np.array([0, 4]), at_keys, tracking)
    np.testing.assert_allclose(found[0], at_keys[0], atol=1e-15)
    np.testing.assert_allclose(found[2], np.diag([0.02 + 0.004, 0.03 + 0.008, 0.002]), atol=1e-15)
    np.testing.assert_allclose(found[4], at_keys[1], atol=1e-15)
    turned = np.array([np.diag([0.0, 0.0, 0.01])])
    lever = scan_covariances(trajectory, np.array([0]), turned, np.array([np.diag([0.0, 0.0, 1.0])]))[3]
    np.testing.assert_allclose(lever, np.array([[0.0, 0, 0], [0, 0.09, 0.03], [0, 0.03, 1.01]]), atol=1e-15)


def test_a_match_that_sees_nothing_along_a_corridor_leaves_it_to_odometry() -> None:
    blind, wheels = np.diag([1.0, 1e-6, 1e-6]), np.diag([1e-4, 1e-4, 1e-4])
    step = np.array([0.3, 0.0, 0.0])
    factors = [
        Factor(kind="ice", i=0, j=1, T_i_j=step, covariance=blind),
        Factor(kind="odometry", i=0, j=1, T_i_j=step, covariance=wheels),
    ]
    found = tracking_covariances(factors, 3, (0.02, 0.01))
    assert np.diag(found[1]) == pytest.approx([1e-4, 1e-6, 1e-6], rel=0.02)
    np.testing.assert_allclose(found[2], np.diag([4e-4, 4e-4, 1e-4]))


def test_notebooks_show_a_map_and_figures(result: SlamResult) -> None:
    shown = result._repr_html_()
    found = re.search(r"base64,([A-Za-z0-9+/=]+)'", shown)
    assert found is not None
    picture = Image.open(io.BytesIO(base64.b64decode(found[1])))
    assert 200 < max(picture.size) <= 2000
    assert f"<td style='text-align:left'>{N_SCANS}, {len(result.key_scans)} key poses</td>" in shown
    assert "http" not in shown
    assert shown == result._repr_html_()


def test_what_a_notebook_prints_is_short(result: SlamResult) -> None:
    n = result.summary["factors"]
    assert repr(result.graph).startswith(f"PoseGraph({len(result.key_poses)} poses; factors: ")
    assert f"{n['ice']} ice, {n['odometry']} odometry, 1 prior)" in repr(result.graph)
    settled = len(result.landmarks.settled())
    kinds = r"\d+ corner, \d+ end_of_wall, \d+ intersection, \d+ expired"
    shown = rf"Landmarks\({len(result.landmarks)}, {settled} of them settled: {kinds}\)"
    assert re.fullmatch(shown, repr(result.landmarks))


def test_whatever_a_notebook_prints_of_a_run_is_a_line(result: SlamResult) -> None:
    scan, track = result.log.scan(0), result.findings.track
    things = [result.log.geometry, scan, result.grid, result.walls, result.joint, result.config, track, track.keys[1]]
    things += [result.closures[0], result.graph.factors[3], track.keys[1].match]
    things += [result.tables(), iceg.extract_segments(scan), iceg.extract_features(scan), iceg.IceConfig()]
    things += [iceg.Mapper(result.log.geometry), iceg.Trajectory(stamps=result.log.stamps, poses=result.trajectory)]
    for thing in [*things, result.findings]:
        shown = repr(thing)
        assert shown.startswith(f"{type(thing).__name__}(")
        assert "\n" not in shown
        assert len(shown) < 1200 + 2800 * (thing is result.findings), shown
    assert repr(scan) == f"Scan({np.isfinite(scan.ranges).sum()} of 181 beams returned)"
    assert repr(result.log.geometry).startswith("ScanGeometry(181 beams from -90° to 90°, ")
    assert repr(iceg.Config(seed=3)) == "Config(seed=3)"


def test_every_public_name_is_there() -> None:
    code = "import iceg\nfor name in iceg.__all__: assert getattr(iceg, name) is not None, name\nprint('all')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "all\n", done.stderr
    assert {"ManualClosure", "Closure", "read_run_tables", "to_gtsam_graph"} <= set(iceg.__all__)


def test_the_summary_holds_what_its_type_says(result: SlamResult) -> None:
    assert set(result.summary) == RunSummary.__required_keys__
    for done in result.summary["finish"]:
        assert set(done) == set(get_type_hints(RoundSummary))
    assert set(result.summary["odometry"]) == set(get_type_hints(OdometrySummary))
    assert result.summary["laser"] is not None
    assert set(result.summary["laser"]) == set(get_type_hints(LaserSummary))

"""The whole job on the first metres of the embedded log, from the command line and from Python."""

import gzip
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

import iceg
from graph.g2o import read_g2o
from iceg.cli import main
from iceg.demo import demo_log_path, demo_truth_path
from iceg.results import RESULT_FILES
from iceg.run_folder import read_run_folder

N_SCANS = 150


@pytest.fixture(scope="module")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "short.clf"
    with gzip.open(demo_log_path(), "rt", encoding="ascii") as lines:
        scans = (line for line in lines if line.startswith("FLASER"))
        path.write_text("".join(itertools.islice(scans, N_SCANS)), encoding="ascii")
    return path


@pytest.fixture(scope="module")
def run_folder(short_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "first"
    assert main(["run", str(short_log), "-o", str(folder)]) == 0
    return folder


def test_a_run_leaves_all_its_files(run_folder: Path) -> None:
    assert sorted(path.name for path in run_folder.iterdir()) == sorted(RESULT_FILES)
    summary = json.loads((run_folder / "summary.json").read_text())
    assert summary["scans"] == N_SCANS
    run = read_run_folder(run_folder)
    assert len(run.trajectory) == N_SCANS
    assert len(run.key_scans) == summary["key_poses"]
    assert len(run.landmarks) > 0
    np.testing.assert_allclose(run.key_poses, run.trajectory.poses[run.key_scans], atol=1e-8)
    graph = read_g2o(run_folder / "graph.g2o")
    np.testing.assert_allclose(graph.poses, run.key_poses, atol=1e-6)
    assert len(graph.factors) == sum(summary["factors"].values())


def test_a_second_run_gives_the_same_bytes(run_folder: Path, short_log: Path, tmp_path: Path) -> None:
    assert main(["run", str(short_log), "-o", str(tmp_path)]) == 0
    for name in RESULT_FILES:
        if name != "summary.json":
            assert _lasting(tmp_path / name) == _lasting(run_folder / name), name


def _lasting(path: Path) -> bytes:
    """The content of a result, but for the seconds a stage took that stand on a line of the report."""
    return re.sub(rb'<script type="application/json" id="stages">.*', b"", path.read_bytes())


def test_a_run_can_do_without_its_report(short_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(short_log), "-o", str(tmp_path), "--no-report"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({*RESULT_FILES} - {"report.html"})
    assert "report.html" not in capsys.readouterr().out


def test_with_a_truth_the_report_tells_the_error(short_log: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    lines = demo_truth_path().read_text().splitlines()
    truth.write_text("\n".join(lines[: N_SCANS + 1]) + "\n")
    assert main(["run", str(short_log), "-o", str(tmp_path / "out"), "--truth", str(truth)]) == 0
    assert '"rmse_m":' in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    truth.write_text("\n".join(lines[:N_SCANS]) + "\n")
    assert main(["run", str(short_log), "-o", str(tmp_path / "other"), "--truth", str(truth)]) == 1


def test_the_result_lies_near_the_truth(run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("\n".join(demo_truth_path().read_text().splitlines()[: N_SCANS + 1]) + "\n")
    assert main(["eval", str(run_folder), "--truth", str(truth), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["ate_rmse"] < 0.1
    assert figures["nees_n"] > 10


def test_its_own_settings_file_repeats_a_run(run_folder: Path, short_log: Path, tmp_path: Path) -> None:
    words = ["run", str(short_log), "-o", str(tmp_path), "--config", str(run_folder / "config.toml")]
    assert main(words) == 0
    assert (tmp_path / "trajectory.tum").read_bytes() == (run_folder / "trajectory.tum").read_bytes()
    assert (tmp_path / "config.toml").read_bytes() == (run_folder / "config.toml").read_bytes()


def test_pictures_are_drawn_again(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", str(run_folder)]) == 0
    pictures = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert [path.name for path in pictures] == ["map.png", "trajectory.png", "uncertainty.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)
    for path in pictures[1:]:
        path.unlink()


def test_a_grid_beyond_its_limit_costs_resolution_and_nothing_else(
    run_folder: Path, short_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(short_log), "-o", str(tmp_path), "--grid.max-cells", "5000"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(RESULT_FILES)
    assert (tmp_path / "trajectory.tum").read_bytes() == (run_folder / "trajectory.tum").read_bytes()
    grid = read_run_folder(tmp_path).grid
    assert grid.log_odds.size <= 5000
    (warning,) = json.loads((tmp_path / "summary.json").read_text())["warnings"]
    assert f"{grid.resolution:g} m wide instead of 0.05 m" in warning
    assert "max_cells" in warning
    assert f"warning: {warning}" in capsys.readouterr().err


def test_five_lines_of_python_do_the_same(run_folder: Path, short_log: Path) -> None:
    log = iceg.read_log(short_log)
    result = iceg.run(log)
    assert result.trajectory.shape == (N_SCANS, 3)
    assert result.covariances.shape == (len(result.key_poses), 3, 3)
    assert result.grid.occupancy().ndim == 2
    np.testing.assert_allclose(result.trajectory, read_run_folder(run_folder).trajectory.poses, atol=1e-8)

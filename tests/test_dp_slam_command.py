"""`iceg dp-slam`: the command, its files and its settings, with few particles on the first metres of a room."""

import gzip
import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frontends.dp_slam import DpSlamConfig
from frontends.logs.carmen import write_carmen
from frontends.simulator.output import write_truth
from frontends.simulator.simulation import Simulation, simulate
from iceg.cli import main
from iceg.cli.parsing import parse
from iceg.cli.run import DpSlam
from iceg.dp_slam_results import DP_SLAM_FILES
from iceg.evaluation.paper import first_scans
from iceg.evaluation.trajectory import trajectory_errors
from iceg.results import RESULT_FILES, ResultsError
from iceg.run_folder import read_ros_map, read_run_folder
from iceg.settings_file import read_settings
from iceg.tum import read_tum

N_SCANS = 40
FEW = ("--particles", "10", "--samples", "60", "--resolution", "0.06")


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return first_scans(simulate("room", seed=3), N_SCANS)


@pytest.fixture(scope="module")
def log_file(simulation: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "room.clf"
    write_carmen(path, simulation.log)
    return path


@pytest.fixture(scope="module")
def folder(log_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "dp-slam"
    assert main(["dp-slam", str(log_file), "-o", str(folder), *FEW]) == 0
    return folder


def test_it_leaves_the_files_that_apply(folder: Path, simulation: Simulation) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(DP_SLAM_FILES)
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["method"], summary["scans"], summary["particles"]) == ("dp-slam", N_SCANS, 10)
    assert summary["versions"]["iceg"]
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")
    trajectory = read_tum(folder / "trajectory.tum")
    assert len(trajectory) == N_SCANS
    assert trajectory_errors(trajectory.poses, simulation.truth).ate_rmse < 0.15


def test_its_map_knows_where_the_robot_drove_and_where_the_walls_are(folder: Path, simulation: Simulation) -> None:
    grid = read_ros_map(folder / "map.yaml")
    poses = read_tum(folder / "trajectory.tum").poses
    assert (grid.classes()[grid.cell(poses[:, :2])] == 0).mean() > 0.5  # the first poses lie behind the laser's view
    scan = simulation.log.scan(0)
    near = np.hypot(*scan.points.T) < 7.5
    occupied = np.argwhere(grid.classes() == 100)[:, ::-1] * grid.resolution + grid.origin + grid.resolution / 2
    distances = np.hypot(*(scan.points[near, None] - occupied).T).min(axis=0)
    assert np.median(distances) < 0.1


def test_its_pictures_are_drawn_again_from_what_there_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "map.png").unlink()
    assert main(["plot", str(copy)]) == 0
    assert capsys.readouterr().out.splitlines() == [str(copy / "map.png"), str(copy / "trajectory.png")]
    assert all((copy / name).read_bytes().startswith(b"\x89PNG") for name in ("map.png", "trajectory.png"))
    with pytest.raises(ResultsError, match="holds results of DP-SLAM, which has no graph"):
        read_run_folder(copy)


def test_the_same_settings_file_gives_the_same_bytes(folder: Path, log_file: Path, tmp_path: Path) -> None:
    assert read_settings(DpSlamConfig, folder / "config.toml") == DpSlamConfig(
        particles=10, samples=60, resolution=0.06
    )
    config = str(folder / "config.toml")
    assert main(["dp-slam", str(log_file), "-o", str(tmp_path), "--config", config]) == 0
    for name in ("trajectory.tum", "map.pgm", "map.yaml", "config.toml"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_flags_override_the_settings_file(tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("particles = 7\nseed = 5\n")
    command = parse(["dp-slam", "a.clf", "-o", "out", "--config", str(settings), "--particles", "9"])
    assert isinstance(command, DpSlam)
    assert (command.settings.particles, command.settings.seed, command.settings.samples) == (9, 5, 500)
    settings.write_text("particle = 7\n")
    assert main(["dp-slam", "a.clf", "-o", "out", "--config", str(settings)]) == 2


def test_earlier_results_are_safe_without_overwrite(
    folder: Path, log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / "trajectory.tum").stat().st_mtime_ns
    assert main(["dp-slam", str(log_file), "-o", str(folder), *FEW]) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (folder / "trajectory.tum").stat().st_mtime_ns == before
    for name in RESULT_FILES:
        (tmp_path / name).write_text("of another run")
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["dp-slam", str(log_file), "-o", str(tmp_path), *FEW, "--overwrite"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*DP_SLAM_FILES, "notes.txt"])


def test_progress_counts_the_scans(log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dp-slam", str(log_file), "-o", str(tmp_path), *FEW]) == 0
    printed = capsys.readouterr()
    assert f"{N_SCANS}/{N_SCANS} scans" in printed.err
    assert "filtering" in printed.err
    assert "matching" not in printed.err
    assert f"{N_SCANS} scans in" in printed.out


def test_its_trajectory_is_judged_like_any_other(
    folder: Path, simulation: Simulation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = tmp_path / "truth.csv"
    write_truth(truth, simulation)
    assert main(["eval", str(folder), "--truth", str(truth), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ate_rmse"] < 0.15


def test_it_runs_on_the_authors_own_log(data_dir: Path, tmp_path: Path) -> None:
    with gzip.open(data_dir / "dpslam-loop5.log.gz", "rt", encoding="ascii") as lines:
        start = list(itertools.islice(lines, 120))
    (tmp_path / "loop5.log").write_text("".join(start), encoding="ascii")
    assert main(["dp-slam", str(tmp_path / "loop5.log"), "-o", str(tmp_path / "out"), *FEW]) == 0
    poses = read_tum(tmp_path / "out" / "trajectory.tum").poses
    assert len(poses) == sum(line.startswith("Laser") for line in start)
    assert (read_ros_map(tmp_path / "out" / "map.yaml").classes() == 100).sum() > 200


def test_a_log_without_odometry_is_refused(
    simulation: Simulation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = replace(simulation.log, odometry=np.zeros((N_SCANS, 3)))
    write_carmen(tmp_path / "still.clf", still)
    assert main(["dp-slam", str(tmp_path / "still.clf"), "-o", str(tmp_path / "out")]) == 1
    assert "no odometry" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

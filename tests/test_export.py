"""`iceg export`: other programs' own readers find in the files what the run found."""

import gzip
import itertools
from pathlib import Path

import gtsam
import numpy as np
import pytest
from evo.tools import file_interface

import iceg
from graph.g2o import read_g2o
from graph.gtsam_bridge import from_gtsam_values
from graph.se2 import compose
from iceg.cli import main
from iceg.export.formats import FORMATS
from iceg.result_tables import TABLES
from iceg.tum import read_tum

N_SCANS = 120


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "short.clf"
    with gzip.open(iceg.demo_log_path(), "rt", encoding="ascii") as lines:
        scans = (line for line in lines if line.startswith("FLASER"))
        path.write_text("".join(itertools.islice(scans, N_SCANS)), encoding="ascii")
    return path


@pytest.fixture(scope="module")
def run(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["run", str(log), "-o", str(folder)]) == 0
    return folder


def exported(run: Path, out: Path, to: str, *words: str) -> Path:
    assert main(["export", str(run), "--to", to, "-o", str(out), *words]) == 0
    return out


def matrices(poses: np.ndarray) -> np.ndarray:
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    T[:, 0, 0] = T[:, 1, 1] = np.cos(poses[:, 2])
    T[:, 1, 0], T[:, 0, 1] = np.sin(poses[:, 2]), -np.sin(poses[:, 2])
    T[:, :2, 3] = poses[:, :2]
    return T


def test_evo_reads_trajectories_in_each_format(run: Path, tmp_path: Path) -> None:
    expected = read_tum(run / "trajectory.tum")
    tum = file_interface.read_tum_trajectory_file(str(exported(run, tmp_path / "a.tum", "tum")))
    euroc = file_interface.read_euroc_csv_trajectory(str(exported(run, tmp_path / "a.csv", "euroc")))
    kitti = file_interface.read_kitti_poses_file(str(exported(run, tmp_path / "a.txt", "kitti")))
    for read in (tum, euroc, kitti):
        np.testing.assert_allclose(np.array(read.poses_se3), matrices(expected.poses), atol=1e-8)
    for stamped in (tum, euroc):
        np.testing.assert_allclose(stamped.timestamps, expected.stamps, atol=1e-6)
    first = [line.split()[0] for line in (tmp_path / "a.tum").read_text().splitlines()]
    assert first == [line.split()[0] for line in (run / "trajectory.tum").read_text().splitlines()]


def test_stamps_are_repaired_on_request(run: Path, tmp_path: Path) -> None:
    lines = (run / "trajectory.tum").read_text().splitlines()
    jittering = tmp_path / "run"
    jittering.mkdir()
    swapped = [*lines[:10], lines[11], lines[10], *lines[12:]]
    (jittering / "trajectory.tum").write_text("\n".join(swapped) + "\n")
    repaired = read_tum(exported(jittering, tmp_path / "a.tum", "tum", "--stamps", "repaired"))
    recorded = read_tum(exported(jittering, tmp_path / "b.tum", "tum"))
    assert np.diff(recorded.stamps).min() < 0 < np.diff(repaired.stamps).min()
    np.testing.assert_array_equal(repaired.poses, recorded.poses)


def test_the_corrected_log_holds_the_scans_where_the_run_puts_them(log: Path, run: Path, tmp_path: Path) -> None:
    recorded = iceg.read_log(log)
    corrected = iceg.read_log(exported(run, tmp_path / "corrected.clf.gz", "carmen", "--log", str(log)))
    trajectory = read_tum(run / "trajectory.tum").poses
    np.testing.assert_allclose(corrected.odometry, trajectory, atol=2e-6)
    np.testing.assert_allclose(corrected.ranges, recorded.ranges, atol=1e-6)
    np.testing.assert_allclose(corrected.stamps, recorded.stamps, atol=1e-6)
    with gzip.open(tmp_path / "corrected.clf.gz", "rt") as file:
        words = next(line for line in file if line.startswith("FLASER")).split()
    pose_of_laser = [float(word) for word in words[2 + 181 : 5 + 181]]
    expected = compose(trajectory[0], recorded.geometry.T_robot_laser)
    np.testing.assert_allclose(pose_of_laser, expected, atol=2e-6)


def test_the_graph_is_the_same_in_g2o_and_in_gtsam(run: Path, tmp_path: Path) -> None:
    kept = read_g2o(run / "graph.g2o")
    again = read_g2o(exported(run, tmp_path / "graph.g2o", "g2o"))
    np.testing.assert_allclose(again.poses, kept.poses, atol=1e-12)
    assert len(again.factors) == len(kept.factors)
    folder = exported(run, tmp_path / "gtsam", "gtsam")
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    factors.deserialize((folder / "factors.txt").read_text())
    values.deserialize((folder / "values.txt").read_text())
    assert factors.size() == len(kept.factors)
    np.testing.assert_allclose(from_gtsam_values(values), kept.poses, atol=1e-12)
    expected = iceg.to_gtsam_graph(kept.factors).error(iceg.to_gtsam_values(kept.poses))
    assert factors.error(values) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_are_one_file_each(run: Path, tmp_path: Path, ending: str) -> None:
    folder = exported(run, tmp_path / "tables", ending)
    assert sorted(path.name for path in folder.iterdir()) == sorted(f"{name}.{ending}" for name in TABLES)
    first = {path.name: path.read_bytes() for path in folder.iterdir()}
    exported(run, folder, ending)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == first


def test_every_format_has_a_place_in_the_run_folder(log: Path, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in run.iterdir() if path.is_file()}
    for to, form in FORMATS.items():
        if to == "bag":
            continue  # this log is none
        more = ["--log", str(log)] if to in ("carmen", "mcap", "rerun") else []
        assert main(["export", str(run), "--to", to, *more]) == 0
        assert capsys.readouterr().out == f"{run / form.name}\n"
    assert {name: (run / name).read_bytes() for name in before} == before


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["RUN", "--to", "carmen"], 2, "--to carmen needs the recorded --log"),
        (["RUN", "--to", "bag"], 2, "--to bag needs the recorded --log"),
        (["RUN", "--to", "bag", "--log", "WHOLE"], 1, "found a log of the format carmen, expected a bag"),
        (["RUN", "--to", "kitti", "--stamps", "repaired"], 2, "goes with tum and euroc"),
        (["RUN", "--to", "carmen", "--log", "WHOLE"], 1, "holds 1848 scans, the trajectory 120"),
        (["RUN", "--to", "tum", "-o", "FOLDER"], 1, "is a folder, expected a file for tum"),
        (["RUN", "--to", "csv", "-o", "FILE"], 1, "is a file, expected a folder for csv"),
        (["RUN", "--to", "csv", "-o", "RUN"], 1, "is the folder of the run"),
        (
            ["RUN", "--to", "carmen", "--log", "LOG", "-o", "LOG"],
            1,
            "holds the recorded log itself, expected another place",
        ),
        (["RUN", "--to", "g2o", "-o", "GRAPH"], 1, "graph.g2o: is a file of the results, expected another one"),
        (["RUN", "--to", "tum", "-o", "NOWHERE"], 1, "cannot be written"),
        (["missing", "--to", "tum"], 1, "missing: is no folder"),
        (["FOLDER", "--to", "g2o"], 1, "graph.g2o: cannot be read"),
    ],
)
def test_what_cannot_be_exported_is_one_clear_line(
    run: Path, tmp_path: Path, words: list[str], code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    places = {
        "RUN": str(run),
        "WHOLE": str(iceg.demo_log_path()),
        "FOLDER": str(tmp_path / "folder"),
        "FILE": str(tmp_path / "file"),
        "LOG": str(tmp_path / "file"),
        "GRAPH": str(run / "graph.g2o"),
        "NOWHERE": str(tmp_path / "no" / "where"),
    }
    assert main(["export", *(places.get(word, word) for word in words)]) == code
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1

"""`iceg eval`: figures against relations, references, truth; what is refused; its help."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.se2 import compose
from iceg import results
from iceg.cli import main
from iceg.cli.judge import Eval
from iceg.demo import demo_log_path
from iceg.tum import format_tum

Array = NDArray[np.float64]


def iceg_process(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "iceg", *words], capture_output=True, text=True, check=False)


def write_trajectory(path: Path, poses: Array) -> Path:
    path.write_text(format_tum(np.arange(len(poses)) / 5, poses))
    return path


def walk(n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1], rng.normal([0.2, 0, 0], [0.05, 0.01, 0.3]))
    return poses


def test_eval_prints_the_published_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = walk(30)
    trajectory = write_trajectory(tmp_path / "t.tum", poses)
    rng = np.random.default_rng(1)
    rows = [(i, j, *rng.normal(0, 1, 3), 1 if k % 4 else 0) for k, (i, j) in enumerate(rng.integers(0, 30, (20, 2)))]
    file = tmp_path / "a.relations.csv"
    file.write_text(
        "scan_i,scan_j,x_m,y_m,theta_rad,certain\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    )
    assert main(["eval", str(trajectory), "--relations", str(file), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)

    distances, angles = [], []
    for i, j, x, y, theta, certain in rows:
        if certain:
            dx, dy = poses[j, :2] - poses[i, :2]
            c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
            distances.append(np.hypot(c * dx + s * dy - x, c * dy - s * dx - y))
            turn = poses[j, 2] - poses[i, 2] - theta
            angles.append(abs(np.degrees(np.arctan2(np.sin(turn), np.cos(turn)))))
    expected = {
        "n": len(distances),
        "trans_mean": np.mean(distances),
        "trans_std": np.std(distances, ddof=1),
        "trans_median": np.median(distances),
        "trans_p95": np.percentile(distances, 95),
        "trans_max": np.max(distances),
        "rot_mean_deg": np.mean(angles),
        "rot_std_deg": np.std(angles, ddof=1),
        "rot_median_deg": np.median(angles),
        "rot_max_deg": np.max(angles),
    }
    for name, value in expected.items():
        assert figures[name] == pytest.approx(float(value), abs=0.51e-5), name
        assert figures[name] == round(figures[name], 5)
    assert figures["dropped"] == 5
    assert main(["eval", str(trajectory), "--relations", str(file)]) == 0
    table = capsys.readouterr().out
    assert f"{figures['trans_mean']:.5f}" in table
    assert "translation, mean [m]" in table


def test_eval_against_a_reference_and_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = walk(40)
    noise = np.random.default_rng(2).normal(0, 0.1, (40, 3))
    trajectory = write_trajectory(tmp_path / "t.tum", compose([1, 2, 3], poses + noise))
    truth, reference = tmp_path / "truth.csv", tmp_path / "reference.csv"
    truth.write_text("t_s,x_m,y_m,theta_rad\n" + "".join(f"0,{x:.9f},{y:.9f},{h:.9f}\n" for x, y, h in poses))
    reference.write_text(
        "scan,x_m,y_m,theta_rad\n" + "".join(f"{k},{x:.9f},{y:.9f},{h:.9f}\n" for k, (x, y, h) in enumerate(poses))
    )
    assert main(["eval", str(trajectory), "--truth", str(truth), "--json"]) == 0
    by_truth = json.loads(capsys.readouterr().out)
    assert main(["eval", str(trajectory), "--reference", str(reference), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == by_truth | {"truth_format": "CSV by scan"}
    assert list(by_truth) == [
        "n", "ate_rmse", "ate_max", "x_mean_abs", "y_mean_abs", "x_var", "y_var", "rot_rmse_deg",
        "rpe_1m_trans_rmse", "rpe_1m_rot_rmse_deg", "rpe_1s_trans_rmse", "rpe_1s_rot_rmse_deg",
        "truth_format", "paired_by", "verdict",
    ]  # fmt: skip
    assert by_truth["n"] == 40
    assert by_truth["ate_rmse"] == pytest.approx(0.14, abs=0.03)


def test_eval_of_a_run_folder_judges_its_covariances(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = walk(400)
    rng = np.random.default_rng(3)
    errors = rng.normal(0, [0.02, 0.03, 0.01], (400, 3))
    errors[0] = 0
    estimated = compose(truth, errors)
    write_trajectory(tmp_path / "trajectory.tum", estimated)
    covariance = np.diag([4e-4, 9e-4, 1e-4])
    result: Any = SimpleNamespace(
        key_scans=np.arange(0, 400, 2), key_poses=estimated[::2], covariances=np.broadcast_to(covariance, (200, 3, 3))
    )
    results._write_covariances(result, tmp_path)
    file = tmp_path / "truth.csv"
    file.write_text("t_s,x_m,y_m,theta_rad\n" + "".join(f"0,{x:.12f},{y:.12f},{h:.12f}\n" for x, y, h in truth))
    assert main(["eval", str(tmp_path), "--truth", str(file), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["nees_n"] == 199
    assert figures["nees_low"] < figures["nees_mean"] < figures["nees_high"]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["eval", "TRAJECTORY"], 2, "expected one"),
        (["eval", "TRAJECTORY", "--reference", "a.csv", "--truth", "b.csv"], 2, "found 2 of"),
        (["eval", "TRAJECTORY", "--relations", "a.relations"], 2, "--log"),
        (["eval", "TRAJECTORY", "--truth", "b.csv", "--log", "a.clf"], 2, "--log is only needed"),
        (["eval", "TRAJECTORY", "--truth", "missing.csv"], 1, "missing.csv: cannot be read"),
        (["eval", "missing.tum", "--truth", "TRUTH"], 1, "missing.tum: cannot be read"),
        (["eval", "TRAJECTORY", "--truth", "TRUTH"], 1, "holds 1 poses, the trajectory 3"),
        (
            ["eval", "TRAJECTORY", "--reference", "ONE"],
            1,
            "one.csv: found 1 pose to compare, an alignment needs at least",
        ),
        (["info", "missing.clf"], 1, "missing.clf"),
        (["run", "missing.clf", "-o", "OUT"], 1, "missing.clf"),
        (
            ["run", "missing.clf", "-o", "OUT", "--closures", "nope.csv"],
            1,
            "nope.csv",
        ),  # told before a long log is read
        (["run", "missing.clf", "-o", "OUT", "--truth", "nope.csv"], 1, "nope.csv"),
        (["convert", "missing.clf", "OUT"], 2, ".parquet, or --to"),
        (["plot", "missing-folder"], 1, "missing-folder"),
        (["run", "missing.clf", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["bench", "--parts", "recall", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["ablation", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["nees", "-o", "BELOW_A_FILE"], 1, "truth.csv is a file, expected a folder"),
        (["simulate", "room", "-o", "OUT", "--seed", "-1"], 2, "found --seed -1, expected 0 or more"),
    ],
)
def test_errors_are_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], code: int, message: str
) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("t_s,x_m,y_m,theta_rad\n0,0,0,0\n")
    (tmp_path / "one.csv").write_text("scan,x_m,y_m,theta_rad\n0,0,0,0\n")
    places = {
        "TRAJECTORY": str(write_trajectory(tmp_path / "t.tum", walk(3))),
        "TRUTH": str(truth),
        "ONE": str(tmp_path / "one.csv"),
        "OUT": str(tmp_path / "out"),
        "BELOW_A_FILE": str(truth / "out"),
    }
    assert main([places.get(word, word) for word in words]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("iceg: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_eval_takes_relations_by_stamp(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from frontends.logs import read_log

    log = read_log(demo_log_path())
    trajectory = write_trajectory(tmp_path / "t.tum", log.odometry)
    first, second = log.stamps[0], log.stamps[10]
    file = tmp_path / "a.relations"
    file.write_text(f"{first:.6f} {second:.6f} 0 0 0 0 0 0\n{first:.6f} {second + 1e6:.6f} 0 0 0 0 0 0\n")
    assert main(["eval", str(trajectory), "--relations", str(file), "--log", str(demo_log_path()), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["n"], figures["dropped"], figures["trans_std"]) == (1, 1, None)
    distance = float(np.hypot(*(log.odometry[10] - log.odometry[0])[:2]))
    assert figures["trans_mean"] == pytest.approx(distance, abs=1e-5)


def test_eval_options_are_documented() -> None:
    done = iceg_process("eval", "--help")
    assert done.returncode == 0
    for flag in ("--relations", "--log", "--reference", "--truth", "--json"):
        assert flag in done.stdout
    assert Eval.__doc__

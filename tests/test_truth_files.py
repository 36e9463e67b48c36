"""`iceg eval --truth` reads what others write, pairs by scan or by stamp, and says which."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.errors import IcegError
from graph.se2 import compose
from iceg.cli import main
from iceg.euroc import format_euroc, read_euroc
from iceg.evaluation.pairing import nearest_by_stamp
from iceg.evaluation.relative_error import path_lengths, relative_error
from iceg.evaluation.truth import read_truth
from iceg.evaluation.verdict import nees_verdict
from iceg.tum import format_tum

Array = NDArray[np.float64]
N = 120


def walk(n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1], rng.normal([0.2, 0, 0], [0.02, 0.01, 0.1]))
    return poses


@pytest.fixture(scope="module")
def stamps() -> Array:
    return 1.4e9 + np.arange(N) / 5


@pytest.fixture(scope="module")
def true() -> Array:
    return walk(N)


@pytest.fixture
def trajectory(tmp_path: Path, stamps: Array, true: Array) -> Path:
    noise = np.random.default_rng(1).normal(0, [0.02, 0.03, 0.01], (N, 3))
    path = tmp_path / "t.tum"
    path.write_text(format_tum(stamps, compose([1.0, 2.0, 3.0], true + noise)))
    return path


def csv_text(header: str, first: Any, poses: Array) -> str:
    rows = "".join(f"{a},{x:.12f},{y:.12f},{h:.12f}\n" for a, (x, y, h) in zip(first, poses, strict=True))
    return f"{header},x_m,y_m,theta_rad\n{rows}"


def written(folder: Path, form: str, stamps: Array, poses: Array) -> Path:
    texts = {
        "TUM": format_tum(stamps, poses),
        "EuRoC": format_euroc(stamps, poses),
        "CSV": csv_text("t_s", [f"{stamp:.6f}" for stamp in stamps], poses),
        "CSV by scan": csv_text("scan", range(len(poses)), poses),
        "CSV by scan and stamp": csv_text("scan,t_s", [f"{k},{t:.6f}" for k, t in enumerate(stamps)], poses),
        "columns t x y theta": "".join(
            f"{t:.6f} {x:.12f} {y:.12f} {h:.12f}\n" for t, (x, y, h) in zip(stamps, poses, strict=True)
        ),
    }
    path = folder / ("truth.csv" if form.startswith(("CSV", "EuRoC")) else "truth.txt")
    path.write_text(texts[form])
    return path


def evaluated(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, Any]:
    assert main(["eval", *map(str, words), "--json"]) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out)
    return figures


@pytest.mark.parametrize("form", ["TUM", "EuRoC", "CSV", "CSV by scan", "CSV by scan and stamp", "columns t x y theta"])
def test_every_format_gives_the_same_figures_and_is_named(
    tmp_path: Path, trajectory: Path, stamps: Array, true: Array, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, form, stamps, true)
    figures = evaluated(capsys, trajectory, "--truth", path)
    assert (figures["truth_format"], figures["paired_by"], figures["n"]) == (form, "scan", N)
    assert figures["ate_rmse"] == pytest.approx(np.hypot(0.02, 0.03), rel=0.2)
    expected = evaluated(capsys, trajectory, "--truth", written(tmp_path, "TUM", stamps, true))
    differing = {"truth_format"}
    assert {k: v for k, v in figures.items() if k not in differing} == {
        k: v for k, v in expected.items() if k not in differing
    }
    assert main(["eval", str(trajectory), "--truth", str(path)]) == 0
    assert f"({form}, {N} of {N} poses paired by scan)" in capsys.readouterr().out.replace("TUM", form)


def test_another_number_of_poses_is_paired_by_stamp(
    tmp_path: Path, trajectory: Path, stamps: Array, true: Array, capsys: pytest.CaptureFixture[str]
) -> None:
    some = np.array([3, 10, 11, 40, 77, 119])
    jitter = np.array([0.004, -0.01, 0.0, 0.019, 0.5, 0.0])
    path = written(tmp_path, "TUM", stamps[some] + jitter, true[some])
    figures = evaluated(capsys, trajectory, "--truth", path)
    assert (figures["paired_by"], figures["n"]) == ("stamp", 5)
    assert figures["matched"] == pytest.approx(5 / 6, abs=1e-5)
    near = np.delete(some, 4)
    by_scan = tmp_path / "reference.csv"
    by_scan.write_text(csv_text("scan", near, true[near]))
    expected = evaluated(capsys, trajectory, "--truth", by_scan)
    for name in ("n", "ate_rmse", "ate_max", "rot_rmse_deg", "x_var"):
        assert figures[name] == expected[name], name


@pytest.fixture
def evaluate(data_dir: Path) -> ModuleType:
    """An evaluator kept apart from the project's own, where it lies beside the real logs."""
    path = data_dir.parent / "tools" / "evaluate.py"
    if not path.exists():
        pytest.skip(f"no independent evaluator at {path}")
    spec = importlib.util.spec_from_file_location("evaluate", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@given(st.integers(0, 2**16))
def test_pairs_are_evos(seed: int) -> None:
    from evo.core import sync

    rng = np.random.default_rng(seed)
    mine, other = (np.sort(rng.choice(3000, n, replace=False)) / 1000 for n in rng.integers(2, 60, 2))
    other += 3e-4  # no two differences alike, none at the tolerance
    scans, rows = nearest_by_stamp(mine, other)
    if len(other) <= len(mine):
        expected = sync.matching_time_indices(other, mine, 0.0199)
        assert (rows.tolist(), scans.tolist()) == expected
    else:
        expected = sync.matching_time_indices(mine, other, 0.0199)
        assert (scans.tolist(), rows.tolist()) == expected


def test_relative_errors_by_hand() -> None:
    true = np.column_stack([np.arange(11.0), np.zeros(11), np.zeros(11)])
    estimated = true * [1.01, 1.0, 1.0]
    assert path_lengths(true).tolist() == true[:, 0].tolist()
    over_2 = relative_error(estimated, true, path_lengths(true), 2.0)
    assert (over_2.n, over_2.rotation_rmse) == (9, 0.0)
    assert over_2.translation_rmse == pytest.approx(0.02)
    assert relative_error(estimated, true, path_lengths(true), 11.0).n == 0
    assert np.isnan(relative_error(estimated, true, path_lengths(true), 11.0).translation_rmse)
    gap = np.array([0, 1, 2, 8, 9, 10])
    assert relative_error(estimated[gap], true[gap], path_lengths(true)[gap], 1.0).n == 4


@pytest.mark.parametrize(
    ("mean", "said"),
    [
        (3.0, "right to within 10 %"),
        (2.04, "21 % larger than the errors, on the safe side"),
        (0.5, "2.4 times larger than the errors, on the safe side"),
        (6.0, "errors are 41 % larger than the standard deviations say, which are too small"),
        (1e-9, "more than 100 times larger"),
        (0.0, "no errors"),
    ],
)
def test_a_nees_in_words(mean: float, said: str) -> None:
    assert said in nees_verdict(mean)


@given(st.lists(st.tuples(st.floats(0, 2e9), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1)), min_size=1, max_size=9))
def test_euroc_reads_back(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float, float]]) -> None:
    stamps, x, heading = (np.array(column) for column in zip(*rows, strict=True))
    poses = np.column_stack([x, -x, heading])
    path = tmp_path_factory.mktemp("euroc") / "data.csv"
    path.write_text(format_euroc(stamps, poses))
    again = read_euroc(path)
    np.testing.assert_allclose(again.poses, poses, atol=1e-9)
    np.testing.assert_allclose(again.stamps, stamps, atol=1e-6, rtol=0)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "a,b\n1,2\n", "a.csv:1: found 'a,b', expected the header 't_s,x_m,y_m,theta_rad'"),
        ("a.csv", "#timestamp [ns],x\n1,2,3\n", "a.csv:2: found 3 values, expected at least 8"),
        ("a.csv", "#timestamp [ns],x\n1,2,3,4,0,0,0,0\n", "a.csv:2: found '1 2 3 4"),
        ("a.txt", "1 2 3\n", "a.txt:1: found 3 numbers, expected 8"),
        ("a.txt", "", "a.txt: holds no pose"),
        ("a.txt", "0 0 0 nan\n", "expected finite numbers"),
        ("a.txt", "words\n", "a.txt: found no true poses, expected a CSV with 't_s,x_m,y_m,theta_rad' or 'scan,x_m"),
    ],
)
def test_what_is_no_truth_is_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(IcegError) as caught:
        read_truth(tmp_path / name)
    assert message in str(caught.value)


@pytest.mark.parametrize(("words", "message"), [(["--by", "stamp"], "names scans"), (["--by", "scan"], "")])
def test_how_poses_are_paired_can_be_asked_for(
    tmp_path: Path,
    trajectory: Path,
    stamps: Array,
    true: Array,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path, "CSV by scan", stamps, true)
    code = main(["eval", str(trajectory), "--truth", str(path), *words])
    assert code == (1 if message else 0)
    assert message in capsys.readouterr().err


def test_stamps_pair_as_the_independent_evaluator_does(
    tmp_path: Path,
    trajectory: Path,
    stamps: Array,
    true: Array,
    evaluate: ModuleType,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shifted = stamps[::3] + np.random.default_rng(2).uniform(-0.03, 0.03, len(stamps[::3]))
    path = written(tmp_path, "columns t x y theta", shifted, true[::3])
    evaluate.main("ate-stamps", str(trajectory), str(path))
    expected = json.loads(capsys.readouterr().out)
    figures = evaluated(capsys, trajectory, "--truth", path)
    for name in ("n", "ate_rmse", "ate_max", "x_mean_abs", "y_mean_abs", "rot_rmse_deg", "matched"):
        assert figures[name] == expected[name], name
    evaluate.main("ate", str(trajectory), str(written(tmp_path, "columns t x y theta", stamps, true)))
    expected = json.loads(capsys.readouterr().out)
    figures = evaluated(capsys, trajectory, "--truth", tmp_path / "truth.txt")
    assert all(figures[name] == expected[name] for name in ("ate_rmse", "ate_max", "x_mean_abs", "rot_rmse_deg"))


@pytest.mark.parametrize(
    "text",
    [
        "scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,7,1.0,0.5,0.1,1\n",
        "1134864643.333186 1134864643.553180 0.091719 0.004553 0 0 0 0.270090\n",
    ],
)
def test_relations_are_not_taken_for_true_poses(tmp_path: Path, text: str) -> None:
    path = tmp_path / "some.relations"
    path.write_text(text)
    with pytest.raises(IcegError, match=r"some\.relations: found relative poses .* give these as --relations"):
        read_truth(path)

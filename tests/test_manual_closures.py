"""Loops closed by hand: the file, the way from scans to key poses, and what they do to a log that went wrong."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import iceg
from frontends.logs.carmen_writer import write_carmen
from frontends.scan import Log, ScanGeometry
from graph.errors import IcegError
from graph.se2 import between, compose, expmap, logmap
from iceg.cli import main
from iceg.corrections.by_hand import manual_factor
from iceg.corrections.corrections import CorrectionsError
from iceg.corrections.manual_closures import ManualClosure, read_manual_closures
from iceg.evaluation.trajectory import trajectory_errors
from iceg.maps.config import GridConfig
from iceg.run_folder import read_closures
from iceg.run_result.slam_result import SlamResult
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import Track

Array = NDArray[np.float64]

HEADER = "scan_i,scan_j,x_m,y_m,theta_rad"
N_SCANS = 400
CONFIG = iceg.Config(loops=LoopClosureConfig(enabled=False), grid=GridConfig(resolution=0.5))


def square() -> Array:
    """Once round a square of 20 m, back to where it began."""
    steps = np.tile([0.2, 0.0, 0.0], (N_SCANS - 1, 1))
    steps[99::100, 2] = np.pi / 2
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def log_of(odometry: Array, path: Path = Path("square.clf")) -> Log:
    """A log whose scans see nothing, so that odometry alone speaks."""
    bearings = np.radians(np.arange(-90.0, 91.0))
    return Log(
        ranges=np.full((len(odometry), len(bearings)), np.nan, dtype=np.float32),
        odometry=odometry,
        stamps=np.linspace(0.0, 80.0, len(odometry)),
        geometry=ScanGeometry(bearings=bearings, range_min=0.1, range_max=20.0),
        path=path,
    )


def drifting(truth: Array) -> Array:
    """The same path by wheels that turn it to the left all the time: 25° in all."""
    steps = between(truth[:-1], truth[1:])
    steps[:, 2] += np.radians(25.0) / len(steps)
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


@pytest.fixture(scope="module")
def truth() -> Array:
    return square()


@pytest.fixture(scope="module")
def log(truth: Array) -> Log:
    return log_of(drifting(truth))


def closure(truth: Array, i: int, j: int) -> ManualClosure:
    return ManualClosure(scan_i=i, scan_j=j, T_i_j=between(truth[i], truth[j]), sigma_m=0.02, sigma_rad=0.005)


def error(result: SlamResult, truth: Array) -> float:
    return trajectory_errors(result.trajectory, truth).ate_rmse


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_with_and_without_deviations(tmp_path: Path) -> None:
    bare = read_manual_closures(write(tmp_path / "a.csv", f"{HEADER}\n3,70,0.5,-0.25,1.5\n\n4,71,0,0,0\n"))
    assert [(c.scan_i, c.scan_j) for c in bare] == [(3, 70), (4, 71)]
    np.testing.assert_array_equal(bare[0].T_i_j, [0.5, -0.25, 1.5])
    from_a_spreadsheet = read_manual_closures(write(tmp_path / "c.csv", f"\ufeff{HEADER}\r\n3,70,0.5,-0.25,1.5\r\n"))
    assert [(c.scan_i, c.scan_j) for c in from_a_spreadsheet] == [(3, 70)]
    full = read_manual_closures(write(tmp_path / "b.csv", f"{HEADER},sigma_m,sigma_rad\n3,70,0.5,-0.25,1.5,0.2,0.07\n"))
    assert (full[0].sigma_m, full[0].sigma_rad) == (0.2, 0.07)
    assert 0.0 < bare[0].sigma_m < 1.0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"1: found the header ''"),
        ("scan_i,scan_j\n1,2\n", r":1: found the header 'scan_i,scan_j', expected 'scan_i,scan_j,x_m"),
        (f"{HEADER}\n", r"holds no rows"),
        (f"{HEADER}\n1,2,0,0,0\n1,2,0,0\n", r":3: found 4 values"),
        (f"{HEADER}\n1,two,0,0,0\n", r":2: .*'two'"),
        (f"{HEADER}\n1,2,0,inf,0\n", r":2: .*finite"),
        (f"{HEADER}\n1,2.5,0,0,0\n", r":2: found scans 1 and 2.5"),
        (f"{HEADER}\n-1,2,0,0,0\n", r":2: found scans -1 and 2"),
        (f"{HEADER}\n1,2,0,0,-90\n", r":2: found a heading of -90 rad, expected radians \(-90° is -1\.5708\)"),
        (f"{HEADER}\n2,2,0,0,0\n", r":2: found scans 2 and 2"),
        (f"{HEADER},sigma_m,sigma_rad\n1,2,0,0,0,0.1,0\n", r":2: sigma_rad: found 0, expected"),
        (f"{HEADER},sigma_m,sigma_rad\n1,2,0,0,0,1e-200,1\n", r":2: sigma_m: found 1e-200, expected 1e-06"),
        (f"{HEADER},sigma_m,sigma_rad\n1,2,0,0,0,1e5,1\n", r":2: sigma_m: found 100000, expected 1e-06 to 10000"),
    ],
)
def test_what_a_file_must_not_hold(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(IcegError, match=rf"bad\.csv.*{complaint}"):
        read_manual_closures(write(tmp_path / "bad.csv", text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(IcegError, match=r"nowhere\.csv"):
        read_manual_closures(tmp_path / "nowhere.csv")


poses = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(T_map_key=st.tuples(poses, poses), T_key_scan=st.tuples(poses, poses), off=poses)
def test_a_closure_of_scans_is_one_of_their_key_poses(
    T_map_key: tuple[Array, Array], T_key_scan: tuple[Array, Array], off: Array
) -> None:
    # Wherever the scans hang on their key poses: a factor that the truth fulfils has no residual, and an error ξ of
    # the closure weighs the same between key poses as between scans.
    keys = np.array(T_map_key)
    scans = compose(keys, np.array(T_key_scan))
    track = Track(
        keys=[],
        key_of_scan=np.array([0, 1]),
        T_key_scan=np.array(T_key_scan),
        failures=0,
        lost=[],
    )
    xi = 0.01 * off
    said = compose(between(scans[0], scans[1]), expmap(-xi))
    by_hand = ManualClosure(scan_i=0, scan_j=1, T_i_j=said, sigma_m=0.3, sigma_rad=0.1)
    factor = manual_factor(by_hand, track)
    assert factor is not None
    assert (factor.kind, factor.i, factor.j, factor.kernel) == ("closure", 0, 1, None)
    residual = logmap(between(factor.T_i_j, between(keys[0], keys[1])))
    expected = float(np.sum((xi / [0.3, 0.3, 0.1]) ** 2))
    assert residual @ np.linalg.solve(factor.covariance, residual) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_one_correct_closure_gets_the_shape_right(log: Log, truth: Array) -> None:
    without = iceg.run(log, CONFIG)
    assert error(without, truth) > 1.0
    closed = iceg.run(log, CONFIG, closures=[closure(truth, 0, N_SCANS - 1)])
    assert error(closed, truth) < 0.25 * error(without, truth)
    end = between(closed.trajectory[0], closed.trajectory[-1])
    np.testing.assert_allclose(end, between(truth[0], truth[-1]), atol=0.05)


@pytest.mark.parametrize("finish", [True, False])
@pytest.mark.parametrize("pinned", [True, False])
def test_it_has_a_kernel_unless_pinned_and_is_on_record(log: Log, truth: Array, finish: bool, pinned: bool) -> None:
    from iceg.slam.config import FinishConfig

    config = iceg.Config(loops=CONFIG.loops, grid=CONFIG.grid, finish=FinishConfig(enabled=finish))
    closures = [replace(closure(truth, 7, 390), pinned=pinned), closure(truth, 10, 11)]
    result = iceg.run(log, config, closures=closures)
    by_hand = [factor for factor in result.graph.factors if factor.kind == "closure"]
    assert [factor.kernel is None for factor in by_hand] == [pinned]
    assert result.summary["factors"]["closure"] == 1
    said = {(c.scan_i, c.scan_j): (c.verdict, c.reason) for c in result.closures}
    assert said[7, 390] == ("accepted", "by hand, pinned" if pinned else "by hand")
    assert said[10, 11][0] == "rejected"
    assert "same key pose" in said[10, 11][1]


def test_a_scan_the_log_does_not_have(log: Log, truth: Array) -> None:
    with pytest.raises(CorrectionsError, match=f"found scan {N_SCANS}, but the log has {N_SCANS} scans"):
        iceg.run(log, CONFIG, closures=[ManualClosure(scan_i=0, scan_j=N_SCANS, T_i_j=truth[0])])


def test_from_the_command_line(truth: Array, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded = tmp_path / "square.clf"
    write_carmen(recorded, log_of(drifting(truth)))
    file = tmp_path / "closures.csv"
    with file.open("w", encoding="utf-8", newline="") as lines:
        rows = csv.writer(lines)
        rows.writerow(HEADER.split(","))
        rows.writerow([2, N_SCANS - 2, *between(truth[2], truth[-2]).tolist()])
    flags = ["--loops.no-enabled", "--grid.resolution", "0.5"]
    assert main(["run", str(recorded), "-o", str(tmp_path / "run"), "--closures", str(file), *flags]) == 0
    (recorded_closure,) = read_closures(tmp_path / "run" / "closures.csv")
    assert (recorded_closure.scan_i, recorded_closure.scan_j) == (2, N_SCANS - 2)
    assert (recorded_closure.verdict, recorded_closure.reason) == ("accepted", "by hand")
    capsys.readouterr()
    file.write_text(f"{HEADER}\n0,{N_SCANS},0,0,0\n", encoding="utf-8")
    assert main(["run", str(recorded), "-o", str(tmp_path / "again"), "--closures", str(file), *flags]) == 1
    assert f"closures.csv:2: found scan {N_SCANS}" in capsys.readouterr().err

"""The library as the README shows it: five lines for a run, twenty for one's own matcher, parts on plain arrays."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from frontends.scan import Log, ScanError
from graph.measurement import RelativePose
from iceg.config import LogConfig
from iceg.corrections.manual_closures import read_manual_closures
from iceg.evaluation.trajectory import read_truth_csv
from iceg.show.run_plots import plot_results
from iceg.tum import read_tum

REPOSITORY = Path(__file__).parent.parent
N_SCANS = 200


@pytest.fixture(scope="module")
def log() -> Log:
    """The first metres of the embedded log."""
    whole = iceg.read_log(iceg.demo_log_path())
    return Log(
        ranges=whole.ranges[:N_SCANS],
        odometry=whole.odometry[:N_SCANS],
        stamps=whole.stamps[:N_SCANS],
        geometry=whole.geometry,
        path=whole.path,
    )


def python_blocks() -> list[str]:
    """Of the README and of the page on the library."""
    pages = [(REPOSITORY / name).read_text(encoding="utf-8") for name in ("README.md", "docs/library.md")]
    return [block for page in pages for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)]


@pytest.fixture(scope="module")
def shown(log: Log) -> dict[str, Any]:
    """The names that the README's examples leave behind, run one after the other on the short log."""
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(iceg, "read_log", lambda _: log)
        for block in python_blocks():
            exec(compile(block, "README.md", "exec"), names)
            names.setdefault("first", names["result"])
    return names


def test_five_lines_from_a_log_to_arrays_and_a_gtsam_graph(shown: dict[str, Any]) -> None:
    result, factors, values = shown["first"], shown["factors"], shown["values"]
    assert result.trajectory.shape == (N_SCANS, 3)
    assert result.covariances.shape == (len(result.key_poses), 3, 3)
    assert np.linalg.eigvalsh(result.covariances[1:]).min() > 0
    assert result.grid.occupancy().ndim == 2
    assert isinstance(factors, gtsam.NonlinearFactorGraph)
    assert isinstance(values, gtsam.Values)
    again = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    assert factors.error(again) <= factors.error(values) + 1e-6


def test_ones_own_matcher_runs_in_the_same_pipeline(shown: dict[str, Any]) -> None:
    ice, mine = shown["first"], shown["result"]
    distance = np.hypot(*(mine.trajectory - ice.trajectory)[:, :2].T)
    assert distance.max() < 0.3
    assert mine.summary["factors"]["ice"] == len(mine.key_poses) - 1
    assert len(mine.landmarks) > 0


def test_the_parts_on_plain_arrays(shown: dict[str, Any]) -> None:
    assert (shown["features"].kinds == 0).sum() == 2
    np.testing.assert_allclose(shown["match"].T_ref_cur, np.zeros(3), atol=0.01)


def room(x: float, y: float, heading: float, n_beams: int = 181) -> NDArray[np.float64]:
    """Ranges seen in a room of 6 m by 4 m around the origin."""
    angles = heading + np.linspace(-np.pi / 2, np.pi / 2, n_beams)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_x = (np.sign(np.cos(angles)) * 3.0 - x) / np.cos(angles)
        along_y = (np.sign(np.sin(angles)) * 2.0 - y) / np.sin(angles)
    return np.minimum(along_x, np.where(np.isfinite(along_y), along_y, np.inf))


def test_features_and_a_match_from_plain_ranges() -> None:
    reference = iceg.Scan.from_ranges(room(0.0, 0.0, 0.0), field_of_view=np.pi)
    scan = iceg.Scan.from_ranges(room(0.3, -0.2, 0.2), field_of_view=np.pi)

    features = iceg.extract_features(reference)
    corners = features.positions[features.kinds == 0]
    np.testing.assert_allclose(sorted(corners.tolist()), [[3.0, -2.0], [3.0, 2.0]], atol=0.02)

    matcher = iceg.IceMatcher()
    local_map = matcher.prepare([reference], np.zeros((1, 3)))
    match = matcher.match(local_map, scan, np.zeros(3), np.diag([0.3, 0.3, 0.3]) ** 2)
    assert isinstance(match, RelativePose)
    np.testing.assert_allclose(match.T_ref_cur, [0.3, -0.2, 0.2], atol=0.01)


def test_readings_that_are_no_returns() -> None:
    scan = iceg.Scan.from_ranges([1.0, 0.0, np.nan, np.inf, 8.0, -1.0, 2.0], field_of_view=np.pi, range_max=8.0)
    assert np.isfinite(scan.ranges).tolist() == [True, False, False, False, False, False, True]
    np.testing.assert_allclose(scan.points, [[0.0, -1.0], [0.0, 2.0]], atol=1e-9)


def test_a_laser_elsewhere_on_the_robot() -> None:
    scan = iceg.Scan.from_ranges([1.0, 1.0], field_of_view=np.pi, T_robot_laser=(0.5, 0.0, np.pi / 2))
    np.testing.assert_allclose(scan.points, [[1.5, 0.0], [-0.5, 0.0]], atol=1e-9)


@pytest.mark.parametrize(("ranges", "field_of_view"), [([1.0], 1.0), ([[1.0, 2.0]], 1.0), ([1.0, 2.0], 0.0)])
def test_numbers_that_are_no_scan(ranges: list[float], field_of_view: float) -> None:
    with pytest.raises(ScanError, match="expected"):
        iceg.Scan.from_ranges(ranges, field_of_view=field_of_view)


def test_the_warnings_of_a_result_are_one_list_of_which_the_logs_are_the_first(log: Log) -> None:
    odd = replace(log.select(slice(1)), warnings=("the log is odd",))
    result = iceg.run(odd, progress=False)
    assert result.warnings == ("the log is odd", *(warning.sentence for warning in result.run_warnings))
    assert list(result.warnings) == result.summary["warnings"]
    assert repr(result) == (
        "SlamResult(office.clf.gz: 1 scan, 1 key pose, 1 factor, 0 of 0 closures accepted, 0 landmarks, 1 warning)"
    )


def test_a_notebook_shows_what_is_there_in_a_line(shown: dict[str, Any], log: Log, tmp_path: Path) -> None:
    result = shown["first"]
    assert repr(log) == f"Log(office.clf.gz: {N_SCANS} scans of 181 beams)"
    assert repr(result).startswith(f"SlamResult(office.clf.gz: {N_SCANS} scans, {len(result.key_scans)} key poses, ")
    assert repr(result).endswith(" landmarks, 0 warnings)")
    iceg.write_results(result, tmp_path / "out")
    assert repr(iceg.read_run_folder(tmp_path / "out")).startswith(f"RunFolder({N_SCANS} scans, ")


def test_plain_strings_name_files_and_folders(shown: dict[str, Any], tmp_path: Path) -> None:
    folder, result = str(tmp_path / "out"), shown["first"]
    iceg.write_results(result, folder)
    run_folder = iceg.read_run_folder(folder)
    np.testing.assert_allclose(run_folder.trajectory.poses, result.trajectory, atol=1e-6)
    assert [path.name for path in plot_results(folder)] == ["map.png", "trajectory.png", "uncertainty.png"]
    assert iceg.read_config(f"{folder}/config.toml") == result.config
    assert len(read_tum(f"{folder}/trajectory.tum")) == N_SCANS
    assert len(read_truth_csv(str(iceg.demo_truth_path()))) == 1848
    table = tmp_path / "closures.csv"
    table.write_text("scan_i,scan_j,x_m,y_m,theta_rad\n0,100,1,0,0\n")
    assert len(read_manual_closures(str(table))) == 1


def test_a_run_takes_the_path_of_a_recording_and_reads_it_as_the_settings_say(log: Log, tmp_path: Path) -> None:
    path, near = tmp_path / "short.clf", iceg.Config(log=LogConfig(range_max=5.0))
    iceg.write_log(path, log)
    by_path, by_log = iceg.run(str(path), near, False), iceg.run(iceg.read_log(path, range_max=5.0), near, False)
    np.testing.assert_array_equal(by_path.trajectory, by_log.trajectory)
    assert iceg.run(path, progress=False).findings.log.geometry.range_max > 5.0
    with pytest.raises(iceg.IcegError, match="nowhere"):
        iceg.run(tmp_path / "nowhere.clf")


def test_arrays_make_a_log_before_anything_else_is_imported() -> None:
    code = "import iceg; print(iceg.Log.from_arrays([[1.0, 2.0]], field_of_view=1.0))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "Log(arrays: 1 scan of 2 beams, no odometry)\n", done.stderr


def test_arguments_of_the_wrong_type_are_told_where_they_are_handed_over(log: Log, tmp_path: Path) -> None:
    wrong: Any = "corrections.toml"
    named: dict[str, Any] = {
        "corrections: found str, expected iceg.Corrections, as": lambda: iceg.run(log, corrections=wrong),
        "config: found str, expected iceg.Config": lambda: iceg.run(log, wrong),
        "stages: found str, expected iceg.Stages": lambda: iceg.run(log, stages=wrong),
        "log: found ndarray, expected iceg.Log": lambda: iceg.run(log.ranges),  # type: ignore[arg-type]
        "corrections: found str, expected": lambda: iceg.resolve(tmp_path, wrong),
        "geometry: found Log, expected iceg.ScanGeometry": lambda: iceg.Mapper(log),  # type: ignore[arg-type]
        r"found Log first, expected write_log\(path, log\)": lambda: iceg.write_log(log, wrong),  # type: ignore[arg-type]
        "log: found str, expected iceg.Log": lambda: iceg.write_log(tmp_path / "log.csv", wrong),
        r"result: found str, expected .*: write_results\(result, ": lambda: iceg.write_results(wrong, tmp_path),
        "result: found Log, expected iceg.SlamResult": lambda: iceg.write_results(log, tmp_path),  # type: ignore[arg-type]
        "scan: found ndarray, expected iceg.Scan": lambda: iceg.extract_features(log.ranges[0]),
        "matcher: found str, expected an object": lambda: iceg.Stages(matcher=wrong),
        "matcher: found the class IceMatcher, expected": lambda: iceg.Stages(matcher=iceg.IceMatcher),  # type: ignore[arg-type]
    }
    for message, call in named.items():
        with pytest.raises(TypeError, match=message):
            call()

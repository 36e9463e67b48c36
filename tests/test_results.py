"""The folder a run leaves behind: complete, or as it was."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import iceg
from frontends.scan import Log, ScanGeometry
from iceg import results
from iceg.config import Config, read_config
from iceg.maps.grid import OccupancyGrid
from iceg.results import (
    RESULT_FILES,
    ResultsError,
    check_directory,
    read_covariances,
    read_summary,
    whole_results,
    write_results,
)
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.tables import TableError
from iceg.tum import read_tum
from tests.process_faults import ends_at


def make_result(seed: int = 0, n: int = 9) -> Any:
    """What a run returns, with made-up numbers; graph, picture, features and findings are written by stand-ins."""
    rng = np.random.default_rng(seed)
    geometry = ScanGeometry(bearings=np.linspace(-1, 1, 5), range_min=0.1, range_max=10.0)
    roots = rng.normal(size=(n // 3, 3, 3)) * 0.01
    trajectory = rng.normal(size=(n, 3))
    return SimpleNamespace(
        log=Log(
            ranges=np.ones((n, 5), np.float32),
            odometry=np.zeros((n, 3)),
            stamps=np.arange(n) / 5,
            geometry=geometry,
            path=Path("made-up.clf"),
        ),
        config=Config(seed=7),
        trajectory=trajectory,
        key_scans=np.arange(0, n, 3),
        key_poses=trajectory[::3],
        covariances=roots @ roots.transpose(0, 2, 1) + 1e-9 * np.eye(3),
        grid=OccupancyGrid(log_odds=np.zeros((4, 6), np.float32), origin=np.zeros(2), resolution=0.05),
        closures=[
            SimpleNamespace(
                scan_i=1,
                scan_j=8,
                T_i_j=np.array([0.1, 0.2, 0.3]),
                score=0.9,
                inliers=100,
                overlap=0.75,
                verdict="rejected",
                reason='"alone", says PCM',
            )
        ],
        walls=WallPieces.none(),
        summary={"scans": n, "share": np.float64(0.5), "undefined": float("nan"), "per_kind": np.array([1, 2])},
    )


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    def writer(name: str) -> Any:
        return lambda _result, folder: (folder / name).write_text(name)

    monkeypatch.setattr(
        results,
        "_WRITERS",
        MappingProxyType(
            dict(results._WRITERS)
            | {
                "graph": writer("graph.g2o"),
                "picture": writer("map.png"),
                "features": writer("features.geojson"),
                "findings": writer("run.npz"),
                "report": writer("report.html"),
            }
        ),
    )


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def contents(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def test_exactly_the_promised_files_are_written(tmp_path: Path) -> None:
    write_results(make_result(), tmp_path / "deep" / "out")
    assert names(tmp_path / "deep" / "out") == sorted(RESULT_FILES)


def test_progress_is_told_of_every_part_and_never_goes_back(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    write_results(make_result(), tmp_path, progress=lambda name, begun, of: told.append((name, begun, of)))
    assert {name for name, _, _ in told} == set(results._WRITERS)
    assert [(begun, of) for _, begun, of in told] == [(k, len(told)) for k in range(len(told))]


def test_trajectory_covariances_settings_and_summary_read_back(tmp_path: Path) -> None:
    result = make_result()
    write_results(result, tmp_path)
    trajectory = read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_allclose(trajectory.poses, result.trajectory, atol=1e-9)
    np.testing.assert_allclose(trajectory.stamps, result.log.stamps, atol=1e-6)
    scans, key_poses, covariances = read_covariances(tmp_path / "covariances.csv")
    np.testing.assert_array_equal(scans, result.key_scans)
    np.testing.assert_allclose(key_poses, result.key_poses, atol=1e-9)
    np.testing.assert_allclose(covariances, result.covariances, rtol=1e-10)
    assert read_config(tmp_path / "config.toml") == result.config
    summary = read_summary(tmp_path)
    assert (summary["scans"], summary["share"], summary["undefined"], summary["per_kind"]) == (9, 0.5, None, [1, 2])
    assert summary["versions"]["iceg"] == iceg.__version__
    assert summary["peak_memory_mb"] is None or summary["peak_memory_mb"] > 10
    assert set(summary["writing_s"]) == set(results._WRITERS)


def test_closures_carry_their_reason(tmp_path: Path) -> None:
    write_results(make_result(), tmp_path)
    header, row = (tmp_path / "closures.csv").read_text().splitlines()
    assert header == "scan_i,scan_j,x_m,y_m,theta_rad,score,inliers,overlap,verdict,reason"
    assert row == ('1,8,0.100000000,0.200000000,0.300000000,0.900000,100,0.750000,rejected,"""alone"", says PCM"')


def test_the_same_result_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_results(make_result(), tmp_path / name)
    first, second = contents(tmp_path / "a"), contents(tmp_path / "b")
    assert {name for name in first if first[name] != second[name]} <= {"summary.json"}


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ResultsError, match=r"not empty.*--overwrite"):
        write_results(make_result(), tmp_path)
    assert names(tmp_path) == ["notes.txt"]
    with pytest.raises(ResultsError, match="is a file"):
        check_directory(tmp_path / "notes.txt", overwrite=True)


def test_overwriting_replaces_results_and_nothing_else(tmp_path: Path) -> None:
    write_results(make_result(seed=1), tmp_path)
    before = contents(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    write_results(make_result(seed=2), tmp_path, overwrite=True)
    after = contents(tmp_path)
    assert after.pop("notes.txt") == b"mine"
    assert after.keys() == before.keys()
    assert after["trajectory.tum"] != before["trajectory.tum"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_whatever_interrupts_the_writing_leaves_the_folder_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    write_results(make_result(seed=1), tmp_path / "old")
    before = contents(tmp_path / "old")

    def fail(_result: object, folder: Path) -> None:
        (folder / "map.png").write_text("half a pic")
        raise error

    monkeypatch.setattr(results, "_WRITERS", dict(results._WRITERS) | {"picture": fail})
    with pytest.raises(error):
        write_results(make_result(seed=2), tmp_path / "old", overwrite=True)
    assert contents(tmp_path / "old") == before
    with pytest.raises(error):
        write_results(make_result(seed=2), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_an_interrupt_while_files_move_into_place_waits_until_all_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = Path.replace

    def interrupted(self: Path, target: Path) -> Path:
        if target.parent.name == "out":
            os.kill(os.getpid(), signal.SIGINT)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_results(make_result(), tmp_path / "out")
    monkeypatch.undo()
    assert names(tmp_path / "out") == sorted(RESULT_FILES)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a process that can be killed at each call is a fork")
def test_a_new_folder_is_usable_whenever_its_run_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda _handle: None)
    for number in range(0, 1000, 7):
        out = tmp_path / str(number)
        if not ends_at(number, "kill", lambda: write_results(make_result(), out)):  # noqa: B023 called at once
            break
        complete = (out / "summary.json").exists()
        check_directory(out, overwrite=complete)
        write_results(make_result(seed=1), out, overwrite=complete)
        assert names(out) == sorted(RESULT_FILES)
    assert number > 50


def test_what_is_no_file_is_refused_before_the_run(tmp_path: Path) -> None:
    write_results(make_result(), tmp_path)
    (tmp_path / "summary.json").unlink()
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(ResultsError, match=r"summary\.json: is in the place of a file of the results"):
        check_directory(tmp_path, overwrite=True)


def test_files_of_two_runs_are_refused(tmp_path: Path) -> None:
    for seed in (1, 2):
        write_results(make_result(seed=seed), tmp_path / str(seed))
    with whole_results(tmp_path / "1"):
        pass
    (tmp_path / "2" / "covariances.csv").replace(tmp_path / "1" / "covariances.csv")
    with (
        pytest.raises(ResultsError, match=r"1/covariances\.csv: is not what the run has written"),
        whole_results(tmp_path / "1"),
    ):
        pass


@pytest.mark.parametrize("content", [b'{"files": {', b"\xf7\x00", b"[]"])
def test_a_summary_that_cannot_be_read_vouches_for_nothing(tmp_path: Path, content: bytes) -> None:
    write_results(make_result(), tmp_path)
    (tmp_path / "summary.json").write_bytes(content)
    with pytest.raises(ResultsError, match=r"summary\.json: .*expected"), whole_results(tmp_path):
        pass


def test_results_replaced_while_they_are_read_are_refused(tmp_path: Path) -> None:
    write_results(make_result(seed=1), tmp_path)
    with pytest.raises(ResultsError, match="were replaced while they were read"), whole_results(tmp_path):
        write_results(make_result(seed=2), tmp_path, overwrite=True)


@pytest.mark.parametrize(("name", "shown"), [(b"b\xfcro.clf", r"b\xfcro.clf"), ("büro.clf".encode(), "büro.clf")])
def test_a_name_that_is_no_text_is_kept_readable(tmp_path: Path, name: bytes, shown: str) -> None:
    result = make_result()
    for decoded in (name.decode("utf-8", "surrogateescape"), name.decode("ascii", "surrogateescape")):
        result.summary["log"] = decoded
        write_results(result, tmp_path, overwrite=True)
        assert read_summary(tmp_path)["log"] == shown


def test_results_can_be_written_from_another_thread(tmp_path: Path) -> None:
    thread = threading.Thread(target=write_results, args=(make_result(), tmp_path / "out"))
    thread.start()
    thread.join()
    assert names(tmp_path / "out") == sorted(RESULT_FILES)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(ResultsError, match="where nothing can be written"):
        check_directory(tmp_path / "out", overwrite=False)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc here")
def test_a_folder_in_which_nobody_can_write_is_refused_before_the_run() -> None:
    with pytest.raises(ResultsError, match=r"/proc/out: found /proc, where nothing can be written \("):
        check_directory(Path("/proc/out"), overwrite=False)


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
def test_a_link_that_leads_nowhere_is_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for directory in (tmp_path / "link", tmp_path / "link" / "out"):
        with pytest.raises(ResultsError, match=r"/link is a link that leads nowhere, expected a folder"):
            check_directory(directory, overwrite=False)


def test_the_check_of_a_folder_leaves_nothing_behind(tmp_path: Path) -> None:
    check_directory(tmp_path / "some" / "where", overwrite=False)
    assert names(tmp_path) == []


def test_a_folder_below_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultsError, match=r"file/out: .*file is a file, expected a folder"):
        check_directory(tmp_path / "file" / "out", overwrite=False)


def test_a_broken_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"summary\.json: cannot be read"):
        read_summary(tmp_path)
    (tmp_path / "summary.json").write_text("[]")
    with pytest.raises(ResultsError, match="found list"):
        read_summary(tmp_path)
    (tmp_path / "covariances.csv").write_text("a\n1\n")
    with pytest.raises(TableError, match="found the header 'a'"):
        read_covariances(tmp_path / "covariances.csv")


def test_the_summary_is_valid_json_for_strict_readers(tmp_path: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    write_results(make_result(), tmp_path)
    json.loads((tmp_path / "summary.json").read_text(), parse_constant=refuse)


def test_the_memory_a_process_held_is_its_own() -> None:
    status = Path("/proc/self/status")
    if not status.is_file() or "VmHWM" not in status.read_text(encoding="ascii"):
        pytest.skip("this system tells what a process or its parent held")
    code = "from iceg.memory import peak_memory_mb; print(peak_memory_mb())"
    ballast = np.ones(40_000_000)  # 320 MB that the child is not to be charged with
    peak = float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)
    assert 5.0 < peak < 250.0 < 1e-6 * ballast.nbytes

"""How `iceg run` and `iceg demo` end: with a folder, an error in one line, or a signal."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from frontends.scan import Log
from iceg import cli, results
from iceg.cli import main
from iceg.config import Config, parse_config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.maps.feature_map import FeatureMap
from iceg.slam.progress import Progress, ProgressCallback

Pipeline = Callable[[Log, Config, ProgressCallback], Any]


@pytest.fixture
def pipeline(monkeypatch: pytest.MonkeyPatch) -> Callable[[Pipeline], None]:
    """Put another pipeline, and writers of its results, in place of the real ones."""

    def install(run: Pipeline) -> None:
        module = ModuleType("iceg.pipeline")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "iceg.pipeline", module)
        kept = {name: results._WRITERS[name] for name in ("trajectory", "covariances", "config")}
        monkeypatch.setattr(results, "_WRITERS", kept)

    return install


def by_odometry(
    log: Log, config: Config, progress: ProgressCallback, *, closures: object = (), corrections: object = None
) -> Any:
    del closures, corrections
    for scan in range(len(log)):
        progress(Progress(scans=scan + 1, tried=scan, accepted=scan // 2))
    return SimpleNamespace(
        log=log,
        config=config,
        trajectory=log.odometry,
        key_scans=np.arange(len(log)),
        key_poses=log.odometry,
        covariances=np.broadcast_to(1e-4 * np.eye(3), (len(log), 3, 3)),
        landmarks=FeatureMap().record(),
        closures=[],
        run_warnings=(),
        summary={"scans_carried_by_odometry": 0, "lost_at_scans": [], "breaks": [], "warnings": [], "finish": []},
    )


def test_run_writes_its_folder_and_refuses_to_overwrite_it(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline(by_odometry)
    out = tmp_path / "out"
    words = ["run", str(demo_log_path()), "-o", str(out), "--grid.resolution", "0.25"]
    assert main(words) == 0
    captured = capsys.readouterr()
    assert str(out) in captured.out
    assert "100%" in captured.err
    assert "x real time, 50 % matched" in captured.err
    assert parse_config((out / "config.toml").read_text(encoding="utf-8")).grid.resolution == 0.25
    assert main(words) == 1
    assert "not empty" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0


def test_pictures_and_exports_of_earlier_results_are_told_and_kept(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline(by_odometry)
    words = ["run", str(demo_log_path()), "-o", str(tmp_path), "--overwrite"]
    assert main(words) == 0
    assert "earlier results" not in capsys.readouterr().err
    for name in ("uncertainty.png", "exported.tum", "map.png", "notes.txt"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "mcap").mkdir()
    assert main(words) == 0
    told = f"warning: {tmp_path}: uncertainty.png, exported.tum, mcap are of earlier results: make anew with iceg plot"
    assert told in capsys.readouterr().err
    assert (tmp_path / "uncertainty.png").read_text() == (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "map.png").exists()


@pytest.mark.parametrize(
    ("has_odometry", "told"),
    [
        (True, "nothing known before matched at 2 places, first at scan 30; odometry tells how what follows lies"),
        (False, "tracking was lost at 2 places, first at scan 30; loop closures tie what follows to the rest"),
    ],
)
def test_where_tracking_began_anew_is_told_with_what_holds_the_path_together(
    tmp_path: Path,
    pipeline: Callable[[Pipeline], None],
    capsys: pytest.CaptureFixture[str],
    has_odometry: bool,
    told: str,
) -> None:
    def new_ground(log: Log, config: Config, progress: ProgressCallback, **given: object) -> Any:
        result = by_odometry(log, config, progress, **given)
        result.log = replace(log, has_odometry=has_odometry)
        result.summary["lost_at_scans"] = [30, 80]
        return result

    pipeline(new_ground)
    assert main(["run", str(demo_log_path()), "-o", str(tmp_path / "out")]) == 0
    assert told in capsys.readouterr().err


def test_ctrl_c_while_libraries_are_loaded_is_no_import_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def loading(_words: list[str]) -> int:
        raise ImportError("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr(cli, "_main", loading)
    assert main(["run"]) == 130
    assert capsys.readouterr().err == "\niceg: interrupted\n"


def test_an_interrupted_run_says_what_was_kept(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> Any:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    words = ["run", str(demo_log_path()), "-o", str(out), "--overwrite"]
    pipeline(interrupted)
    assert main(words) == 130
    assert f"interrupted, nothing was written to {out}" in capsys.readouterr().err
    assert not out.exists()
    pipeline_module = sys.modules["iceg.pipeline"]
    pipeline_module.run = by_odometry  # type: ignore[attr-defined]
    assert main(words) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    pipeline_module.run = interrupted  # type: ignore[attr-defined]
    assert main(words) == 130
    assert "earlier results" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


_FAKE_RUN = (
    "import sys, time, types\n"
    "def run(*_, **__):\n"
    "    print('running', flush=True)\n"
    "    {what}\n"
    "pipeline = types.ModuleType('iceg.pipeline')\n"
    "pipeline.run = run\n"
    "sys.modules['iceg.pipeline'] = pipeline\n"
    "from iceg.cli import command\n"
    "command()\n"
)


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to send")
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_ends_the_process_with_one_line(tmp_path: Path, number: str, code: int) -> None:
    if signal.getsignal(getattr(signal, number)) == signal.SIG_IGN:
        pytest.skip(f"the tests were started with {number} ignored, as by nohup, and what they start ignores it, too")
    program = _FAKE_RUN.format(what="time.sleep(600)")
    words = [sys.executable, "-c", program, "run", str(demo_log_path()), "-o", str(tmp_path / "out")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "running\n"
        process.send_signal(getattr(signal, number))
        _, error = process.communicate(timeout=300)
    assert process.returncode == code
    assert "Traceback" not in error
    assert error.endswith(f"iceg: interrupted, nothing was written to {tmp_path / 'out'}\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to send")
@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.1])
def test_ctrl_c_while_libraries_are_loaded_is_one_line(delay_s: float) -> None:
    code = (
        "from iceg.cli import ending\n"
        "ending.install()\n"
        "print('ready', flush=True)\n"
        "import numpy, numba, gtsam, iceg.pipeline, time\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(delay_s)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=300)
    assert (process.returncode, error) == (130, "\niceg: interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no signals to ignore")
def test_a_signal_that_the_parent_ignores_stays_ignored() -> None:
    code = "import signal\nfrom iceg.cli import ending\nending.install()\nsignal.raise_signal(signal.SIGHUP)"
    words = ["nohup", sys.executable, "-c", code]
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0


def test_what_nobody_foresaw_is_called_a_bug(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> Any:
        raise ZeroDivisionError("division by zero")

    pipeline(broken)
    words = ["run", str(demo_log_path()), "-o", str(tmp_path / "out")]
    assert main(words) == 70
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("iceg: this is a bug of iceg: ZeroDivisionError: division by zero (iceg/cli/run_log.py:")
    assert "please report it" in told
    assert "--debug" in told
    assert main(["run", "--debug", *words[1:]]) == 70
    assert "Traceback" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_debug_hides_no_error_of_the_user(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(tmp_path / "none.clf"), "--debug"]) == 1
    captured = capsys.readouterr().err
    assert captured.startswith(f"iceg: {tmp_path / 'none.clf'}")
    assert captured.count("\n") == 1


def test_too_little_memory_is_said(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    def greedy(*_: object, **__: object) -> Any:
        raise MemoryError("Unable to allocate 93. GiB")

    pipeline(greedy)
    assert main(["run", str(demo_log_path()), "-o", str(tmp_path / "out")]) == 1
    assert "iceg: this takes more memory than there is (Unable to allocate 93. GiB)\n" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="names of files are bytes on POSIX only")
@pytest.mark.parametrize("name", [b"b\xfcro.clf.gz", "büro.clf.gz".encode()])
@pytest.mark.parametrize("settings", [{}, {"LC_ALL": "POSIX", "PYTHONUTF8": "0"}])
def test_a_log_with_any_name_can_be_run(tmp_path: Path, name: bytes, settings: dict[str, str]) -> None:
    log = os.fsencode(tmp_path) + b"/" + name
    with open(log, "wb") as file:  # noqa: PTH123 a path of bytes
        file.write(demo_log_path().read_bytes())
    words: list[str | bytes] = [sys.executable, "-m", "iceg", "info", log]
    done = subprocess.run(words, capture_output=True, check=False, env=os.environ | settings)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"ro.clf.gz" in done.stdout


def test_demo_compares_with_the_truth(
    tmp_path: Path, pipeline: Callable[[Pipeline], None], capsys: pytest.CaptureFixture[str]
) -> None:
    pipeline(by_odometry)
    assert main(["demo", "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert demo_truth_path().name in out
    assert "absolute trajectory error" in out
    assert "NEES" in out
    assert f"The map is {tmp_path / 'out' / 'map.png'}" in out

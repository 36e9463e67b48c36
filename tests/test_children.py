"""What the benchmark starts: nothing is imported from the current folder, and nothing is left behind."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from iceg.demo import demo_log_path
from iceg.evaluation.bench.child_process import Children
from iceg.evaluation.bench.runs import run_in_fresh_process

_HOSTILE = ("numpy", "multiprocessing", "json", "graph", "iceg")
_ICEG = [str(Path(sys.executable).with_name("iceg"))]


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A folder with modules that tell when they are imported."""
    folder = tmp_path / "hostile"
    folder.mkdir()
    for name in _HOSTILE:
        told = str(tmp_path / f"{name}-was-imported")
        (folder / f"{name}.py").write_text(f"open({told!r}, 'w').close()\nraise SystemExit(99)\n")
    return folder


def imported(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.parent.glob("*-was-imported"))


def test_an_experiment_imports_nothing_from_the_current_folder(hostile: Path) -> None:
    (hostile / "broken.clf").write_text("FLASER nonsense\n")  # soon done
    (hostile / "e.toml").write_text('logs = ["broken.clf"]\nmethods = ["icp"]\n')
    words = [*_ICEG, "bench", "e.toml", "-o", "out", "--workers", "2"]
    done = subprocess.run(words, cwd=hostile, capture_output=True, text=True, check=False)
    assert imported(hostile) == []
    assert "broken.clf:1: " in done.stderr


def test_a_run_in_a_fresh_process_imports_nothing_from_the_current_folder(
    hostile: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile)
    run = run_in_fresh_process(demo_log_path(), hostile / "out", ("--loops.no-enabled", "--finish.no-enabled"))
    assert imported(hostile) == []
    assert (run.folder / "summary.json").exists()


def test_children_end_together() -> None:
    children = Children()
    ended: list[int] = []

    def wait() -> None:
        ended.append(children.run("http.server", ["0", "--bind", "127.0.0.1"], {}).returncode)

    threads = [threading.Thread(target=wait) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(0.5)
    children.end()
    for thread in threads:
        thread.join()
    assert ended == [-signal.SIGTERM] * 2
    with pytest.raises(KeyboardInterrupt):
        children.run("this", [], {})


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM to send")
def test_a_benchmark_told_to_end_leaves_no_process_and_no_folder(tmp_path: Path) -> None:
    slow = '{method = "dp-slam", settings = {dp-slam.samples = 20000, dp-slam.particles = 2000}}'
    (tmp_path / "e.toml").write_text(f'logs = ["scene:rooms"]\nmethods = [{slow}]\n')
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    words = [*_ICEG, "bench", "e.toml", "-o", "out"]
    environment = os.environ | {"TMPDIR": str(temporary)}
    with subprocess.Popen(words, cwd=tmp_path, stdout=-1, stderr=-1, text=True, env=environment) as process:
        while not any(temporary.iterdir()) and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        try:
            _, complaint = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode == 143, complaint
    assert complaint.splitlines()[-1].startswith("iceg: interrupted, complete runs are kept in out")
    assert not any(temporary.iterdir())
    assert not list((tmp_path / "out").rglob("*"))[1:]

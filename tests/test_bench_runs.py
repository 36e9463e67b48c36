"""Whole experiments from the command line: processes of this machine, a Dask cluster, what is interrupted."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from distributed import Client

from iceg.cli import main
from iceg.evaluation.bench.cell import Cell, LogSource
from iceg.evaluation.bench.executors import attempt

pytestmark = pytest.mark.usefixtures("compiled")

PATIENCE_S = 600
"""What takes longer hangs, however slow and busy the machine."""

HALL = """
lasts 6
wall -3 -2  6 -2  6 2  -3 2  -3 -2
start 0 0 0
goto 2 0
goto 2 1
"""


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    path = tmp_path / "hall.world"
    path.write_text(HALL)
    return path


@pytest.fixture(autouse=True)
def _with_compiled_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)


@pytest.fixture(scope="module")
def compiled() -> None:
    """Kernels are compiled before anything with a limit on its time runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("NUMBA_DISABLE_JIT", raising=False)
        log = LogSource(name="room", path="scene:room")
        outcome = attempt(Cell(method="ice", label="ice", settings={}, swept={}, log=log, seed=0))
    assert outcome.error is None


def experiment(folder: Path, methods: str, logs: str) -> Path:
    path = folder / "experiment.toml"
    path.write_text(f"methods = {methods}\nlogs = {logs}\n")
    return path


def rows_of(output: Path) -> list[dict[str, str]]:
    with (output / "results.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_run_fails_the_rest_go_on_and_only_it_is_tried_again(
    tmp_path: Path, hall: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken.clf").write_text("FLASER nonsense\n")
    file, output = experiment(tmp_path, '["ice"]', f'["broken.clf", "scene:{hall}"]'), tmp_path / "out"
    assert main(["bench", str(file), "-o", str(output), "--workers", "2"]) == 1
    printed = capsys.readouterr()
    assert "1 of 2 runs failed" in printed.err
    assert "ice · broken · seed 0: failed: " in printed.err
    assert "broken.clf:1" in printed.err
    assert "| hall" in printed.out
    broken, good = rows_of(output)
    assert (broken["status"], good["status"]) == ("failed", "done")
    assert 0 < float(good["ate_rmse"]) < 0.1
    assert float(good["scans_per_cpu_s"]) > 0
    assert good["nees_mean"]
    trajectory = output / "cells" / "ice-hall-seed-0" / "trajectory.tum"
    assert len(trajectory.read_text().splitlines()) == int(good["scans"])
    assert (output / "results.parquet").exists()

    (tmp_path / "broken.clf").write_text("# mended, but empty\n")
    assert main(["bench", str(file), "-o", str(output)]) == 1
    printed = capsys.readouterr()
    assert printed.out.count("from before") == 1
    assert printed.err.count(": failed: ") == 1


def test_a_particle_filter_runs_beside(hall: Path) -> None:
    log = LogSource(name="hall", path=f"scene:{hall}")
    settings = {"dp-slam.particles": 5, "dp-slam.samples": 50}
    outcome = attempt(Cell(method="dp-slam", label="dp-slam", settings=settings, swept={}, log=log, seed=1))
    assert outcome.error is None
    assert 0 < outcome.figures["ate_rmse"] < 0.2
    assert "nees_mean" not in outcome.figures


def test_arguments_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    assert main(["bench", "--workers", "2", "-o", str(tmp_path)]) == 2
    file = experiment(tmp_path, '["ice"]', '["scene:room"]')
    assert main(["bench", str(file), "--parts", "runs", "-o", str(tmp_path)]) == 2
    assert main(["bench", str(file), "--workers", "0", "-o", str(tmp_path)]) == 2
    assert main(["bench", str(tmp_path / "none.toml"), "-o", str(tmp_path)]) == 1


def test_without_a_file_it_is_the_benchmark_on_real_logs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ICEG_DATA", raising=False)
    assert main(["bench", "-o", str(tmp_path), "--parts", "recall", "ablation"]) == 0
    assert "the embedded log only" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())
    assert main(["bench", "-o", str(tmp_path), "--data", str(tmp_path / "none")]) == 1


def test_ctrl_c_keeps_what_is_complete(tmp_path: Path, hall: Path) -> None:
    slow = '{method = "dp-slam", settings = {dp-slam.samples = 20000, dp-slam.particles = 2000}}'
    file, output = experiment(tmp_path, f'["ice", {slow}]', f'["scene:{hall}"]'), tmp_path / "out"
    command = [sys.executable, "-m", "iceg", "bench", str(file), "-o", str(output), "--workers", "2"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"TMPDIR": str(tmp_path)},
    )
    complete = output / "cells" / "ice-hall-seed-0" / "result.json"
    try:
        _wait_for(lambda: complete.exists() and any(tmp_path.glob("iceg-bench-*")), process)  # the slow one still runs
        os.killpg(process.pid, signal.SIGINT)
        _, complaint = process.communicate(timeout=PATIENCE_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    assert process.returncode == 130
    assert "Traceback" not in complaint
    assert "complete runs are kept" in complaint
    assert json.loads(complete.read_text(encoding="utf-8"))["error"] is None


def test_a_dask_cluster_runs_the_same_experiment(tmp_path: Path, hall: Path) -> None:
    (tmp_path / "broken.clf").write_text("FLASER nonsense\n")
    file = experiment(tmp_path, '["ice"]', f'["scene:{hall}", "broken.clf"]')
    output = tmp_path / "out"
    with cluster(tmp_path) as address:
        done = subprocess.run(
            [sys.executable, "-m", "iceg", "bench", str(file), "-o", str(output), "--scheduler", address],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        with Client(address, timeout=PATIENCE_S) as client:  # type: ignore[no-untyped-call]
            runs_of_workers = client.run(lambda dask_worker: dask_worker.state.executed_count)
    assert done.returncode == 1, done.stderr
    assert sorted(runs_of_workers.values()) == [1, 1]
    assert "1 of 2 runs failed" in done.stderr
    rows = rows_of(output)
    assert [(row["log"], row["seed"], row["status"]) for row in rows] == [
        ("hall", "0", "done"),
        ("broken", "0", "failed"),
    ]
    assert 0 < float(rows[0]["ate_rmse"]) < 0.1


def test_no_scheduler_at_the_address_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = experiment(tmp_path, '["ice"]', '["scene:room"]')
    assert main(["bench", str(file), "-o", str(tmp_path / "out"), "--scheduler", "nonsense://127.0.0.1"]) == 1
    assert "no Dask scheduler answers" in capsys.readouterr().err


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """A scheduler and two workers in processes of their own on the loopback; the address of the scheduler."""
    contact = folder / "scheduler.json"
    scheduler = [
        "dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
        "--scheduler-file",
        str(contact),
    ]
    processes = [_dask(folder, "scheduler", scheduler)]
    try:
        _wait_for(contact.exists, processes[0])
        for k in range(2):
            worker = ["dask_worker", "--scheduler-file", str(contact), "--host", "127.0.0.1", "--nthreads", "1"]
            options = ["--no-nanny", "--no-dashboard", f"--death-timeout={PATIENCE_S}", f"--local-directory={folder}"]
            processes.append(_dask(folder, f"worker-{k}", [*worker, *options]))
        for k in range(2):
            log = folder / f"worker-{k}.log"
            _wait_for(lambda log=log: "Registered to" in log.read_text(), processes[1 + k])  # type: ignore[misc]
        yield json.loads(contact.read_text())["address"]
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _dask(folder: Path, name: str, words: list[str]) -> "subprocess.Popen[bytes]":
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]], stdout=log, stderr=subprocess.STDOUT
        )


def _wait_for(condition: Callable[[], bool], process: "subprocess.Popen[bytes] | subprocess.Popen[str]") -> None:
    """Until the condition holds; not for ever, and not when the process has ended."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        if condition():
            return
        assert process.poll() is None, "the process has ended"
        time.sleep(0.05)
    pytest.fail(f"waited {PATIENCE_S} s in vain")

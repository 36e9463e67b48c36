"""Cost over the length of a run: parts of one log, each in a process of its own, as a table and a picture."""

from pathlib import Path

import pytest

from iceg.evaluation.bench.growth import LongRun, growth_rows, long_runs, save_plot, simulated_log

HALL = """
lasts 12
wall -3 -2  6 -2  6 2  -3 2  -3 -2
start 0 0 0
goto 2 0
goto 2 1
"""


@pytest.fixture(autouse=True)
def _with_compiled_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)


def run_of(scans: int, tracking_s: float) -> LongRun:
    return LongRun(
        scans=scans,
        key_poses=scans // 3,
        closures=7,
        cpu_s={"start and reading": 1.0, "front_end": tracking_s},
        peak_memory_mb=200.0,
        figures={"ate_rmse": 0.01},
    )


def test_each_scan_more_is_told_apart_from_the_start() -> None:
    first, second = growth_rows([run_of(1000, 1.0), run_of(3000, 2.0)])
    assert first["CPU a scan [ms]"] == pytest.approx(2.0)
    assert second["CPU a scan [ms]"] == pytest.approx(1.0)
    assert first["of each scan more [ms]"] is None
    assert second["of each scan more [ms]"] == pytest.approx(0.5)
    assert second["front end [ms]"] == pytest.approx(2.0 / 3.0)
    assert second["ATE [m]"] == 0.01
    assert second["largest error [m]"] is None


def test_parts_of_a_log_are_run_judged_and_drawn(tmp_path: Path) -> None:
    world = tmp_path / "hall.world"
    world.write_text(HALL)
    folder = tmp_path / "growth"
    simulated_log(folder, str(world))
    written = (folder / "log.clf").stat().st_mtime_ns
    simulated_log(folder, str(world))
    assert (folder / "log.clf").stat().st_mtime_ns == written, "a log that is there is not simulated again"
    runs = list(long_runs(folder, (25, 50)))
    assert [run.scans for run in runs] == [25, 50]
    for run in runs:
        assert run.figures["ate_rmse"] < 0.1
        assert run.cpu_total_s > 0.0
        assert run.peak_memory_mb > 50.0
        assert {"start and reading", "front_end", "grid", "writing"} <= set(run.cpu_s)
    save_plot(runs, tmp_path / "growth.png")
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG")

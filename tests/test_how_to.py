"""The examples of the how-to pages on stages of one's own and on mapping scan by scan, run on a short log."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iceg
from frontends.scan import Log
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.pipeline import resolve

PAGES = Path(__file__).parent.parent / "docs" / "how-to"
N_SCANS = 500


@pytest.fixture(scope="module")
def log() -> Log:
    """A lap of the embedded log, with loops in it."""
    return iceg.read_log(iceg.demo_log_path()).select(slice(N_SCANS))


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def results(log: Log) -> list[iceg.SlamResult]:
    """What each example of a stage ends with."""
    names: dict[str, Any] = {}
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(iceg, "read_log", lambda _: log)
        for block in blocks("own-stages.md"):
            exec(compile(block, "own-stages.md", "exec"), names)
            found.append(names.pop("result", None))
    return [result for result in found if result is not None]


def test_every_example_maps_the_log(results: list[iceg.SlamResult]) -> None:
    assert len(results) == 5
    truth = read_truth_csv(iceg.demo_truth_path())[:N_SCANS]
    for result in results:
        assert trajectory_errors(result.trajectory, truth).ate_rmse < 0.05


def test_loops_close_where_a_recogniser_says(results: list[iceg.SlamResult]) -> None:
    for result in results[:2]:
        assert any(
            closure.verdict == "accepted" and closure.scan_j - closure.scan_i > 100 for closure in result.closures
        )


def test_a_verdict_of_ones_own_holds(results: list[iceg.SlamResult]) -> None:
    by_overlap = results[2]
    accepted = [closure for closure in by_overlap.closures if closure.verdict == "accepted"]
    assert accepted
    assert all(closure.overlap >= 0.77 for closure in accepted)
    assert any("0.77 is asked" in closure.reason for closure in by_overlap.closures)


def test_another_solver_ends_at_the_same_optimum(results: list[iceg.SlamResult], log: Log) -> None:
    np.testing.assert_allclose(results[3].key_poses, iceg.run(log).key_poses, atol=1e-3)


def test_features_and_grid_of_ones_own_are_in_the_maps(results: list[iceg.SlamResult]) -> None:
    own = results[4]
    assert set(own.landmarks.kinds) == {0}
    assert own.grid.resolution == 0.1


def test_a_run_with_a_stage_of_ones_own_is_not_resolved(results: list[iceg.SlamResult]) -> None:
    with pytest.raises(iceg.IcegError, match="a stage of the caller's own"):
        resolve(results[2].findings)


def test_the_mapper_of_the_page_ends_as_a_run(log: Log, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    (block,) = blocks("scan-by-scan.md")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(iceg, "read_log", lambda _: log)
        exec(compile(block, "scan-by-scan.md", "exec"), names)
    np.testing.assert_array_equal(names["final"].trajectory, iceg.run(log).trajectory)
    assert "a loop closed at" in capsys.readouterr().out


def test_what_a_stage_returns_is_checked(log: Log) -> None:
    def later(key_new: int, _keys: Any, poses: Any) -> list[iceg.Candidate]:
        return [iceg.Candidate.of(key_new, key_new, poses, np.ones(3))]

    with pytest.raises(iceg.StageError, match=r"candidates: found key scans (\d+) and \1, expected an earlier one"):
        iceg.run(log.select(slice(200)), stages=iceg.Stages(candidates=later))
    with pytest.raises(iceg.StageError, match=r"solver: found poses of shape \(1, 3\), expected"):
        iceg.run(log.select(slice(60)), stages=iceg.Stages(solver=lambda _, poses: poses[:1]))

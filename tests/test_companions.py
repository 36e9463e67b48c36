"""Whoever goes along with the robot is left out of its scans, and nothing that stands is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import iceg
from frontends.logs import read_log
from frontends.scan import Log, ScanGeometry
from graph.se2 import between
from iceg.demo import demo_log_path
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.slam.companion_config import CompanionConfig
from iceg.slam.recording.companions import without_companions

_LOG = read_log(demo_log_path())
_ALL_AROUND = ScanGeometry(bearings=np.linspace(-np.pi, np.pi, 361)[:-1], range_min=0.05, range_max=20.0)
_STEP = 0.1


def _walk(seed: int, along: NDArray[np.float64] | None, trees: int = 25) -> Log:
    """A drive straight on among thin trees; with somebody at (n, 2) places seen from the laser, NaN for nobody."""
    rng, n = np.random.default_rng(seed), 120 if along is None else len(along)
    stand = rng.uniform((-6.0, -6.0), (n * _STEP + 6.0, 6.0), (trees, 2))
    stand = stand[np.abs(stand[:, 1]) > 0.5]
    driven = np.stack([np.arange(n) * _STEP, np.zeros(n)], axis=1)
    seen = stand[None, :, :] - driven[:, None, :]
    if along is not None:
        seen = np.concatenate([seen, along[:, None, :]], axis=1)
    far = np.hypot(seen[..., 0], seen[..., 1])
    ranges = np.full((n, 360), np.inf)
    for tree in range(seen.shape[1]):
        off = _ALL_AROUND.bearings - np.arctan2(seen[:, tree, 1], seen[:, tree, 0])[:, None]
        hit = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi) < (0.08 / far[:, tree])[:, None]
        ranges = np.where(hit, np.minimum(ranges, far[:, tree, None] - 0.08), ranges)
    return Log(
        ranges=np.where(ranges < 20.0, ranges, np.nan).astype(np.float32),
        odometry=np.column_stack([driven, np.zeros(n)]),
        stamps=0.1 * np.arange(n, dtype=np.float64),
        geometry=_ALL_AROUND,
        path=Path("walk"),
    )


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_trees_are_no_companions(seed: int) -> None:
    log = _walk(seed, None)
    assert without_companions(log, CompanionConfig()) is log


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    bearing=st.floats(-np.pi, np.pi),
    far=st.floats(0.6, 1.2),
    sway=st.floats(0.0, 0.15),
)
def test_somebody_who_goes_along_is_found_on_every_side(seed: int, bearing: float, far: float, sway: float) -> None:
    turn = bearing + sway * np.sin(np.arange(120) / 15.0)
    with_them = _walk(seed, far * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    theirs = np.nan_to_num(with_them.ranges) != np.nan_to_num(_walk(seed, None).ranges)
    left = without_companions(with_them, CompanionConfig())
    is_left = np.isfinite(left.ranges)
    assert is_left[theirs].mean() < 0.5  # a tree close by takes their place now and then
    assert is_left[np.isfinite(with_them.ranges) & ~theirs].mean() > 0.9


def test_it_takes_a_few_steps_to_be_sure() -> None:
    for steps, is_found in ((4, False), (5, True)):  # (.8 / .1) ** steps against one in 10,000
        places = np.full((120, 2), (1.0, 0.4))
        places[7 * steps + 2 :] = np.nan
        log = _walk(7, places, trees=0)
        assert (without_companions(log, CompanionConfig()) is not log) == is_found


def test_a_recording_in_which_nobody_goes_along_stays_as_it_is() -> None:
    assert without_companions(_LOG, CompanionConfig()) is _LOG
    along = DEGRADATIONS["companion"](_LOG).log
    assert without_companions(along, CompanionConfig(enabled=False)) is along
    blind = replace(along, has_odometry=False)
    assert without_companions(blind, CompanionConfig()) is blind
    standing = replace(along, odometry=np.zeros_like(along.odometry))
    assert without_companions(standing, CompanionConfig()) is standing


def test_a_run_does_not_follow_whoever_walks_ahead() -> None:
    along = DEGRADATIONS["companion"](_LOG).log
    result = iceg.run(along)
    off = between(iceg.run(_LOG).trajectory, result.trajectory)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert any("somebody goes along with the robot" in warning for warning in result.warnings)
    theirs = along.ranges != _LOG.ranges
    assert np.isfinite(result.log.ranges[theirs & np.isfinite(along.ranges)]).mean() < 0.5


@pytest.mark.parametrize("name", ["intel", "mit-csail", "mrpt-simul"])
def test_nobody_goes_along_in_the_public_logs(name: str, data_dir: Path) -> None:
    log = read_log(data_dir / f"{name}.clf.gz")
    assert without_companions(log, CompanionConfig()) is log

"""A robot that is carried away: found again by what it sees, or the run says where the path is broken."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from frontends.simulator.simulation import simulate
from graph.factors import Factor
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.degradation import DEGRADATIONS, every_metre, noisy
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors
from iceg.ice.matcher import IceMatcher
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult
from iceg.slam.broken_path.map_merging import Alignment, MapMerger
from iceg.slam.broken_path.path_break import Break, Outcome, TrackingFailure
from iceg.slam.broken_path.reassigned_scans import reassigned
from iceg.slam.broken_path.relocalisation import relocalise
from iceg.slam.closures.reference import References
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.own_body_config import OwnBodyConfig
from iceg.slam.solution import Solution
from iceg.slam.tracking.log_tracking import track_log

_KEEPS_ALL = FrontEndConfig(own_body=OwnBodyConfig(nearest=0.0))
"""Outliers right before the laser are left in."""
_QUICK = Config(grid=GridConfig(resolution=0.2), finish=FinishConfig(enabled=False))


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path())


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())


def _joined(first: Log, second: Log) -> Log:
    """One log after the other, as if nothing had happened in between: odometry does not see it."""
    moved = compose(first.odometry[-1], between(second.odometry[0], second.odometry))
    return replace(
        first,
        ranges=np.vstack([first.ranges, second.ranges]),
        odometry=np.vstack([first.odometry, moved]),
        stamps=np.arange(len(first) + len(second), dtype=np.float64),
    )


def _part(log: Log, first: int, last: int) -> Log:
    return replace(log, ranges=log.ranges[first:last], odometry=log.odometry[first:last], stamps=log.stamps[first:last])


def _carried(log: Log, cut: int, on: int) -> Log:
    """The log without the scans from `cut` to `on`: that far the robot was carried."""
    return _joined(_part(log, 0, cut), _part(log, on, len(log)))


def _rmse(result: SlamResult, truth: NDArray[np.float64], cut: int, on: int) -> float:
    return trajectory_errors(result.trajectory, np.vstack([truth[:cut], truth[on:]])).ate_rmse


@pytest.mark.parametrize(("cut", "on"), [(400, 900), (320, 600)])
def test_a_robot_carried_to_a_known_place_is_found_there(
    log: Log, truth: NDArray[np.float64], cut: int, on: int
) -> None:
    result = run(_carried(log, cut, on), _QUICK)
    assert _rmse(result, truth, cut, on) < 0.15
    (found,) = result.summary["breaks"]
    assert found["outcome"] == "joined"
    assert abs(found["scan"] - cut) <= 3
    moved = np.hypot(*(truth[on] - truth[cut])[:2])
    assert found["moved_m"] == pytest.approx(moved, abs=2.0)
    assert any(f"before scan {found['scan']} " in said for said in result.summary["warnings"])


def test_a_robot_carried_to_new_ground_is_found_once_it_comes_to_a_known_place(
    log: Log, truth: NDArray[np.float64]
) -> None:
    # Forty metres of what follows show nothing that was seen before; maps of twenty are compared.
    cut, on = 200, 450
    maps = replace(_QUICK.loops.relocalisation.maps, path=20.0)
    relocalisation = replace(_QUICK.loops.relocalisation, maps=maps)
    result = run(_carried(log, cut, on), replace(_QUICK, loops=replace(_QUICK.loops, relocalisation=relocalisation)))
    (found,) = result.summary["breaks"]
    assert found["outcome"] == "joined"
    assert abs(found["scan"] - cut) <= 3
    assert _rmse(result, truth, cut, on) < 0.05


def test_what_is_joined_first_decides_where_the_next_part_belongs(log: Log, truth: NDArray[np.float64]) -> None:
    # Carried twice: while the first break was open, what follows the second fitted two places that are one.
    parts = [(0, 295), (1311, 1614), (911, len(log))]
    twice = _joined(_joined(_part(log, *parts[0]), _part(log, *parts[1])), _part(log, *parts[2]))
    result = run(twice, Config(grid=_QUICK.grid))
    assert [found["outcome"] for found in result.summary["breaks"]] == ["joined", "joined"]
    there = np.vstack([truth[first:last] for first, last in parts])
    assert trajectory_errors(result.trajectory, there).ate_rmse < 0.02


def test_a_robot_carried_while_its_odometry_jumps_is_found(log: Log, truth: NDArray[np.float64]) -> None:
    carried = _carried(log, 884, 1094)
    odometry = carried.odometry.copy()
    odometry[884:] = compose(compose(odometry[883], np.array([-3.0, 4.0, 2.0])), between(odometry[884], odometry[884:]))
    result = run(replace(carried, odometry=odometry), _QUICK)
    (found,) = result.summary["breaks"]
    assert (found["scan"], found["outcome"]) == (884, "joined")
    assert "odometry jumped" in " ".join(result.summary["warnings"])
    assert _rmse(result, truth, 884, 1094) < 0.15


def test_a_break_near_the_beginning_is_told(log: Log) -> None:
    result = run(_carried(log, 136, 262), _QUICK)
    (found,) = result.summary["breaks"]
    assert abs(found["scan"] - 136) <= 5


def test_the_finish_keeps_what_was_joined(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(_carried(log, 400, 900), replace(_QUICK, finish=FinishConfig()))
    assert _rmse(result, truth, 400, 900) < 0.03


def test_a_robot_carried_to_a_place_never_seen_is_told_apart(log: Log) -> None:
    elsewhere = simulate("rooms", seed=2).log
    cut = 900
    result = run(_joined(_part(log, 0, cut), _part(elsewhere, 0, 900)), replace(_QUICK, finish=FinishConfig()))
    # The wheels slip by 4.7° before scan 606, which no closure spans here: that may be told, too.
    (found,) = (each for each in result.summary["breaks"] if each["outcome"] != "conflict")
    assert found["outcome"] == "apart"
    assert cut <= found["scan"] <= cut + 10
    assert any("no loop closure ties the rest" in said for said in result.summary["warnings"])
    ends = [(closure.scan_i, closure.scan_j) for closure in result.closures if closure.verdict == "accepted"]
    assert not [pair for pair in ends if pair[0] < cut <= pair[1]]


def test_a_jump_that_next_to_nothing_gave_away_is_mended(log: Log, truth: NDArray[np.float64]) -> None:
    # Into a corridor that looks like the one before: the front end does not notice, the map of all that follows tells.
    cut, on = 506, 1300
    result = run(_carried(log, cut, on), _QUICK)
    (found,) = result.summary["breaks"]
    assert (found["outcome"], found["scan"]) == ("joined", cut)
    assert _rmse(result, truth, cut, on) < 0.03


def test_a_jump_that_little_gave_away_is_mended_or_reported(log: Log, truth: NDArray[np.float64]) -> None:
    result = run(_carried(log, 688, 988), _QUICK)
    (found,) = result.summary["breaks"]
    assert abs(found["scan"] - 688) <= 5
    assert _rmse(result, truth, 688, 988) < 0.15


@pytest.mark.parametrize("n_scans", [500, 606, 1848])
def test_a_log_in_order_has_no_breaks(log: Log, n_scans: int) -> None:
    # Before any loop is closed, nothing but its own matches tells that a corridor of even doors is not another.
    assert run(_part(log, 0, n_scans), _QUICK).summary["breaks"] == []


def test_where_odometry_told_the_way_closures_across_a_loss_stay(log: Log, truth: NDArray[np.float64]) -> None:
    """One scan a metre, many outliers: nothing matches behind a corner, but the robot was never carried."""
    sparse = every_metre(log)
    result = run(
        noisy(sparse.log, deviation=0.02, outliers=0.2).log,
        replace(_QUICK, finish=FinishConfig(), front_end=_KEEPS_ALL),
    )
    assert result.summary["lost_at_scans"]
    assert {found["outcome"] for found in result.summary["breaks"]} <= {"conflict"}
    assert trajectory_errors(result.trajectory, truth[sparse.scans]).ate_rmse < 0.05


def test_a_loss_across_which_maps_contradict_each_other_is_told(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    nowhere = Alignment(correction=np.zeros(3), closures=[], log_odds=-9.0, is_path=True)
    monkeypatch.setattr(MapMerger, "alignments", lambda *_: [nowhere])
    sparse = noisy(every_metre(log).log, deviation=0.02, outliers=0.2).log
    monkeypatch.setattr(TrackingFailure, "by_odometry", lambda failure: failure)
    result = run(sparse, replace(_QUICK, front_end=_KEEPS_ALL))
    assert {found["outcome"] for found in result.summary["breaks"]} - {"conflict"} == {"apart"}
    assert any("do not agree well enough to tie the rest" in said for said in result.summary["warnings"])


@pytest.mark.parametrize("scan", [None, 400])
def test_scans_taken_before_the_next_key_scan_belong_to_it(log: Log, scan: int | None) -> None:
    # The robot stands still for six scans after it was carried: they are no key scans, but they see the new place.
    still = _joined(_part(log, 0, 400), _part(log, 900, 901))
    for _ in range(5):
        still = _joined(still, _part(log, 900, 901))
    still = _joined(still, _part(log, 901, 1000))
    track = track_log(still, IceMatcher(), OdometryModel(), FrontEndConfig())
    key = next(k for k, key_scan in enumerate(track.keys) if key_scan.index >= 400)
    assert (track.key_of_scan[400:405] == key - 1).all()
    tied = reassigned(track, [Break(key=key, outcome=Outcome.JOINED, reason="", scan=scan)], still, IceMatcher())
    assert (tied.key_of_scan[400 : track.keys[key].index + 1] == key).all()
    assert (tied.key_of_scan[:400] == track.key_of_scan[:400]).all()
    if scan is None:
        poses = np.array([key_scan.T_track_robot for key_scan in track.keys])
        np.testing.assert_allclose(tied.trajectory(poses), track.trajectory(poses), atol=1e-9)
    else:  # where odometry says: tracking has looked for them at the old place
        moved = between(still.odometry[track.keys[key].index], still.odometry[400:405])
        np.testing.assert_allclose(tied.T_key_scan[400:405], moved, atol=1e-9)


def test_references_and_supporters_stay_on_their_side_of_a_loss(log: Log) -> None:
    track = track_log(_carried(log, 400, 900), IceMatcher(), OdometryModel(), FrontEndConfig())
    poses = np.array([key.T_track_robot for key in track.keys])
    key = next(k for k, scan in enumerate(track.keys) if scan.index in track.lost)
    references = References(IceMatcher(), track, LoopClosureConfig().reference_half)
    sizes = [len(references.around(base, poses).placed) for base in (key - 20, key - 1, key, key + 20)]
    assert sizes == [15, 8, 8, 15]
    assert [references.is_one_pass(key, other) for other in (key - 1, key + 1)] == [False, True]


def test_neighbours_are_not_sought_across_parts_that_nothing_ties(log: Log) -> None:
    track = track_log(_part(log, 0, 1500), IceMatcher(), OdometryModel(), FrontEndConfig())
    poses = np.array([key.T_track_robot for key in track.keys])
    newest, deviations = len(track.keys) - 1, np.array([0.3, 0.3, 0.1])
    whole = LoopCloser(IceMatcher(), track, LoopClosureConfig())
    parted = LoopCloser(IceMatcher(), track, LoopClosureConfig(), parts=[newest - 100])

    def earliest(closer: LoopCloser) -> int:
        found = [c.key_old for key in range(200, newest, 5) for c in closer.passes.within(key, poses, deviations)]
        return min(found, default=newest)

    assert earliest(whole) < newest - 100
    keys = range(newest - 99, newest + 1)
    across = [c for key in keys for c in parted.passes.within(key, poses, deviations) if c.key_old < newest - 100]
    assert not across


def test_what_the_drift_left_behind_is_found_by_its_map(log: Log, truth: NDArray[np.float64]) -> None:
    """A wheel that is too large turns the robot by a sixth of a degree a metre; no loop was closed on the way."""
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    seen = np.array([key.T_track_robot for key in track.keys])
    steps = between(seen[:-1], seen[1:])
    bent = steps + np.array([0.0, 0.0, 0.003]) * np.hypot(*steps[:, :2].T)[:, None]
    poses, covariance = [seen[0]], np.diag([0.03, 0.03, 0.02]) ** 2
    for step in bent:
        poses.append(compose(poses[-1], step))
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=seen[0], covariance=1e-6 * np.eye(3))] + [
        Factor(kind="odometry", i=key - 1, j=key, T_i_j=step, covariance=covariance)
        for key, step in enumerate(bent, start=1)
    ]
    everywhere = np.ones(len(poses), dtype=np.bool_)
    drifted = Solution(factors=factors, poses=np.array(poses), attempts=[], searchable=everywhere)
    found, _ = relocalise(LoopCloser(IceMatcher(), track, LoopClosureConfig()), drifted, {})
    there = truth[[key.index for key in track.keys]]
    before, after = (trajectory_errors(each.poses, there).ate_rmse for each in (drifted, found))
    assert {each.outcome for each in found.breaks} == {"drifted"}
    assert after < 0.2 * before


def test_a_step_that_match_and_odometry_contradict_is_not_explained_by_drift(data_dir: Path) -> None:
    # A minute of MIT CSAIL left out: what follows matches the wrong corner, with a steady 25 m for the path to bend.
    carried = DEGRADATIONS["carried"](read_log(data_dir / "mit-csail.clf.gz")).log
    result = run(carried, _QUICK)
    (found,) = result.summary["breaks"]
    assert found["outcome"] == "joined"
    assert abs(found["scan"] - 994) <= 3
    assert 24.0 < found["moved_m"] < 30.0

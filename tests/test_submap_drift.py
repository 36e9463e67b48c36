"""What holds a match may lie off the newest key scan: which scan saw it last, and what dead reckoning adds since."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Log, Scan, ScanGeometry
from frontends.simulator.laser import cast
from frontends.simulator.world import World, polyline
from graph.measurement import NoMatch, RelativePose
from graph.noise import squared_norm
from graph.odometry import OdometryMotion
from graph.se2 import between, logmap, transform_points
from iceg.config import Config
from iceg.ice.matcher import IceMatcher
from iceg.slam.track import KeyScan
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking.submap_drift import SubmapDrift

F64 = NDArray[np.float64]
ROUND = ScanGeometry(
    bearings=np.radians(np.arange(-180.0, 180.0, 1.0)),
    range_min=0.05,
    range_max=4.0,
    T_robot_laser=np.zeros(3),
)
END = 12.0


def corridor() -> World:
    """Two metres wide, its end at x = 12, the other one out of sight."""
    return World.empty().with_segments(polyline([(-60, -1), (END, -1), (END, 1), (-60, 1)]))


def ranges_at(poses: F64, seed: int = 0) -> NDArray[np.float32]:
    seen = cast(corridor(), poses, ROUND.bearings, ROUND.range_max)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, seen.shape)
    return np.where(np.isfinite(seen), seen + noise, np.nan).astype(np.float32)


def scans_at(*x: float) -> tuple[list[Scan], F64]:
    poses = np.array([(position, 0.0, 0.0) for position in x])
    return [Scan(ranges=ranges, geometry=ROUND) for ranges in ranges_at(poses)], poses


def told_slowly(scan: Scan, pose: F64, scans: Sequence[Scan], poses: F64, margin: float, every: int) -> F64:
    """What each scan was the last to see, point by point."""
    points = IceMatcher().observe(scan).points
    told = np.zeros((len(scans), 3, 3))
    rows = zip(points.points[::every], points.normals[::every], points.spreads[::every], strict=True)
    for point, normal, spread in rows:
        world = transform_points(pose, point[None])[0]
        facing = transform_points(np.array([0.0, 0.0, pose[2]]), normal[None])[0]
        for k in reversed(range(len(scans))):
            seen = world - poses[k, :2]
            distance = np.linalg.norm(seen)
            cosine = -seen @ facing / distance
            beam = round((np.arctan2(seen[1], seen[0]) - poses[k, 2] - ROUND.bearings[0]) / ROUND.resolution)
            if not normal.any() or distance < 0.3 or cosine < 0.05 or not 1 <= beam < len(ROUND.bearings) - 1:
                continue
            if (np.abs(scans[k].ranges[beam - 1 : beam + 2] - distance) * cosine <= margin).any():
                lever = np.array([*normal, normal[1] * point[0] - normal[0] * point[1]])
                told[k] += np.outer(lever, lever) / spread
                break
    return told


def test_what_each_scan_was_the_last_to_see_equals_a_slow_twin() -> None:
    matcher = IceMatcher()
    scans, poses = scans_at(9.0, 7.0, 5.0)
    (scan,), (pose,) = scans_at(8.6)
    told = matcher.last_seen(matcher.prepare(scans, poses), scan, pose)
    refinement, points = matcher.config.refinement, matcher.observe(scan).points
    every = 1 + len(points) // 200
    slow = told_slowly(scan, pose, scans, poses, refinement.agreeing * refinement.scale, every)
    np.testing.assert_allclose(told, slow, rtol=1e-6, atol=1e-6)


def test_the_end_of_a_corridor_was_seen_last_by_who_stood_near_it() -> None:
    matcher = IceMatcher()
    scans, poses = scans_at(9.0, 7.0, 5.0)
    (scan,), (pose,) = scans_at(8.6)
    told = matcher.last_seen(matcher.prepare(scans, poses), scan, pose)
    along, across = told[:, 0, 0], told[:, 1, 1]
    assert along[0] > 0.9 * along.sum(), "the end tells how far along, and from 7 m it is out of sight"
    assert across[1:].sum() > 0.5 * across.sum(), "the walls were seen later, too"


STEP = np.diag([0.1, 0.0, 0.0]) ** 2


def key(x: float) -> KeyScan:
    """A key scan so far along."""
    place = np.array([x, 0.0, 0.0])
    return KeyScan(
        index=0,
        scan=scans_at(0.0)[0][0],
        motion=OdometryMotion(T_key_robot=place, covariance=STEP, distance=1.0, turn=0.0),
        match=NoMatch(reason="none"),
        anchor=0,
        T_track_robot=place,
    )


def drift_of(steps: Sequence[F64 | None], told: F64) -> F64:
    """Of a match, 10 m along, to the map of a first key scan and of those at the end of each step."""
    keys = [key(float(x)) for x in range(len(steps) + 1)]
    drift = SubmapDrift()
    for step in steps:
        drift.add(STEP if step is None else step, None if step is None else np.eye(3))
    return drift.of(told, list(range(len(keys))), keys, np.array([10.0, 0.0, 0.0]))


def told_by(n: int, along: int, across: int) -> F64:
    """A match along x told by what one key scan of n was the last to see, all else by what another was."""
    told = np.zeros((n, 3, 3))
    told[along, 0, 0] = 1e6
    told[across, [1, 2], [1, 2]] = 1e6
    return told


@pytest.mark.parametrize("n_steps", [1, 4])
def test_along_a_corridor_the_variances_of_odometry_add_up(n_steps: int) -> None:
    drift = drift_of([STEP] * n_steps, told_by(n_steps + 1, along=0, across=n_steps))
    assert drift[0, 0] == pytest.approx(n_steps * 0.1**2, rel=1e-3)
    assert np.abs(drift[1:]).max() < 1e-9, "across it and in heading the newest saw the walls"


def test_only_the_steps_since_it_was_seen_count() -> None:
    drift = drift_of([STEP] * 4, told_by(5, along=3, across=4))
    assert drift[0, 0] == pytest.approx(0.1**2, rel=1e-3)


def test_what_holds_a_match_by_halves_moves_it_by_half() -> None:
    told = 0.5 * told_by(3, along=0, across=2) + 0.5 * told_by(3, along=2, across=2)
    assert drift_of([STEP] * 2, told)[0, 0] == pytest.approx(2 * 0.05**2, rel=1e-3)


def test_steps_that_matches_hold_add_nothing() -> None:
    assert not drift_of([None, None], told_by(3, along=0, across=2)).any()


def test_a_turn_swings_what_lies_ahead() -> None:
    turn = np.diag([0.0, 0.0, 0.03]) ** 2
    drift = drift_of([turn, turn], told_by(3, along=0, across=0))
    assert drift[1, 1] == pytest.approx(0.03**2 * (9**2 + 8**2), rel=1e-3)


def test_who_is_matched_again_does_not_lie_off_by_what_was_unmatched_between() -> None:
    keys, told = [key(float(x)) for x in range(4)], told_by(2, along=0, across=1)
    held, weak = SubmapDrift(), SubmapDrift()
    for drift, share in ((held, None), (weak, np.eye(3))):
        drift.add_unmatched(STEP)
        drift.add_unmatched(STEP)
        drift.add(STEP, share)
    assert not held.of(told, [0, 3], keys, np.array([10.0, 0.0, 0.0])).any(), "a match says how 3 lies to 0"
    found = weak.of(told, [0, 3], keys, np.array([10.0, 0.0, 0.0]))
    assert found[0, 0] == pytest.approx(3 * 0.1**2, rel=1e-3), "odometry does, all the way"


def test_it_is_asked_only_where_a_step_was_not_held() -> None:
    drift = SubmapDrift()
    match = RelativePose(
        T_ref_cur=np.zeros(3),
        covariance=np.diag([0.001, 0.001, 0.001]) ** 2,
        score=1.0,
        inliers=1,
        overlap=1.0,
        weak_directions=np.empty((0, 3)),
    )
    for _ in range(11):
        drift.add(STEP, None)
    assert not drift.may_matter(match, range(12))
    drift.add(STEP, np.eye(3))
    assert drift.may_matter(match, range(13))
    assert not drift.may_matter(replace(match, covariance=np.eye(3)), range(13))


def there_and_back(seed: int) -> tuple[Log, F64]:
    """Away from the end of a corridor until it is out of sight, and back; odometry errs by a tenth of each step."""
    x = np.concatenate([np.arange(9.5, 3.0, -0.1), np.arange(3.0, 9.5, 0.1)])
    truth = np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))])
    rng = np.random.default_rng(seed)
    steps = np.diff(x) * (1.0 + np.repeat(rng.normal(0.0, 0.1, len(x) // 5 + 1), 5)[: len(x) - 1])
    odometry = np.zeros((len(x), 3))
    odometry[1:, 0] = np.cumsum(steps)
    stamps = np.arange(len(x), dtype=np.float64)
    return Log(
        ranges=ranges_at(truth, seed), odometry=odometry, stamps=stamps, geometry=ROUND, path=Path("corridor")
    ), truth


def surprises(seed: int) -> F64:
    """Squared Mahalanobis distances of the matches of a drive there and back from the truth."""
    log, truth = there_and_back(seed)
    config = Config()
    keys = track_log(log, IceMatcher(), config.odometry, config.front_end).keys
    places = truth[[one.index for one in keys]]
    return np.array(
        [
            squared_norm(logmap(between(one.match.T_ref_cur, between(places[one.anchor], place))), one.match.covariance)
            for one, place in zip(keys, places, strict=True)
            if isinstance(one.match, RelativePose)
        ]
    )


def test_who_comes_back_to_the_end_of_a_corridor_does_not_know_how_far_he_is_from_the_scan_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = np.array([surprises(seed).max() for seed in range(3)])
    monkeypatch.setattr(SubmapDrift, "may_matter", lambda *_: False)
    before = np.array([surprises(seed).max() for seed in range(3)])
    assert (found < 25).all()
    assert np.median(before) > 20 * np.median(found), "the test must show what it is about"

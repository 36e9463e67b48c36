"""Matching again after the optimum is known: only what it may change."""

import math
from dataclasses import dataclass, field, replace
from typing import Self, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import simulate
from graph.factors import Factor, RobustKernel
from graph.measurement import RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.ice.matcher import IceMatcher
from iceg.slam.closures.attempt import Attempt, Place
from iceg.slam.closures.candidates import Candidate
from iceg.slam.closures.record import with_earlier
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.rematch import match_again
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log

F64 = NDArray[np.float64]


@pytest.fixture(scope="module")
def track() -> Track:
    return track_log(simulate("office", seed=1).log, IceMatcher(), OdometryModel(), FrontEndConfig())


def tried(old: int, new: int, *, accepted: bool, reason: str = "") -> Attempt:
    match = RelativePose(
        T_ref_cur=np.zeros(3),
        covariance=np.eye(3),
        score=1.0,
        inliers=100,
        overlap=1.0,
        weak_directions=np.zeros((0, 3)),
    )
    return Attempt(key_old=old, key_new=new, match=match if accepted else None, accepted=accepted, reason=reason)


@dataclass
class Closer:
    """Offers one pass, so many key poses back, and believes every match."""

    track: Track
    searchable: NDArray[np.bool_]
    back: int
    config: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    matched: list[tuple[int, int]] = field(default_factory=list)

    @property
    def passes(self) -> Self:
        return self

    def within(self, key_new: int, poses: F64, deviations: F64) -> list[Candidate]:
        old = key_new - self.back
        return [Candidate.of(old, key_new, poses, deviations)] if old >= 0 else []

    def match(self, candidate: Candidate, poses: F64) -> Attempt:
        np.testing.assert_allclose(candidate.T_old_new, between(poses[candidate.key_old], poses[candidate.key_new]))
        self.matched.append((candidate.key_old, candidate.key_new))
        return tried(candidate.key_old, candidate.key_new, accepted=True)


def loop(i: int, j: int) -> Factor:
    kernel = RobustKernel(name="dcs", width=5.0)
    return Factor(kind="closure", i=i, j=j, T_i_j=np.zeros(3), covariance=np.eye(3), kernel=kernel)


def matched_again(track: Track, sure: list[Factor], outliers: list[Factor], back: int = 50) -> list[tuple[int, int]]:
    closer = Closer(track=track, searchable=np.ones(len(track.keys), dtype=np.bool_), back=back)
    poses = np.array([key.T_track_robot for key in track.keys])
    attempts = match_again(cast("LoopCloser", closer), poses, sure, outliers, FinishConfig())
    assert sorted(closer.matched) == sorted((a.key_old, a.key_new) for a in attempts)
    assert [a.key_new for a in attempts] == sorted(a.key_new for a in attempts)
    return closer.matched


def test_a_pass_is_matched_once_for_every_reference(track: Track) -> None:
    reach = LoopClosureConfig().reference_half
    news = sorted(new for _, new in matched_again(track, [], []))
    assert news[0] < 50 + 2 * reach
    assert (np.diff(news) > reach).all()
    assert (np.diff(news) < 3 * reach).all()


def test_what_a_sure_closure_ties_is_not_matched_again(track: Track) -> None:
    reach = LoopClosureConfig().reference_half
    sure = [loop(new - 50, new) for new in range(50, len(track.keys), reach)]
    assert matched_again(track, sure, []) == []
    # A closure elsewhere ties nothing here: neither of the later key poses alone nor of the earlier ones.
    assert matched_again(track, [loop(i, j) for i, j in ((0, 100), (90, 105))], []) == matched_again(track, [], [])


def test_outliers_are_tried_again_and_tie_when_they_hold(track: Track) -> None:
    reach = LoopClosureConfig().reference_half
    again = matched_again(track, [], [loop(40, 90)])
    assert again[0] == (40, 90)
    assert all(abs(new - 90) > reach for _, new in again[1:])


def test_the_record_keeps_what_was_not_tried_again() -> None:
    earlier = [tried(1, 50, accepted=True), tried(2, 40, accepted=False, reason="before"), tried(9, 60, accepted=True)]
    record = with_earlier([tried(2, 40, accepted=True), tried(1, 45, accepted=True)], earlier)
    assert [(a.key_old, a.key_new, a.accepted) for a in record] == [
        (2, 40, True),
        (1, 45, True),
        (1, 50, True),
        (9, 60, True),
    ]


def test_what_is_tried_again_still_tells_what_the_first_search_found() -> None:
    places = (Place(T_old_new=np.zeros(3), misfit=0.05), Place(T_old_new=np.array([2.0, 0.0, 0.0]), misfit=0.2))
    first = replace(tried(2, 40, accepted=True), off_path=1.5, places=places)
    again, fresh = with_earlier([tried(2, 40, accepted=True), tried(3, 45, accepted=True)], [first])
    assert (again.off_path, again.places) == (1.5, places)
    assert math.isnan(fresh.off_path)

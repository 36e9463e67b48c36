"""A loop closure that was tried: what it says, and whether that agrees with an estimate or with another closure."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from graph.arrays import Floats
from graph.factors import Factor, RobustKernel
from graph.measurement import RelativePose
from graph.se2 import between, compose, inverse
from graph.short_repr import short_repr
from iceg.slam.agreement import Tolerance, agree
from iceg.slam.closure_config import VerificationConfig

FORBIDDEN = "forbidden by hand"
"""Why a closure that a person forbids is not even matched."""


class Verdict(StrEnum):
    """What became of a loop closure that was tried."""

    ACCEPTED = "accepted"
    """It is in the graph."""
    REJECTED = "rejected"
    """It never was."""
    REMOVED = "removed"
    """It was, before it was found to be wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a key scan fits an earlier pass.

    Attributes:
        T_old_new: (3,) its pose in the frame of the earlier key pose.
        misfit: share of its beams that do not agree there, plus share of what is in view that it does not see.
    """

    T_old_new: Floats
    misfit: float

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One loop closure that was tried.

    Attributes:
        key_old: index of the earlier key pose.
        key_new: index of the later one.
        match: what the matcher said, None if it found nothing credible.
        accepted: whether it may enter the graph.
        reason: why, or why not.
        overlap: share of the beams that fall on the earlier pass at the best pose found.
        removed: whether it was in the graph before it was found to be wrong.
        places: where the later key scan fits, the one it was matched at first; empty where it was looked for close to
            the estimate only.
        off_path: how far off the path it was when it was judged on the way, in standard deviations, at most; NaN where
            it was not.
    """

    key_old: int
    key_new: int
    match: RelativePose | None
    accepted: bool
    reason: str
    overlap: float = 0.0
    removed: bool = False
    places: tuple[Place, ...] = ()
    off_path: float = math.nan

    __repr__ = short_repr

    @property
    def verdict(self) -> Verdict:
        """What became of it."""
        if self.accepted:
            return Verdict.ACCEPTED
        return Verdict.REMOVED if self.removed else Verdict.REJECTED

    @property
    def pair(self) -> tuple[int, int]:
        """The two key poses that it joins, the earlier first."""
        return self.key_old, self.key_new

    def spans(self, key: int) -> bool:
        """Whether it joins both sides of the step that leads to a key pose."""
        return self.key_old < key <= self.key_new

    @property
    def is_ambiguous(self) -> bool:
        """Whether it would be accepted if it did not fit elsewhere, too."""
        return self.match is not None and not self.accepted and len(self.places) > 1

    def is_at(self, T_old_new: Floats, tolerance: Tolerance) -> bool:
        """Whether its match agrees with where something else puts the later key pose, (3,) seen from the earlier."""
        return self.match is not None and agree(T_old_new, self.match.T_ref_cur, tolerance)

    def is_near(self, poses: Floats, tolerance: Tolerance) -> bool:
        """Whether its match agrees with the estimate given by (n, 3) poses."""
        return self.is_at(between(poses[self.key_old], poses[self.key_new]), tolerance)

    def judged(self, why: str, *, accepted: bool = False) -> "Attempt":
        """The same with another verdict, and why."""
        return replace(self, accepted=accepted, reason=f"{why}; {self.reason}")

    def taken_out(self, why: str) -> "Attempt":
        """The same after it was found to be wrong, and left the graph."""
        return replace(self.judged(why), removed=True)


def unmatched(key_old: int, key_new: int, reason: str) -> Attempt:
    """The record of a closure for which there is no match, and why."""
    return Attempt(key_old=key_old, key_new=key_new, match=None, accepted=False, reason=reason)


def closure_factor(attempt: Attempt, kernel: RobustKernel | None = None) -> Factor:
    """A closure that was matched, as a factor of the graph.

    One that was looked for close to the estimate alone tells nothing along what it does not observe: along a ring each
    lies where its guess had it, and many that claim 1 m there would add up to what none has seen. One that was looked
    for in the whole window has been compared with the other places there, and says what it claims.
    """
    assert attempt.match is not None
    match = attempt.match
    return Factor(
        kind="closure",
        i=attempt.key_old,
        j=attempt.key_new,
        T_i_j=match.T_ref_cur,
        covariance=match.covariance if attempt.places else match.informed_covariance,
        kernel=kernel,
    )


def closed_pose(attempt: Attempt, poses: Floats) -> Floats:
    """(3,) T_map_robot of the later key pose as a closure says, the earlier one being where (n, 3) poses put it."""
    assert attempt.match is not None
    return compose(poses[attempt.key_old], attempt.match.T_ref_cur)


def implied_correction(attempt: Attempt, poses: Floats) -> Floats:
    """(3,) what moves the later key pose, in the map of (n, 3) poses, to where a closure puts it."""
    return compose(closed_pose(attempt, poses), inverse(poses[attempt.key_new]))


def are_consistent(a: Attempt, b: Attempt, poses: Floats, config: VerificationConfig) -> bool:
    """Whether two closures agree on how the later path lies to the earlier (pairwise consistency, Mangelson 2018).

    Args:
        a: one of them.
        b: the other.
        poses: (n, 3) estimates, good between neighbouring key poses.
        config: how far they may differ.

    Returns:
        True if going one way round the cycle or the other leads to the same place.
    """
    if a.match is None or b.match is None or a.key_new == b.key_new or abs(a.key_new - b.key_new) > config.partner_keys:
        return False
    left = compose(a.match.T_ref_cur, between(poses[a.key_new], poses[b.key_new]))
    right = compose(between(poses[a.key_old], poses[b.key_old]), b.match.T_ref_cur)
    return agree(left, right, config.partner)

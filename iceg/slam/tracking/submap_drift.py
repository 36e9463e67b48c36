"""How far the walls that hold a match may lie off the newest key scan of the local map.

Where the key scans of a map could not see how far they came, the map is as long as odometry says. Who turns back in a
corridor and meets its end again knows where that is, but not how far he is from the key scan before.
"""

from collections.abc import Sequence

import numpy as np

from graph.arrays import Floats
from graph.dense import congruence, inv, matmul
from graph.measurement import RelativePose
from graph.se2 import adjoint, between
from iceg.slam.track import KeyScan

_COUNTS = 1.0
"""What drift adds to the variance of a match counts from this share of it on."""


class SubmapDrift:
    """What of the errors of the steps between key scans is that of dead reckoning, and what it does to matches."""

    def __init__(self) -> None:
        """Of the first key scan alone."""
        self._steps: list[Floats | None] = [None]
        self._sizes = [0.0]
        self._unmatched = np.zeros((3, 3))

    def add(self, odometry: Floats, share: Floats | None) -> None:
        """Take in the next key scan: how far it may lie off the map that it was matched to, by odometry's fault.

        What its match errs by is not that: it is relative to walls that those before and after are matched to, too.

        Args:
            odometry: (3, 3) of the step since the key scan before.
            share: (3, 3) of what odometry said against the match, how much was believed; None for nothing.
        """
        self._append(None if share is None else congruence(share, self._unmatched + odometry))
        self._unmatched = np.zeros((3, 3))

    def add_unmatched(self, odometry: Floats) -> None:
        """Take in a next key scan that lies where odometry has it, (3, 3), seen from the one before."""
        self._append(odometry)
        self._unmatched = self._unmatched + odometry

    def _append(self, step: Floats | None) -> None:
        self._steps.append(step)
        self._sizes.append(self._sizes[-1] + (0.0 if step is None else float(np.trace(step))))

    def may_matter(self, match: RelativePose, members: Sequence[int]) -> bool:
        """Whether the key scans of a map may lie so far off each other that it counts beside a match to it."""
        drift = self._sizes[members[-1]] - self._sizes[members[0]]
        return bool(drift > _COUNTS * min(match.covariance[0, 0], match.covariance[1, 1]))

    def of(self, told: Floats, members: Sequence[int], keys: Sequence[KeyScan], T_track_robot: Floats) -> Floats:
        """What a match errs by relative to the newest key scan of the map, beyond its own covariance.

        If the map is off by e_k where key scan k saw it last, the match moves by Σ I⁻¹ I_k e_k: I_k is what it tells by
        what k was the last to see, I all of it. So what key scan s lies off those before moves it by I⁻¹ Σ_{k<s} I_k.

        Args:
            told: (m, 3, 3) I_k, see `iceg.ice.matcher.IceMatcher.last_seen`.
            members: the m key scans of the map, in their order.
            keys: all key scans.
            T_track_robot: (3,) the match, in the frame of their poses.

        Returns:
            (3, 3) tangent space at the match.
        """
        before = np.cumsum(told, axis=0)
        # Of a direction that hardly a point holds nothing can be said; there the match is unsure anyway.
        shares = matmul(inv(before[-1] + np.eye(3)), before[:-1])
        moved = [(k, step) for k, step in enumerate(self._steps[member] for member in members[1:]) if step is not None]
        if not moved:
            return np.zeros((3, 3))
        which = [k for k, _ in moved]
        T_track_moved = np.array([keys[members[k + 1]].T_track_robot for k in which])
        carried = matmul(shares[which], adjoint(between(T_track_robot, T_track_moved)))
        return np.asarray(congruence(carried, np.array([step for _, step in moved])).sum(axis=0))

"""Places seen again: candidates from the graph, ICE against a local map of the earlier pass, verification."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from graph.measurement import NoMatch, RelativePose
from graph.se2 import between, compose
from iceg.ice.verification import Agreement
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import KeyScan


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One loop closure that was tried.

    Attributes:
        key_old: index of the earlier key pose.
        key_new: index of the later one.
        match: what the matcher said, None if it found nothing credible.
        accepted: whether it may enter the graph.
        reason: why, or why not.
    """

    key_old: int
    key_new: int
    match: RelativePose | None
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An earlier pass that may have seen what a key scan sees."""

    key_old: int
    T_old_new: NDArray[np.float64]
    covariance: NDArray[np.float64]


class LoopCloser:
    """Looks for earlier passes around a key pose and matches against their local maps."""

    def __init__(self, matcher: Matcher, keys: list[KeyScan], config: LoopClosureConfig) -> None:
        self._matcher = matcher
        self._keys = keys
        self._config = config
        steps = np.array([key.motion.distance for key in keys])
        self._path = np.cumsum(steps)
        self._references: dict[int, tuple[Any, NDArray[np.float64]]] = {}

    def candidates(self, key_new: int, poses: NDArray[np.float64], drift: NDArray[np.float64]) -> list[Candidate]:
        """Earlier passes whose view overlaps that of `key_new`, nearest first.

        Args:
            key_new: the key pose.
            poses: (n, 3) current estimate of all key poses up to it.
            drift: (3,) standard deviations of its pose relative to the earlier passes [m, m, rad].

        Returns:
            One candidate per pass, the key pose whose view lies nearest.
        """
        config = self._config
        views = poses[:, :2] + config.view_distance * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        far = np.hypot(*(views[: key_new + 1] - views[key_new]).T)
        old = self._path[key_new] - self._path[: key_new + 1] > config.min_path
        near = np.flatnonzero(old & (far < config.radius + 2.0 * drift[0]))
        if not len(near):
            return []
        passes = np.split(near, np.flatnonzero(np.diff(near) > config.pass_gap) + 1)
        best = sorted((float(far[p].min()), int(p[far[p].argmin()])) for p in passes)
        covariance = np.diag(drift**2)
        return [
            Candidate(key_old=key, T_old_new=between(poses[key], poses[key_new]), covariance=covariance)
            for _, key in best[: config.max_passes]
        ]

    def match(self, candidate: Candidate, key_new: int, poses: NDArray[np.float64]) -> Attempt:
        """Match a key scan against the local map of a candidate's pass and verify it with its neighbours."""
        base = candidate.key_old
        reference = self._reference(base, poses)
        guess = candidate.T_old_new
        found = self._matcher.match(reference, self._keys[key_new].scan, guess, candidate.covariance)
        record = Attempt(key_old=base, key_new=key_new, match=None, accepted=False, reason="")
        if isinstance(found, NoMatch):
            return replace(record, reason=found.reason)
        record = replace(record, match=found)
        support = self._support(reference, key_new, found.T_ref_cur)
        told = f"overlap {support.overlap:.2f}, fit {support.fit:.2f}, view {support.view:.2f}"
        config = self._config
        if support.overlap < config.min_overlap or support.fit < config.min_fit or support.view < config.min_view:
            return replace(record, reason=told)
        return replace(record, accepted=True, reason=told)

    def _reference(self, base: int, poses: NDArray[np.float64]) -> Any:  # noqa: ANN401
        """Local map of the key scans of one pass around `base`, in the frame of `base`."""
        half = self._config.reference_half
        members = np.arange(max(0, base - half), min(len(poses), base + half + 1))
        placed = between(poses[base], poses[members])
        cached = self._references.get(base)
        if cached is not None and len(cached[1]) == len(placed) and np.abs(cached[1] - placed).max() < 0.01:
            return cached[0]
        order = np.argsort(-np.abs(members - base), kind="stable")
        reference = self._matcher.prepare([self._keys[members[k]].scan for k in order], placed[order])
        self._references = {base: (reference, placed)} if len(self._references) > 8 else self._references
        self._references[base] = (reference, placed)
        return reference

    def _support(self, reference: Any, key_new: int, T_ref_new: NDArray[np.float64]) -> Agreement:  # noqa: ANN401
        """How a key scan and its neighbours agree with the reference at the poses a closure implies for them."""
        total = Agreement()
        for offset in self._config.support_offsets:
            other = key_new + offset
            if 0 <= other < len(self._keys):
                T_new_other = between(self._keys[key_new].T_track_robot, self._keys[other].T_track_robot)
                T_ref_other = compose(T_ref_new, T_new_other)
                total += self._matcher.agreement(reference, self._keys[other].scan, T_ref_other)
        return total

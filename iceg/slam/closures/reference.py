"""Local maps of earlier passes, which later scans are matched against and judged by."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from graph.arrays import Floats, Ints
from graph.se2 import between
from iceg.ice.local_map import LocalMap
from iceg.slam.map_matcher import MapMatcher, Prepared
from iceg.slam.track import Track

_KEPT = 6
"""References kept: the key scans of a pass ask for the same ones."""
_STILL = 0.01
"""A reference is built anew when its scans have moved by more than this against each other [m, rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """An earlier pass, prepared for the matcher and for the judge of its matches.

    Attributes:
        matched: what the matcher made of it.
        judged: its local map, in the frame of the key pose it is built around.
        placed: (m, 3) poses of its scans in that frame.
    """

    matched: Prepared
    judged: LocalMap
    placed: Floats


class References:
    """Builds references; keeps the last few, since consecutive searches look at the same passes."""

    def __init__(self, matcher: MapMatcher, track: Track, half: int) -> None:
        """Of so many key scans on either side of a key pose."""
        self._matcher = matcher
        self._keys = track.keys
        self._half = half
        self._lost = track.lost
        self._kept: dict[int, Reference] = {}

    def is_one_pass(self, key: int, other: int) -> bool:
        """Whether the robot was never lost between two key poses, so that the track says how they lie."""
        return len(set(self._parts([key, other]).tolist())) == 1

    def around(self, base: int, poses: Floats) -> Reference:
        """Local map of the key scans of one part of the path at `base`, in its frame, placed as (n, 3) poses say."""
        members = np.arange(max(0, base - self._half), min(len(poses), base + self._half + 1))
        members = members[self._parts(members) == self._parts([base])]
        placed = between(poses[base], poses[members])
        kept = self._kept.get(base)
        if kept is not None and len(kept.placed) == len(placed) and np.abs(kept.placed - placed).max() < _STILL:
            return kept
        if len(self._kept) >= _KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[base] = self._built(base, members, placed)
        return self._kept[base]

    def _parts(self, members: Iterable[int]) -> Ints:
        """How often the robot was lost until each of these key poses."""
        return np.searchsorted(self._lost, [self._keys[member].index for member in members], side="right")

    def _built(self, base: int, members: Ints, placed: Floats) -> Reference:
        nearest_last = np.argsort(-np.abs(members - base), kind="stable")
        scans, poses_ref = [self._keys[members[k]].scan for k in nearest_last], placed[nearest_last]
        matched = self._matcher.prepare(scans, poses_ref)
        return Reference(matched=matched, judged=self._matcher.judged(matched), placed=placed)

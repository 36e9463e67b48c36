"""Where loop closures are looked for: earlier passes that look at what a key scan sees.

A pass is a part of the path through the surroundings. Each proposes the one key pose whose view lies nearest: its
neighbours are in the same reference and would only say the same again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from graph.arrays import Bools, Floats
from graph.elementary import cos_sin
from graph.growing_rows import GrowingRows
from graph.se2 import between
from iceg.slam.config import LoopClosureConfig
from iceg.slam.drift import Drift
from iceg.slam.track import Track

ANCHOR_SPACING = 4
"""Key poses from one reference to the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An earlier pass that may have seen what a key scan sees.

    Attributes:
        key_old: the key pose of that pass whose view lies nearest.
        key_new: of the key scan.
        T_old_new: (3,) how they lie to each other as far as is known.
        deviations: (3,) how well that is known [m, m, rad].
    """

    key_old: int
    key_new: int
    T_old_new: Floats
    deviations: Floats

    @property
    def pair(self) -> tuple[int, int]:
        """The two key poses, the earlier first."""
        return self.key_old, self.key_new

    @classmethod
    def of(cls, key_old: int, key_new: int, poses: Floats, deviations: Floats) -> "Candidate":
        """Two of (n, 3) key poses, known to within `deviations`, (3,) [m, m, rad], of each other."""
        T_old_new = between(poses[key_old], poses[key_new])
        return cls(key_old=key_old, key_new=key_new, T_old_new=T_old_new, deviations=deviations)


class EarlierPasses:
    """Finds the passes around a key pose, by what is known of where it is."""

    def __init__(self, track: Track, config: LoopClosureConfig, parts: Sequence[int]) -> None:
        """Start with every key scan as a candidate.

        Args:
            track: key scans.
            config: how far passes are looked for, and how many are tried.
            parts: key poses at which a part of the path begins that nothing ties to what was before.
        """
        self._config = config
        self._keys = track.keys
        self._parts = parts
        self._path: GrowingRows[np.float64] = GrowingRows((), np.float64)
        self._searchable: GrowingRows[np.bool_] = GrowingRows((), np.bool_)
        self.extend()

    def extend(self) -> None:
        """Add the key scans that the track has gained since."""
        for index in range(len(self._path), len(self._keys)):
            before = self._path.rows[-1] if index else 0.0
            self._path.append(before + self._keys[index].motion.distance)
            self._searchable.append(True)

    @property
    def searchable(self) -> Bools:
        """(n_keys,) which key scans later ones are matched against, to be written to: not those in confirmed areas."""
        return self._searchable.rows

    def within_drift(self, key_new: int, poses: Floats, drift: Drift) -> list[Candidate]:
        """Those that the drift since the last closure leaves possible; see `LoopCloser.candidates`."""
        config = self._config
        if not config.enabled:
            return []
        spread = drift.spread(key_new, poses)
        widest = float(self._search_deviations(spread.since(0))[0])
        is_uncertain = widest > 2 * config.verification.trusted_distance
        piece = 2 * config.reference_half if is_uncertain else len(poses)
        near = self._nearest(key_new, poses, config.radius + 2.0 * widest, piece)
        found = []
        for distance, key in near:
            deviations = self._search_deviations(spread.since(key))
            if distance < config.radius + 2.0 * deviations[0]:
                found.append(Candidate.of(key, key_new, poses, deviations))
        return found[: config.max_pieces if is_uncertain else config.max_passes]

    def within(self, key_new: int, poses: Floats, deviations: Floats) -> list[Candidate]:
        """Those around where poses, all known to within `deviations` [m, m, rad], put a key scan; nearest first.

        Args:
            key_new: of the key scan.
            poses: (n, 3) T_map_robot.
            deviations: (3,) of every candidate.
        """
        return self._candidates(
            self._nearest(key_new, poses, self._config.radius, len(self._path)), key_new, poses, deviations
        )

    def before(self, first: int, key_new: int, poses: Floats, deviations: Floats, reach: float) -> list[Candidate]:
        """As `within`, only those before a key pose; where none is around, the nearest whose view is within reach [m].

        What a laser sees far off others may have seen from there.
        """
        near = self._nearest(key_new, poses, self._config.radius, len(self._path), first)
        near = near or self._nearest(key_new, poses, reach, len(self._path), first)[:1]
        return self._candidates(near, key_new, poses, deviations)

    def _candidates(
        self, near: Sequence[tuple[float, int]], key_new: int, poses: Floats, deviations: Floats
    ) -> list[Candidate]:
        return [Candidate.of(key, key_new, poses, deviations) for _, key in near[: self._config.max_passes]]

    def _search_deviations(self, drift: Floats) -> Floats:
        """Standard deviations [m, m, rad] of a search, from those of the path."""
        config = self._config
        position = min(config.max_drift, config.drift_factor * float(drift[0]) + config.drift_floor)
        heading = min(config.max_turn, config.drift_factor * float(drift[1]) + config.turn_floor)
        return np.array([position, position, heading])

    def _nearest(
        self, key_new: int, poses: Floats, reach: float, piece: int, before: int | None = None
    ) -> list[tuple[float, int]]:
        """Distance of the views and key pose of each piece of an earlier pass within reach, nearest first."""
        path = self._path.rows
        newest = key_new if before is None else before
        n_old = min(newest, int(np.searchsorted(path, path[key_new] - self._config.min_path)))
        may_see = self.searchable[:n_old].copy()
        may_see[: max((start for start in self._parts if start <= key_new), default=0)] = False
        # No view is nearer than its robot, less twice the distance of a view.
        offsets = poses[:n_old, :2] - poses[key_new, :2]
        may_see &= (offsets * offsets).sum(axis=1) < (reach + 2.0 * self._config.view_distance) ** 2
        old = np.flatnonzero(may_see)
        views = self._views(poses[np.append(old, key_new)])
        far = np.hypot(*(views[:-1] - views[-1]).T)
        near = np.flatnonzero(far < reach)
        if not len(near):
            return []
        old, far = old[near], far[near]
        passes = [0, *(np.flatnonzero(np.diff(old) > self._config.pass_gap) + 1).tolist(), len(old)]
        nearest = [
            start + int(far[start:end].argmin())
            for first, last in pairwise(passes)
            for start, end in pairwise(_evenly(first, last, piece))
        ]
        return sorted((float(far[k]), _anchor(int(old[k]), newest)) for k in nearest)

    def _views(self, poses: Floats) -> Floats:
        """(..., 2) what key poses look at."""
        ahead = np.stack(cos_sin(poses[..., 2]), axis=-1)
        return poses[..., :2] + self._config.view_distance * ahead


def _evenly(first: int, last: int, most: int) -> list[int]:
    """Bounds of the fewest pieces of a range of no more than so many each, the longer ones first."""
    count = -(-(last - first) // most)
    size, longer = divmod(last - first, count)
    return [first + k * size + min(k, longer) for k in range(count + 1)]


def _anchor(key: int, newest: int) -> int:
    """The key pose whose frame a reference around `key` has: neighbours share one, so that it is built once."""
    anchor = ANCHOR_SPACING * round(key / ANCHOR_SPACING)
    return anchor if anchor < newest else key

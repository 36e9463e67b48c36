"""Map merging: in which ways the map of a part of the path may lie to those of others, and which way is right.

Each alignment is verified by key scans that are matched where it puts them. The alignments, the path as it is, and that
the parts have seen nothing of each other exclude each other: how much more probable each makes maps and matches is how
probable it is. A building that is alike all over has many such alignments, and none of them is probable then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, log
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graph.arrays import Floats, Ints
from graph.se2 import compose, wrap_angle
from iceg.slam.agreement import agree
from iceg.slam.broken_path.geometric_verification import FitCount, GeometricVerifier
from iceg.slam.broken_path.map_alignment import PartMaps
from iceg.slam.closures.attempt import Attempt, Place, implied_correction
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """How a part may lie to the others.

    Attributes:
        correction: (3,) moves its poses, in the map.
        closures: that say so.
        log_odds: how much more probable it makes maps and matches than if the parts had nothing to do with each other,
            the logarithm.
        is_path: whether it is where the path has it.
    """

    correction: Floats
    closures: list[Attempt]
    log_odds: float
    is_path: bool = False

    def also(self, log_odds: float) -> "Alignment":
        """The same, which may have come about in another way, too: so many times as probably, the logarithm."""
        return replace(self, log_odds=self.log_odds + log_sum([0.0, log_odds]))


class Belief(NamedTuple):
    """What alignments that exclude each other make of the path, and of the most probable of them.

    Attributes:
        alignment: that is more probable than all else together; None if none is.
        log_odds: how many times as probable it is as all else, the logarithm.
        log_odds_path: the same of the path.
    """

    alignment: Alignment | None
    log_odds: float
    log_odds_path: float

    @property
    def path(self) -> Alignment | None:
        """That of the path, if it is the one."""
        return self.alignment if self.alignment is not None and self.alignment.is_path else None

    @property
    def elsewhere(self) -> Alignment | None:
        """Any other that is."""
        return None if self.path is not None else self.alignment


def weighed(alignments: Sequence[Alignment], path: float, nothing: float) -> Belief:
    """What to believe of several alignments.

    Args:
        alignments: they; that of the path may be missing, where the maps tell nothing of it.
        path: log-odds of the path before its maps are compared.
        nothing: log-odds of that the part has seen nothing that others saw: by chance the best of all alignments is
            about as good.
    """
    path += sum(alignment.log_odds for alignment in alignments if alignment.is_path)
    others = [alignment.log_odds for alignment in alignments if not alignment.is_path]
    log_odds_path = path - log_sum([nothing, *others])
    for alignment in alignments:
        odds = path if alignment.is_path else alignment.log_odds
        rest = [each.log_odds for each in alignments if each is not alignment and not each.is_path]
        against = log_sum([nothing, *rest] if alignment.is_path else [nothing, path, *rest])
        if odds > against:
            return Belief(alignment, odds - against, log_odds_path)
    return Belief(None, 0.0, log_odds_path)


class MapMerger:
    """Lays the map of a part onto those of other parts."""

    def __init__(self, track: Track, verifier: GeometricVerifier, config: LoopClosureConfig) -> None:
        self._track = track
        self._verifier = verifier
        self._config = config.relocalisation.maps

    def alignments(self, key: int, whole: Ints, fixed: Ints, poses: Floats) -> list[Alignment]:
        """The ways in which what follows a key pose may lie to what was before, that of the path among them.

        Args:
            key: the first key pose of the part.
            whole: (k,) what holds together, but for the step to that key pose.
            fixed: (n,) key poses before it that it is laid onto.
            poses: (k, 3) T_map_robot.
        """
        later = self._following(key)
        later = later[whole[later] == whole[key]]
        parts = [fixed[whole[fixed] == first] for first in np.unique(whole[fixed]).tolist()]
        newest = int(fixed[-1]) if len(fixed) else -1
        largest = sorted(parts, key=lambda part: (part[-1] == newest, len(part)), reverse=True)
        return [
            alignment
            for part in largest[: self._config.most_parts]
            for alignment in self._onto(key, part, later, poses, is_path=bool(part[-1] == newest))
        ]

    def contradict(self, key: int, fixed: Ints, poses: Floats) -> bool:
        """Whether the map of what follows a key pose contradicts what was before where the path has it.

        Args:
            key: the first key pose that follows.
            fixed: (n,) key poses before it.
            poses: (k, 3) T_map_robot.
        """
        maps = self._maps(fixed, self._following(key), poses)
        return not maps.are_empty and maps.log_odds(np.zeros(3)) < 0.0

    def change_point(self, steps: Ints, log_odds: Floats, correction: Floats, poses: Floats) -> int:
        """Before which key pose the path is broken, if what follows is to be moved.

        Scans before it fit where the path has them, later ones where they are moved.

        Args:
            steps: (n,) later key poses of the steps where it may be, ascending.
            log_odds: (n,) of each before anything is compared.
            correction: (3,) moves what follows, in the map.
            poses: (k, 3) T_map_robot; what was before the first of the steps is believed.
        """
        first, last = int(steps[0]), int(steps[-1])
        between = np.arange(first, last)
        maps = self._maps(np.arange(first), between, poses)
        if maps.are_empty:
            return int(steps[log_odds.argmax()])
        gains = maps.log_odds_of_each(between, correction) - maps.log_odds_of_each(between, np.zeros(3))
        after = np.append(gains[::-1].cumsum()[::-1], 0.0)[steps - first]
        return int(steps[(log_odds + self._of_cells(after)).argmax()])

    def _following(self, key: int) -> Ints:
        """(n,) the key poses from one on, as far as their map is compared."""
        path = self._track.path
        return np.flatnonzero((np.arange(len(path)) >= key) & (path < path[key] + self._config.path))

    def _maps(self, fixed: Ints, moving: Ints, poses: Floats) -> PartMaps:
        return PartMaps([key.scan for key in self._track.keys], poses, fixed, moving, self._config)

    def _onto(self, key: int, fixed: Ints, moving: Ints, poses: Floats, *, is_path: bool) -> list[Alignment]:
        """The ways in which one part may lie to another."""
        maps = self._maps(fixed, moving, poses)
        if maps.are_empty:
            return []
        middle = np.array([*maps.middle, 0.0])
        some = moving[:: -(-len(moving) // self._config.scans)]
        places, found = [], list[Alignment]()
        if is_path:
            places.append(middle)
            fit = self._verifier.of_scans(key, some, poses[some], poses)
            found.append(replace(self._alignment(np.zeros(3), fit, maps), is_path=True))
        for around in maps.alignments():
            fit = self._verifier.of_scans(key, some, compose(around, poses[some]), poses)
            if not fit.agreeing:
                continue
            there = _where_most_put(fit.agreeing, around[2], middle, poses)
            if any(agree(there, other, self._config.one_way) for other in places):
                continue
            places.append(there)
            correction = compose(there, -middle)
            fit = self._verifier.of_scans(key, some, compose(correction, poses[some]), poses)
            if fit.agreeing:
                found.append(self._alignment(correction, fit, maps))
        return found

    def _alignment(self, correction: Floats, fit: FitCount, maps: PartMaps) -> Alignment:
        """What cells and scans say of an alignment.

        Neither are independent of each other: walls of one room lie well or badly together, and what is alike is so all
        over. So cells count by the root of what they would tell otherwise, and that an alignment is found at all by as
        many scans as find it.
        """
        cells = maps.log_odds(correction)
        found = len({closure.key_new for closure in fit.agreeing})
        return Alignment(
            correction=correction,
            closures=[_found_anywhere(closure) for closure in fit.agreeing],
            log_odds=float(self._of_cells(cells)) + self._config.scan_weight * fit.log_odds + log(max(found, 1)),
        )

    def _of_cells(self, log_odds: ArrayLike) -> Floats:
        """What cells tell, which would tell so much if they were independent."""
        return self._config.cell_weight * np.copysign(np.sqrt(np.abs(log_odds)), log_odds)


def _where_most_put(closures: Sequence[Attempt], turn: float, middle: Floats, poses: Floats) -> Floats:
    """(3,) where the median of some closures puts the middle of a part, (3,), turned by about so much."""
    moved = np.array([compose(implied_correction(closure, poses), middle) for closure in closures])
    turned = turn + float(np.median(wrap_angle(moved[:, 2] - turn)))
    return np.array([*np.median(moved[:, :2], axis=0), turned])


def _found_anywhere(closure: Attempt) -> Attempt:
    """The same as of a search that went everywhere, not one close to an estimate alone."""
    if closure.match is None:
        return closure
    return replace(closure, places=(Place(T_old_new=closure.match.T_ref_cur, misfit=0.0),))


def log_sum(logarithms: Sequence[float]) -> float:
    """The logarithm of a sum, given those of what is added."""
    most = max(logarithms)
    return most + log(sum(exp(each - most) for each in logarithms))

"""Where a part of the path lies: the ways in which its map fits those of other parts, and which of them is right.

Each way is verified by key scans that are matched where it puts them. The ways, the path as it is, and that the parts
have seen nothing of each other exclude each other: how much more probable each makes maps and matches is how probable
it is. A building that is alike all over has many such ways, and none of them is probable then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import copysign, exp, log, sqrt

import numpy as np

from graph.arrays import Floats, Ints
from graph.se2 import compose, wrap_angle
from iceg.slam.broken_path.hypothesis_verification import FitCount, HypothesisVerifier
from iceg.slam.broken_path.map_alignment import PartMaps
from iceg.slam.broken_path.place_hypothesis import implied_correction
from iceg.slam.closures.attempt import Attempt, Place
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
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


def best_way(ways: Sequence[Way], log_prior_of_path: float, elsewhere: float) -> tuple[Way, float] | None:
    """The way that is more probable than all others together, and how much more, the logarithm; never the path's.

    Args:
        ways: they.
        log_prior_of_path: how many times as probable it is before maps are compared that the path is right as that it
            is not, the logarithm.
        elsewhere: log-odds at which a way is as probable as that the part has seen nothing that others saw, for by
            chance, too, the best of all ways is about as good; so it is where the path is right.
    """
    odds = [way.log_odds + (log_prior_of_path + elsewhere if way.is_path else 0.0) for way in ways]
    for index, way in enumerate(ways):
        against = _log_sum([elsewhere, *odds[:index], *odds[index + 1 :]])
        if odds[index] > against and not way.is_path:
            return way, odds[index] - against
    return None


class MapSearch:
    """Lays the map of a part onto those of other parts."""

    def __init__(self, track: Track, verifier: HypothesisVerifier, config: LoopClosureConfig) -> None:
        self._track = track
        self._verifier = verifier
        self._config = config.relocalisation.maps
        self._contradiction = config.relocalisation.contradiction

    def ways(self, key: int, whole: Ints, poses: Floats) -> list[Way]:
        """The ways in which what follows a key pose may lie to what was before, that of the path among them.

        Args:
            key: the first key pose of the part.
            whole: (k,) what holds together, but for the step to that key pose.
            poses: (k, 3) T_map_robot.
        """
        later, earlier = self._following(key), np.arange(key)
        later = later[whole[later] == whole[key]]
        parts = [earlier[whole[:key] == first] for first in np.unique(whole[:key]).tolist()]
        largest = sorted(parts, key=lambda part: (part[-1] == key - 1, len(part)), reverse=True)
        return [
            way
            for part in largest[: self._config.most_parts]
            for way in self._onto(key, part, later, poses, is_path=bool(part[-1] == key - 1))
        ]

    def contradict(self, key: int, poses: Floats) -> bool:
        """Whether the map of what follows a key pose contradicts what was before where the path has it.

        Args:
            key: the first key pose that follows.
            poses: (k, 3) T_map_robot.
        """
        maps = self._maps(np.arange(key), self._following(key), poses)
        return not maps.are_empty and maps.log_odds(np.zeros(3)) < 0.0

    def _following(self, key: int) -> Ints:
        """(n,) the key poses from one on, as far as their map is compared."""
        path = self._track.path
        return np.flatnonzero((np.arange(len(path)) >= key) & (path < path[key] + self._config.path))

    def _maps(self, fixed: Ints, moving: Ints, poses: Floats) -> PartMaps:
        return PartMaps([key.scan for key in self._track.keys], poses, fixed, moving, self._config)

    def _onto(self, key: int, fixed: Ints, moving: Ints, poses: Floats, *, is_path: bool) -> list[Way]:
        """The ways in which one part may lie to another."""
        maps = self._maps(fixed, moving, poses)
        if maps.are_empty:
            return []
        middle = np.array([*maps.middle, 0.0])
        some = moving[:: -(-len(moving) // self._config.scans)]
        places, ways = [], list[Way]()
        if is_path:
            places.append(middle)
            fit = self._verifier.of_scans(key, some, poses[some], poses)
            ways.append(replace(self._way(np.zeros(3), fit, maps), is_path=True))
        for around in maps.alignments():
            fit = self._verifier.of_scans(key, some, compose(around, poses[some]), poses)
            if not fit.agreeing:
                continue
            there = _where_most_put(fit.agreeing, around[2], middle, poses)
            if any(maps.are_same(there, other) for other in places):
                continue
            places.append(there)
            correction = compose(there, -middle)
            fit = self._verifier.of_scans(key, some, compose(correction, poses[some]), poses)
            if fit.agreeing:
                ways.append(self._way(correction, fit, maps))
        return ways

    def _way(self, correction: Floats, fit: FitCount, maps: PartMaps) -> Way:
        """What cells and scans say of a way.

        Neither are independent of each other: walls of one room lie well or badly together, and what is alike is so all
        over. So cells count by the root of what they would tell otherwise, and that a way is found at all by as many
        scans as find it.
        """
        cells = maps.log_odds(correction)
        scans = self._contradiction.log_odds(len(fit.agreeing), fit.against)
        found = len({closure.key_new for closure in fit.agreeing})
        return Way(
            correction=correction,
            closures=[_found_anywhere(closure) for closure in fit.agreeing],
            log_odds=self._config.cell_weight * copysign(sqrt(abs(cells)), cells)
            + self._config.scan_weight * scans
            + log(max(found, 1)),
        )


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


def _log_sum(logarithms: Sequence[float]) -> float:
    """The logarithm of a sum, given those of what is added."""
    most = max(logarithms)
    return most + log(sum(exp(each - most) for each in logarithms))

"""Similar places, matched metres and half turns wide, and the sets of them that agree."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from graph.arrays import Floats, Ints
from graph.factors import Factor
from iceg.slam.broken_path.place_hypothesis import Hypothesis, agreeing_sets
from iceg.slam.broken_path.similar_places import similar_places
from iceg.slam.closures.attempt import Attempt
from iceg.slam.closures.candidates import Candidate
from iceg.slam.loop_closure import LoopCloser


class PlaceSearch:
    """Looks for places again, and remembers what it tried."""

    def __init__(self, closer: LoopCloser, factors: Sequence[Factor]) -> None:
        self._closer = closer
        self.path = [factor for factor in factors if factor.kind in {"odometry", "ice"}]
        """The factors from key pose to key pose, along which places must agree."""
        self._config = closer.config
        self._tried: list[Attempt] = []

    def agreeing(self, parts: Ints, poses: Floats, along: Floats, most: int) -> list[list[Attempt]]:
        """Sets of closures that agree, of similar places, the largest first; none if there are no new ones.

        Args:
            parts: (k,) which part each key pose belongs to; places of two are compared.
            poses: (k, 3) T_map_robot, good between neighbours.
            along: (k, 3) the same, of the path along which closures must agree.
            most: pairs of places that are worth a match.
        """
        known = {attempt.pair for attempt in self._tried}
        config = replace(self._config, places=most)
        pairs = set(similar_places(self._closer.track, self._closer.judge, parts, config)) - known
        if not pairs:
            return []
        self._tried += [self._closer.match_anywhere(old, new, poses) for old, new in sorted(pairs)]
        claims = [
            claim
            for attempt in self._tried
            if parts[attempt.key_old] != parts[attempt.key_new]
            for claim in _claims(attempt, self._config.relocalisation.max_fits)
        ]
        return agreeing_sets(claims, self.path, along, self._config.place_confirmations)

    def settled(self, claims: Sequence[Attempt], poses: Floats) -> list[Attempt]:
        """Claims that agree, each matched where it was made; an ambiguous one that confirms the path says nothing."""
        settled, near = [], self._config.verification.near
        for claim in claims:
            if claim.accepted:
                settled.append(claim)
            elif claim.match is not None and not claim.is_near(poses, near):
                there, deviations = claim.match.T_ref_cur, self._config.relocalisation.found.deviations
                old, new = claim.pair
                found = Candidate(key_old=old, key_new=new, T_old_new=there, deviations=deviations)
                attempt = self._closer.match(found, poses)
                if attempt.accepted and attempt.is_at(there, near):
                    settled.append(attempt)
        return settled

    def sure_support(self, hypothesis: Hypothesis) -> int:
        """How many key scans of a hypothesis fit one place only."""
        sure = {attempt.pair for attempt in self._tried if attempt.accepted}
        return len({closure.key_new for closure in hypothesis.closures if closure.pair in sure})

    def in_vain(self, closed: Collection[tuple[int, int]]) -> list[Attempt]:
        """What was tried and is not among the pairs of key poses that closures tie, with the reason."""
        return [
            attempt.judged(f"similar place{', too few agree' * attempt.accepted}")
            for attempt in self._tried
            if attempt.pair not in closed
        ]


def _claims(attempt: Attempt, most: int) -> list[Attempt]:
    """An attempt itself, or where it fitted several places one for each of the best."""
    if attempt.accepted:
        return [attempt]
    if not attempt.is_ambiguous or attempt.match is None:
        return []
    places = [place.T_old_new for place in attempt.places[:most]]
    return [replace(attempt, match=replace(attempt.match, T_ref_cur=T_old_new)) for T_old_new in places]

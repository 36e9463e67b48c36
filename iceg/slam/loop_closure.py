"""Places seen again: where to look for them, and what to believe of what is found there.

The back end on the way, the finish afterwards and the search for lost places ask the same two questions of a
`LoopCloser`: which earlier passes may see what a key scan sees, and does it match there?
"""

from collections.abc import Callable, Sequence

from graph.arrays import Floats
from iceg.slam.closures.attempt import FORBIDDEN, Attempt, unmatched
from iceg.slam.closures.candidates import Candidate, EarlierPasses
from iceg.slam.closures.verification import ClosureVerifier
from iceg.slam.config import LoopClosureConfig
from iceg.slam.drift import Drift
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.stages import IN_HOUSE, Stages, checked_candidates
from iceg.slam.track import Track

Forbids = Callable[[int, int], bool]
"""Whether a closure between an earlier and a later key pose must not be."""


class LoopCloser:
    """Looks for earlier passes around a key pose and matches against their local maps."""

    def __init__(
        self,
        matcher: MapMatcher,
        track: Track,
        config: LoopClosureConfig,
        parts: Sequence[int] = (),
        is_forbidden: Forbids | None = None,
        stages: Stages = IN_HOUSE,
    ) -> None:
        """Start with nothing matched.

        Args:
            matcher: ICE or any other.
            track: key scans.
            config: where passes are looked for and what is believed.
            parts: key poses at which a part of the path begins that nothing ties to what was before: how they lie to
                each other is unknown, so that no neighbours are looked for across.
            is_forbidden: whether a closure between an earlier and a later key pose must not be; None for none.
            stages: candidates and verification of the caller's own.
        """
        self.config = config
        self._keys = track.keys
        self._stages = stages
        self.judge = matcher.judge
        """The matcher that verifies."""
        self.passes = EarlierPasses(track, config, parts)
        """Where to look."""
        self._verifier = ClosureVerifier(matcher, track, config)
        self._is_forbidden = is_forbidden

    def candidates(self, key_new: int, poses: Floats, drift: Drift) -> list[Candidate]:
        """Earlier passes whose view overlaps that of `key_new`, nearest first.

        Args:
            key_new: the key pose.
            poses: (n, 3) current estimate of all key poses up to it.
            drift: how uncertain paths are.

        Returns:
            One candidate per pass, the key pose whose view lies nearest; after much drift, when the nearest need not be
            the right one, one for each piece of every pass.
        """
        if self._stages.candidates is not None:
            own = self._stages.candidates(key_new, self._keys[: key_new + 1], poses)
            return checked_candidates(own, key_new)
        return self.passes.within_drift(key_new, poses, drift)

    def match(self, candidate: Candidate, poses: Floats) -> Attempt:
        """Match a key scan against the local map of a candidate's pass and verify it with its neighbours.

        First close to the estimate; if nothing fits there, and the drift allows more, in the whole window, where a
        closure must also be the only one that fits. After much drift in the whole window at once.

        Args:
            candidate: the two key poses.
            poses: (n, 3) T_map_robot of all up to the later, good between neighbours.
        """
        if self._is_forbidden is not None and self._is_forbidden(*candidate.pair):
            return unmatched(*candidate.pair, FORBIDDEN)
        return self._verified(self._verifier.match(candidate, poses), poses)

    def match_anywhere(self, key_old: int, key_new: int, poses: Floats) -> Attempt:
        """Match two key scans of similar places, whatever the poses say: metres off, any heading.

        The pose must be the only one that fits there.

        Args:
            key_old: the earlier.
            key_new: the later.
            poses: (n, 3) T_map_robot, good between neighbours.
        """
        if self._is_forbidden is not None and self._is_forbidden(key_old, key_new):
            return unmatched(key_old, key_new, FORBIDDEN)
        return self._verified(self._verifier.match_anywhere(key_old, key_new, poses), poses)

    def _verified(self, attempt: Attempt, poses: Floats) -> Attempt:
        """With the caller's verdict, where there is one."""
        if self._stages.verification is None or attempt.match is None:
            return attempt
        return self._stages.verification(attempt, self._keys[: attempt.key_new + 1], poses)

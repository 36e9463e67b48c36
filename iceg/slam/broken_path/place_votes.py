"""Places that several key scans in a row fit: how many speak for one, and how many for another just as well.

One wide search may find a single place by chance, as where a reference ends before the next door. Along a corridor
of evenly spaced doors (perceptual aliasing) the searches before and after fit elsewhere, too. So all places that fit
are kept, and after much drift a closure is believed where hardly anything speaks for another place, or where many key
scans fit this one better (pairwise consistency of Mangelson et al. 2018, over the alternatives of each measurement).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from graph.arrays import Floats
from graph.se2 import between, compose
from iceg.slam.agreement import agree, are_small
from iceg.slam.closure_config import PlaceVotesConfig
from iceg.slam.closures.attempt import Attempt, closed_pose
from iceg.slam.config import LoopClosureConfig
from iceg.slam.run_warning import RunWarning
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Vote:
    """What speaks for a place, and what for the next best one.

    Attributes:
        first: the first key pose that speaks for it.
        last: the last.
        count: how many key scans do.
        rival: how many speak for the other place that is not clearly the worse, and has the most; 0 if there is none.
        apart: how far that one is away [m].
        searched: how many key scans were looked for since the first that speaks for it.
        misfit: of those that do, in the mean.
    """

    first: int
    last: int
    count: int
    rival: int = 0
    apart: float = 0.0
    searched: int = 1
    misfit: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Whether nothing speaks for any other place."""
        return self.rival == 0

    def is_strong(self, config: PlaceVotesConfig) -> bool:
        """Whether it settles what single searches leave open."""
        are_most = self.count >= max(config.many, config.strong_share * self.searched)
        return self.is_clear and are_most and self.misfit <= config.strong_misfit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Voted:
    """A place of the newest key scan, (3,) in the map, and the key scans that fit it, each with its misfit."""

    T_map_key: Floats
    misfits: dict[int, float]

    def is_worse_than(self, other: "_Voted", config: PlaceVotesConfig) -> bool:
        """Whether this place does not count beside another."""
        few = config.rival_share * len(other.misfits)
        if len(self.misfits) <= few:
            return True
        common = self.misfits.keys() & other.misfits.keys()
        if len(other.misfits) < config.many or len(self.misfits) - len(common) > few:
            return False
        return sum(self.misfits[key] - other.misfits[key] for key in common) >= config.margin * len(common)


class PlaceVotes:
    """All places that fit the key scans since a while."""

    def __init__(self, config: LoopClosureConfig) -> None:
        self._config = config.votes
        self._tolerances = config.verification
        self._recent: list[Attempt] = []

    def add(self, attempt: Attempt) -> None:
        """Keep an attempt of the newest key scan, with the places where it fits, if any."""
        self._recent.append(attempt)

    def of(self, attempt: Attempt, poses: Floats) -> Vote:
        """What speaks for the place where an attempt puts the newest key scan.

        Args:
            attempt: one that matched, its places among those added.
            poses: (n, 3) estimates, good between neighbouring key poses.
        """
        places, claimed = self._voted(attempt.key_new, poses), closed_pose(attempt, poses)
        here = next((place for place in places if self._is_one_place(claimed, place)), None)
        if here is None:
            return Vote(first=attempt.key_new, last=attempt.key_new, count=1)
        rivals = [place for place in places if place is not here and not place.is_worse_than(here, self._config)]
        rival = max(rivals, key=lambda place: len(place.misfits), default=None)
        return Vote(
            first=min(here.misfits),
            last=max(here.misfits),
            count=len(here.misfits),
            rival=0 if rival is None else len(rival.misfits),
            apart=0.0 if rival is None else float(np.hypot(*(rival.T_map_key - here.T_map_key)[:2])),
            searched=len({a.key_new for a in self._recent if a.key_new >= min(here.misfits)}),
            misfit=sum(here.misfits.values()) / len(here.misfits),
        )

    def _voted(self, key: int, poses: Floats) -> Sequence[_Voted]:
        """The distinct places of the newest key scan, those it fits best first."""
        first = key - self._tolerances.partner_keys
        self._recent = [attempt for attempt in self._recent if attempt.key_new >= first]
        fits = [(attempt, place) for attempt in self._recent for place in attempt.places]
        old, new = np.array([attempt.pair for attempt, _ in fits], dtype=np.int64).reshape(-1, 2).T
        T_old_new = np.array([place.T_old_new for _, place in fits]).reshape(-1, 3)
        misfits = np.array([place.misfit for _, place in fits])
        T_map_new = compose(poses[old], T_old_new)
        T_map_key = compose(T_map_new, between(poses[new], poses[key]))
        found: list[_Voted] = []
        own = np.flatnonzero(new == key)
        for claimed in T_map_new[own[np.argsort(misfits[own], kind="stable")]]:
            if any(self._is_one_place(claimed, other) for other in found):
                continue
            same = np.flatnonzero(are_small(between(claimed, T_map_key), self._tolerances.partner))
            best: dict[int, float] = {}
            for voter, misfit in zip(new[same].tolist(), misfits[same].tolist(), strict=True):
                best[voter] = min(misfit, best.get(voter, misfit))
            found.append(_Voted(T_map_key=claimed, misfits=best))
        return found

    def _is_one_place(self, claimed: Floats, place: _Voted) -> bool:
        return agree(claimed, place.T_map_key, self._tolerances.place)


def unsettled(votes: Iterable[Vote], attempts: Iterable[Attempt]) -> tuple[Vote, ...]:
    """The votes whose key scans no closure ties to what was before them, after all."""
    accepted = [attempt for attempt in attempts if attempt.accepted]
    return tuple(vote for vote in votes if not any(attempt.spans(vote.first) for attempt in accepted))


def describe_vote(vote: Vote, track: Track) -> RunWarning:
    """A vote that is not clear, in a sentence for a person."""
    first, last = track.keys[vote.first].index, track.keys[vote.last].index
    sentence = (
        f"perceptual aliasing: from scan {first} to {last}, {vote.count} scans fit one place seen before and "
        f"{vote.rival} another, {vote.apart:.1f} m away, about as well; no loop is closed there, so that how what "
        "follows lies to what was before is known by the path alone"
    )
    return RunWarning(kind="perceptual aliasing", sentence=sentence, scan=first)

"""Places found again by their looks alone, where the path cannot say where they are.

Most of a trajectory is held together by loop closures that span it. Where none spans it (the robot was carried, nothing
matched for a while, or the loop is so long that the drift left the search behind) the parts before and after are
compared by the signatures of their places. What looks alike is matched metres and half turns wide; only a set of
closures that agree pairwise is a hypothesis, and every hypothesis must pass an examination that the present estimate
takes, too: placed as it says, do the scans agree with what else was seen there?
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graph.batch import BatchConfig, optimize
from graph.factors import Factor
from graph.se2 import compose, inverse
from iceg.slam.broken_path.alike_places import alike_places
from iceg.slam.broken_path.examination import Exam, Examiner
from iceg.slam.broken_path.path_break import ADRIFT, LOST, REFUTED, UNKNOWN_STEP, Break, Doubt, Outcome
from iceg.slam.broken_path.path_parts import PathParts
from iceg.slam.broken_path.place_hypothesis import Hypothesis, about_parts, about_single_steps, agreeing_sets
from iceg.slam.broken_path.place_votes import Vote
from iceg.slam.broken_path.untied_steps import UntiedSteps, closures_across
from iceg.slam.closures.attempt import Attempt, closure_factor, is_near, lies_near
from iceg.slam.closures.candidates import Candidate
from iceg.slam.config import LoopClosureConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.tracking.track import Track

_MOST_HYPOTHESES = 6
_MOST_PLACES = 3
"""Of a pair of places that look alike and fit several ways, so many are kept."""
_OTHER_PLACE = 2.0
"""Hypotheses that put the same scans so far apart are about different places [m]."""
_AS_STRONG = 0.5
"""Another is weighed that has this share of the key scans of a hypothesis."""
_EXPLAINED = 0.8
"""A step whose match explains this share of its scan is believed, if nothing else speaks against it: those who walk
past even doors, or rooms alike, find many key scans that agree about another place."""
_EXACT = np.array([0.1, 0.1, 0.03])
"""How well a place that a search found is known [m, m, rad]."""
_BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)


_Outcome = Literal["open", "closed", "joined", "contradicted"]
"""What became of a hypothesis: nothing yet, drift ended, two parts joined, or a path that it only contradicts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A graph, what is known of its closures, and where its path is broken.

    Attributes:
        factors: in force.
        poses: (k, 3) T_map_robot of the key poses.
        attempts: every loop closure tried.
        breaks: in the order of the path.
        alike: where several places explain what was seen about as well.
    """

    factors: list[Factor]
    poses: NDArray[np.float64]
    attempts: list[Attempt]
    breaks: tuple[Break, ...] = ()
    alike: tuple[Vote, ...] = ()


def relocalise(
    closer: LoopCloser,
    track: Track,
    estimate: Estimate,
    doubts: Mapping[int, Doubt],
    config: LoopClosureConfig,
) -> Estimate:
    """Join the parts of a path that no loop closure ties together, and say where it is broken.

    Args:
        closer: matches and verifies.
        track: key scans.
        estimate: the graph as the path and the closures on the way made it.
        doubts: by key pose, where the path may be broken.
        config: how much is tried, and how much must agree.

    Returns:
        The estimate with more closures and fewer wrong ones.
    """
    if not (config.enabled and config.relocalise):
        return estimate
    search = _Relocalisation(closer, track, estimate, doubts, config)
    search.run()
    return search.estimate()


class _Relocalisation:
    """State of the search: the estimate as it changes, what was tried, what was found out about the path."""

    def __init__(
        self,
        closer: LoopCloser,
        track: Track,
        estimate: Estimate,
        doubts: Mapping[int, Doubt],
        config: LoopClosureConfig,
    ) -> None:
        self._closer = closer
        self._track = track
        self._config = config
        self._factors, self._poses = estimate.factors, estimate.poses
        self._attempts = list(estimate.attempts)
        self._tried: list[Attempt] = []
        self._breaks: dict[int, Break] = {}
        self._alike: dict[int, Vote] = {}
        self._looks_again = False  # who compares places anew finds more that fit by chance
        self._ties: dict[int, int] = {}  # by key pose before which parts were joined, another that it is tied to
        self._path = [factor for factor in estimate.factors if factor.kind != "closure"]
        self._steps = UntiedSteps(track, estimate.factors, doubts, config)
        self._examiner = Examiner(closer, track)

    def run(self) -> None:
        """Try the hypotheses with the most support; what nothing ties after a loss is told apart."""
        if not self._steps.untied.any():
            return
        T_track_keys = np.array([key.T_track_robot for key in self._track.keys])
        self._join(self._agreeing(np.cumsum(self._steps.untied, dtype=np.int64), T_track_keys))
        self._looks_again = True
        while self._lost() and self._join(self._agreeing(self._parts().whole, self._poses)):
            pass  # as long as what was found tells more of where to look
        for key in self._lost():
            self._part(key, self._steps.doubts[key])

    def _lost(self) -> list[int]:
        """The key poses before which the robot was lost, and nothing says yet how they lie to what was before."""
        return [key for key, doubt in self._steps.doubts.items() if doubt.strength >= LOST]

    def _join(self, found: Sequence[Sequence[Attempt]]) -> bool:
        """Act on sets of closures that agree, and tell what is too little to act on; whether they join any parts."""
        sets = [self._settled(claims) for claims in found[:_MOST_HYPOTHESES]]
        has_joined = False
        while sets and self._join_one(sets):  # what is joined may decide what was left open
            has_joined = True
        for closures in sets:
            for hypothesis in self._hypotheses(closures):
                self._tell(hypothesis)
        return has_joined

    def _join_one(self, sets: list[list[Attempt]]) -> bool:
        """Try what the sets claim, up to the first that joins two parts; whether one did.

        Args:
            sets: of closures that agree; those that were acted on leave them.
        """
        self._alike.clear()
        for index in range(len(sets)):
            for hypothesis in self._hypotheses(sets[index]):
                if hypothesis.key in self._alike or not self._is_supported(hypothesis):
                    continue  # where stronger ones are in doubt none decides
                outcome = self._try(hypothesis, self._others(hypothesis, sets))
                if outcome != "open":
                    ends = {(closure.key_old, closure.key_new) for closure in hypothesis.closures}
                    sets[:] = [[c for c in closures if (c.key_old, c.key_new) not in ends] for closures in sets]
                if outcome == "joined":
                    return True
        return False

    def _parts(self) -> PathParts:
        """The parts of the path as far as they are known."""
        return PathParts(len(self._poses), self._lost(), self._ties)

    def _hypotheses(self, closures: Sequence[Attempt]) -> list[Hypothesis]:
        """What a set says about parts that a loss divides, and about single steps within what holds together."""
        parts = self._parts()
        inside = [c for c in closures if parts.whole[c.key_old] == parts.whole[c.key_new]]
        return [*about_parts(closures, parts), *about_single_steps(inside, self._steps)]

    def _others(self, hypothesis: Hypothesis, sets: Sequence[Sequence[Attempt]]) -> list[Hypothesis]:
        """What other sets say of the same parts: how others lie to them is another question."""
        whole = self._parts().whole

        def ends(closure: Attempt) -> tuple[int, int]:
            return int(whole[closure.key_old]), int(whole[closure.key_new])

        asked = ends(hypothesis.closures[0])
        alike = [[closure for closure in closures if ends(closure) == asked] for closures in sets]
        return [Hypothesis(key=hypothesis.key, closures=closures) for closures in alike if closures]

    def estimate(self) -> Estimate:
        """What was found, with a record of what looked alike in vain."""
        closed = {(attempt.key_old, attempt.key_new) for attempt in self._attempts if attempt.accepted}
        alone = [
            replace(
                attempt, accepted=False, reason=f"looks alike{', too few agree' * attempt.accepted}; {attempt.reason}"
            )
            for attempt in self._tried
            if (attempt.key_old, attempt.key_new) not in closed
        ]
        breaks = tuple(self._breaks[key] for key in sorted(self._breaks))
        attempts = [*self._attempts, *alone]
        alike = tuple(self._alike.values())  # closures that tie the path as it is settle nothing: both places beat it
        return Estimate(factors=self._factors, poses=self._poses, attempts=attempts, breaks=breaks, alike=alike)

    def _agreeing(self, parts: NDArray[np.int64], poses: NDArray[np.float64]) -> list[list[Attempt]]:
        """Sets of closures that agree, of places that look alike, the largest first; none if there are no new ones.

        Args:
            parts: (k,) which part each key pose belongs to; places of two are compared.
            poses: (k, 3) along which closures must agree.
        """
        known = {(attempt.key_old, attempt.key_new) for attempt in self._tried}
        config = replace(self._config, places=self._places_wanted())
        pairs = set(alike_places(self._track, self._closer.judge, parts, config)) - known
        if not pairs:
            return []
        self._tried += [self._closer.match_anywhere(old, new, self._poses) for old, new in sorted(pairs)]
        claims = [
            claim
            for attempt in self._tried
            if parts[attempt.key_old] != parts[attempt.key_new]
            for claim in _claims(attempt)
        ]
        return agreeing_sets(claims, self._path, poses, self._config.place_confirmations)

    def _places_wanted(self) -> int:
        """How many pairs of places are worth a match: where nothing gives a break away, one for each untied step."""
        most = self._config.places
        return most if self._steps.doubts else min(most, int(np.count_nonzero(self._steps.untied)))

    def _is_supported(self, hypothesis: Hypothesis) -> bool:
        """Whether enough key scans fit one place only, or where the robot was lost anyway, this one among others."""
        fewest, doubt = self._config.place_confirmations, self._steps.doubts.get(hypothesis.key)
        if self._sure_support(hypothesis) >= fewest:
            return True
        return doubt is not None and doubt.strength >= LOST and hypothesis.support >= fewest

    def _sure_support(self, hypothesis: Hypothesis) -> int:
        """How many key scans of a hypothesis fit one place only."""
        sure = {(attempt.key_old, attempt.key_new) for attempt in self._tried if attempt.accepted}
        alone = [c for c in hypothesis.closures if (c.key_old, c.key_new) in sure]
        return Hypothesis(key=hypothesis.key, closures=alone).support

    def _settled(self, claims: Sequence[Attempt]) -> list[Attempt]:
        """Claims that agree, each matched where it was made; an ambiguous one that confirms the path says nothing."""
        settled = []
        for claim in claims:
            if claim.accepted:
                settled.append(claim)
            if claim.accepted or is_near(claim, self._poses):
                continue
            assert claim.match is not None
            there = Candidate(
                key_old=claim.key_old, key_new=claim.key_new, T_old_new=claim.match.T_ref_cur, deviations=_EXACT
            )
            attempt = self._closer.match(there, self._poses)
            if attempt.accepted and lies_near(attempt, there.T_old_new):
                settled.append(attempt)
        return settled

    def _try(self, hypothesis: Hypothesis, others: Sequence[Hypothesis]) -> _Outcome:
        """Examine a hypothesis, and where they differ the present estimate and others; act on what holds."""
        exam = self._examiner.of_hypothesis(hypothesis, self._poses)
        closures = _distinct([*exam.agreeing, *hypothesis.closures])
        is_confirmed = self._is_confirmed(closures)
        if not exam.is_passed:
            return "open"
        whole, first = self._parts().whole, hypothesis.closures[0]
        among = whole == whole[first.key_old]
        if not (is_confirmed or exam.beats(self._examiner.of_estimate(hypothesis, self._poses, among))):
            return "open"
        if not is_confirmed and (rival := self._rival(hypothesis, exam, others)) is not None:
            self._alike[hypothesis.key] = rival
            return "open"
        key = hypothesis.key if among[first.key_new] else int(max(whole[first.key_old], whole[first.key_new]))
        untied = self._steps.untied if self._is_refuted(key) else None
        if is_confirmed or hypothesis.is_drift(self._path, self._poses, untied):
            if not is_confirmed and not hypothesis.is_chance(self._path, self._poses):
                self._note(key, "drifted", closures, hypothesis.correction(self._poses))
            self._steps.doubts.pop(key, None)
            self._close(closures)
            return "closed"
        return self._break(key, hypothesis, exam, closures)

    def _is_confirmed(self, closures: Sequence[Attempt]) -> bool:
        """Whether most of them say what the present estimate says."""
        return sum(is_near(closure, self._poses) for closure in closures) > 0.5 * len(closures)

    def _is_refuted(self, key: int) -> bool:
        """Whether odometry and match contradict each other before a key pose, or the robot was lost there."""
        doubt = self._steps.doubts.get(key)
        return doubt is not None and doubt.strength >= REFUTED

    def _tell(self, hypothesis: Hypothesis) -> None:
        """Say what is too little to act on, where odometry and match contradict each other and nothing else agrees."""
        key, doubt = hypothesis.key, self._steps.doubts.get(hypothesis.key)
        if doubt is None or not REFUTED <= doubt.strength < LOST or key in self._breaks or key in self._alike:
            return
        if self._sure_support(hypothesis) < self._config.confirmations:
            return
        exam = self._against_the_path(key, self._examiner.of_hypothesis(hypothesis, self._poses))
        closures = _distinct([*exam.agreeing, *hypothesis.closures])
        if not exam.is_credible or self._is_confirmed(closures):
            return
        if exam.beats(self._examiner.of_estimate(hypothesis, self._poses)):
            self._note(key, "contradicted", closures, hypothesis.correction(self._poses))

    def _against_the_path(self, key: int, exam: Exam) -> Exam:
        """An examination in which the closures that hold the path together before a key pose speak against it, too."""
        held = closures_across(self._factors, len(self._poses), self._config)[key]
        return replace(exam, against=exam.against + int(held))

    def _note(self, key: int, outcome: Outcome, closures: Sequence[Attempt], correction: NDArray[np.float64]) -> None:
        """Record a break, and by how much closures that agree move what follows."""
        moved = (compose(correction, self._poses[key]) - self._poses[key])[:2]
        self._breaks[key] = Break(
            key=key,
            outcome=outcome,
            reason=self._steps.doubt(key).reason,
            closures=len({closure.key_new for closure in closures}),
            moved=float(np.hypot(*moved)),
        )

    def _rival(self, hypothesis: Hypothesis, exam: Exam, others: Sequence[Hypothesis]) -> Vote | None:
        """What speaks for another place of the same scans, if a hypothesis does not clearly beat it."""
        for other in others:
            apart = hypothesis.apart_from(other, self._poses)
            if apart < _OTHER_PLACE or other.support < _AS_STRONG * hypothesis.support:
                continue
            there = self._examiner.of_hypothesis(other, self._poses)
            if there.is_passed and not exam.beats(there):
                ends = [closure.key_new for closure in hypothesis.closures]
                return Vote(
                    first=min(ends),
                    last=max(ends),
                    count=len(exam.agreeing),
                    rival=len(there.agreeing),
                    apart=apart,
                )
        return None

    def _break(self, key: int, hypothesis: Hypothesis, exam: Exam, closures: list[Attempt]) -> _Outcome:
        """Record a break; the parts are joined only where something else spoke against the path, too.

        Where odometry led the way into a loss nothing did: farther off than its errors explain, only what looks alike
        puts the robot elsewhere.

        It needs to be sure where nothing did, where places are compared anew, and where a short stretch is all there
        is to compare: the three metres before a loss fit many places along a corridor of even doors.
        """
        doubt = self._steps.doubts.get(key)
        is_known = doubt is not None and not doubt.is_led
        if not is_known:
            if self._steps.doubt(key).strength <= 1.0 - _EXPLAINED:
                return "open"
            exam = self._against_the_path(key, exam)
        is_broad = hypothesis.breadth >= self._config.place_confirmations
        if not (exam.is_sure or (is_known and is_broad and not self._looks_again)):
            return "open"
        correction = hypothesis.correction(self._poses)
        moving = self._moving(key, hypothesis)
        if not moving[min(closure.key_new for closure in hypothesis.closures)]:
            correction = inverse(correction)
        self._note(key, "joined" if is_known else "contradicted", closures, correction)
        self._steps.doubts.pop(key, None)
        self._steps.untied[key] = False
        if not is_known:
            return "contradicted"
        first = hypothesis.closures[0]
        self._ties[key] = first.key_old if moving[first.key_new] else first.key_new
        self._move(key, closures, correction, moving)
        return "joined"

    def _moving(self, key: int, hypothesis: Hypothesis) -> NDArray[np.bool_]:
        """(k,) which key poses a hypothesis moves: the part that begins at `key`, and what holds together with it."""
        parts, first = self._parts(), hypothesis.closures[0]
        moving = parts.whole == key
        if parts.whole[first.key_old] == parts.whole[first.key_new]:
            moving = np.zeros(len(self._poses), dtype=np.bool_)
            moving[key : parts.end_of(key)] = True
            for start, other in sorted(self._ties.items()):
                if moving[other] and not moving[start]:
                    moving[start : parts.end_of(start)] = True
        return parts.moving_with(moving)

    def _move(
        self, key: int, closures: list[Attempt], correction: NDArray[np.float64], moving: NDArray[np.bool_]
    ) -> None:
        """Let the step to `key` go, move what follows to where the closures put it, and take out what contradicts."""
        self._poses = self._poses.copy()
        self._poses[moving] = compose(correction, self._poses[moving])
        self._factors = [
            replace(factor, covariance=UNKNOWN_STEP) if _spans(factor, key) and factor.kind != "closure" else factor
            for factor in self._factors
        ]
        torn = [
            attempt
            for attempt in self._attempts
            if moving[attempt.key_old] != moving[attempt.key_new]
            and attempt.accepted
            and not is_near(attempt, self._poses)
        ]
        self._take_out(torn, f"contradicted by {len(closures)} closures that agree")
        self._close(closures)

    def _close(self, closures: list[Attempt]) -> None:
        """Let closures into the graph and solve it."""
        self._attempts += [
            replace(c, reason=f"by its looks, with {len(closures) - 1} others; {c.reason}") for c in closures
        ]
        self._factors = [*self._factors, *(closure_factor(closure) for closure in closures)]
        self._poses = optimize(self._factors, self._poses, _BATCH).poses
        self._steps.tie(self._factors)

    def _part(self, key: int, doubt: Doubt) -> None:
        """What follows a break hangs on odometry alone, unless the closures across it stand an examination.

        Where odometry told the way it is one witness more: a robot that was carried does not happen to come where
        several closures agree with the odometry that knows nothing of it.
        """
        end = min((other for other in self._breaks if other > key), default=len(self._poses))
        across = [a for a in self._attempts if a.accepted and a.key_old < key <= a.key_new < end]
        claimed, agreeing = Hypothesis(key=key, closures=across), 0
        if claimed.support >= self._config.confirmations:
            exam = self._examiner.of_estimate(claimed, self._poses)
            if exam.is_passed:
                return
            if doubt.strength < ADRIFT:
                agreeing = len(exam.agreeing)
                if exam.is_credible:
                    self._breaks[key] = Break(key=key, outcome="credible", reason=doubt.reason, closures=agreeing)
                    return
        self._breaks[key] = Break(key=key, outcome="apart", reason=doubt.reason, closures=agreeing)
        if across:
            self._take_out(across, "too few agree across a break of the path")
            self._poses = optimize(self._factors, self._poses, _BATCH).poses

    def _take_out(self, closures: Sequence[Attempt], why: str) -> None:
        """Remove closures that were accepted."""
        gone = {(closure.key_old, closure.key_new) for closure in closures}
        for index, attempt in enumerate(self._attempts):
            if attempt.accepted and (attempt.key_old, attempt.key_new) in gone:
                self._attempts[index] = replace(
                    attempt, accepted=False, removed=True, reason=f"{why}; {attempt.reason}"
                )
        self._factors = [f for f in self._factors if f.kind != "closure" or (f.i, f.j) not in gone]


def _claims(attempt: Attempt) -> list[Attempt]:
    """An attempt itself, or where it fitted several places one for each of the best."""
    if attempt.accepted:
        return [attempt]
    if not attempt.is_ambiguous or attempt.match is None:
        return []
    places = [place.T_old_new for place in attempt.places[:_MOST_PLACES]]
    return [replace(attempt, match=replace(attempt.match, T_ref_cur=T_old_new)) for T_old_new in places]


def _distinct(closures: Sequence[Attempt]) -> list[Attempt]:
    """One for each pair of key poses, the first."""
    return list({(c.key_old, c.key_new): c for c in reversed(closures)}.values())[::-1]


def _spans(factor: Factor, key: int) -> bool:
    return factor.i is not None and min(factor.i, factor.j) < key <= max(factor.i, factor.j)

"""Relocalisation: places recognised again where the path cannot say where they are (kidnapped robot).

Most of a trajectory is held together by loop closures that span it. Where the robot was lost, or may have been carried,
the map of what follows is laid onto what was before. Where nothing spans the path otherwise (the loop is so long that
the drift left the search behind) the parts before and after are compared by the signatures of their places. Similar
places are matched metres and half turns wide; only a set of closures that agree pairwise is a hypothesis, and every
hypothesis must pass a geometric verification that the present estimate must pass, too: placed as it says, do the scans
agree with what else was seen there?
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from graph.arrays import Bools, Floats, Ints
from graph.se2 import compose, inverse
from iceg.slam.broken_path.bridge_edges import BridgeEdges
from iceg.slam.broken_path.hypothesis_verification import FitCount, HypothesisVerifier
from iceg.slam.broken_path.map_search import MapSearch, Way, best_way
from iceg.slam.broken_path.path_break import Break, Outcome, TrackingFailure, probability
from iceg.slam.broken_path.path_parts import PathParts
from iceg.slam.broken_path.place_hypothesis import Hypothesis, about_parts, about_single_steps
from iceg.slam.broken_path.place_search import PlaceSearch
from iceg.slam.broken_path.place_votes import Vote, unsettled
from iceg.slam.closures.attempt import Attempt
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution


class _Decision(Enum):
    """What became of a hypothesis."""

    OPEN = auto()
    """Nothing yet."""
    SETTLED = auto()
    """It ended a drift, or contradicts the path, which stays as it is."""
    JOINED = auto()
    """It joined two parts of the path."""


def relocalise(closer: LoopCloser, solution: Solution, failures: Mapping[int, TrackingFailure]) -> Solution:
    """Join the parts of a path that no loop closure ties together, and say where it is broken.

    Args:
        closer: matches and verifies key scans; its settings say how much is tried, and how much must agree.
        solution: the graph as the path and the closures on the way made it.
        failures: by key pose, where the path may be broken.

    Returns:
        The solution with more closures and fewer wrong ones.
    """
    if not (closer.config.enabled and closer.config.relocalise):
        return solution
    search = _Relocalisation(closer, solution, failures)
    search.run()
    return search.solution()


class _Relocalisation:
    """State of the search: the estimate as it changes, what was tried, what was found out about the path."""

    def __init__(self, closer: LoopCloser, solution: Solution, failures: Mapping[int, TrackingFailure]) -> None:
        self._track = closer.track
        self._config = closer.config
        self._now = solution
        self._steps = BridgeEdges(closer.track, solution.factors, failures, closer.config)
        self._places = PlaceSearch(closer, solution.factors)
        self._verifier = HypothesisVerifier(closer)
        self._maps = MapSearch(closer.track, self._verifier, closer.config)
        self._breaks: dict[int, Break] = {}
        self._ambiguous: dict[int, Vote] = {}
        self._searches = closer.config.relocalisation.maps.most_searches
        self._ties: dict[int, int] = {}  # by key pose before which parts were joined, another that it is tied to

    def run(self) -> None:
        """Try the hypotheses with the most support; what nothing ties after a loss is told apart."""
        if not self._steps.is_bridge.any():
            return
        while self._lay():
            pass  # what is joined shows more to what is left
        self._join(self._agreeing(np.cumsum(self._steps.is_bridge, dtype=np.int64), self._track.T_track_keys))
        for key in self._lost():
            self._part(key)

    def solution(self) -> Solution:
        """What was found, with a record of the similar places tried in vain."""
        attempts = self._now.attempts
        closed = {attempt.pair for attempt in attempts if attempt.accepted}
        return replace(
            self._now,
            attempts=[*attempts, *self._places.in_vain(closed)],
            breaks=tuple(self._breaks[key] for key in sorted(self._breaks)),
            # closures that tie the path as it is settle nothing: both beat it
            ambiguous=(*unsettled(self._now.ambiguous, attempts), *self._ambiguous.values()),
        )

    # Where maps of parts fit on each other.

    def _lay(self) -> bool:
        """Join what follows the failure where its map fits those of other parts best, if any does; whether one did."""
        suspected = self._suspected()[: self._searches]
        self._searches -= len(suspected)
        found = [each for key in suspected if (each := self._best_way(key)) is not None]
        if not found:
            return False
        key, way, odds = max(found, key=lambda each: each[2])
        moving = self._parts().moved_by(way.closures[0], key)
        self._move(key, way.closures, way.correction, moving, probability(-odds))
        return True

    def _suspected(self) -> list[int]:
        """The key poses before which the robot was lost, or may have been carried or gone astray, the most probable."""
        config = self._config.relocalisation.maps
        carried = {
            key: 1.0 if failure.is_lost else failure.probability_carried
            for key, failure in self._steps.failures.items()
            if key > 0 and (failure.is_lost or failure.probability_carried >= config.suspected)
        }
        for key in self._steps.weakest(besides=carried):
            if self._maps.contradict(key, self._now.poses):
                carried[key] = config.suspected
        return sorted(carried, key=lambda key: -carried[key])[: config.most_failures]

    def _best_way(self, key: int) -> tuple[int, Way, float] | None:
        """How what follows a failure lies to what was before, other than as the path has it, and the log-odds of it."""
        failure, whole = self._steps.failure(key), self._parts().whole
        if not failure.is_lost:
            whole = np.where((whole == whole[key]) & (np.arange(len(whole)) >= key), key, whole)
        ways = self._maps.ways(key, whole, self._now.poses)
        prior, elsewhere = failure.log_prior_of_path(self._config.view), self._config.relocalisation.maps.elsewhere
        best = best_way(ways, prior, elsewhere)
        return None if best is None else (key, *best)

    # What similar places say, and in which order it is tried.

    def _agreeing(self, parts: Ints, along: Floats) -> list[list[Attempt]]:
        """Sets of closures that agree along a path; where nothing gives a break away, a pair for each bridge edge."""
        most = self._config.places
        if not self._steps.failures:
            most = min(most, int(np.count_nonzero(self._steps.is_bridge)))
        return self._places.agreeing(parts, self._now.poses, along, most)

    def _join(self, found: Sequence[Sequence[Attempt]]) -> bool:
        """Act on sets of closures that agree; whether they join any parts."""
        sets = [
            self._places.settled(claims, self._now.poses)
            for claims in found[: self._config.relocalisation.max_hypotheses]
        ]
        has_joined = False
        while sets and self._join_one(sets):  # what is joined may decide what was left open
            has_joined = True
        return has_joined

    def _join_one(self, sets: list[list[Attempt]]) -> bool:
        """Try what the sets claim, up to the first that joins two parts; whether one did.

        Args:
            sets: of closures that agree; those that were acted on leave them.
        """
        self._ambiguous.clear()
        gone: set[tuple[int, int]] = set()
        for claimed in self._hypotheses(sets):
            hypothesis = claimed.without(gone)
            if hypothesis.key in self._ambiguous or not self._is_supported(hypothesis):
                continue  # where stronger ones are ambiguous none decides
            decision = self._try(hypothesis, sets)
            if decision is not _Decision.OPEN:
                gone |= {closure.pair for closure in hypothesis.closures}
                sets[:] = [[closure for closure in closures if closure.pair not in gone] for closures in sets]
            if decision is _Decision.JOINED:
                return True
        return False

    def _hypotheses(self, sets: Sequence[Sequence[Attempt]]) -> list[Hypothesis]:
        """What each set says about parts that a loss divides, and about single steps within what holds together."""
        parts, found = self._parts(), []
        for closures in sets:
            inside = [closure for closure in closures if parts.is_within(closure)]
            found += [*about_parts(closures, parts), *about_single_steps(inside, self._steps)]
        return found

    def _is_supported(self, hypothesis: Hypothesis) -> bool:
        """Whether enough key scans fit one place only, or where the robot was lost anyway, this one among others."""
        fewest = self._config.place_confirmations
        return self._places.sure_support(hypothesis) >= fewest or (
            hypothesis.key in self._lost() and hypothesis.support >= fewest
        )

    # What is believed.

    def _try(self, hypothesis: Hypothesis, sets: Sequence[Sequence[Attempt]]) -> _Decision:
        """Verify a hypothesis, and where they differ the present estimate and other sets; act on what holds."""
        poses = self._now.poses
        path, config = self._places.path, self._config.relocalisation
        is_chance = hypothesis.is_chance(path, poses, config)
        fit = self._verifier.of_hypothesis(hypothesis, poses)
        closures = _distinct([*fit.agreeing, *hypothesis.closures])
        is_confirmed = self._is_confirmed(closures)
        if not fit.is_passed:
            return _Decision.OPEN
        whole, first = self._parts().whole, hypothesis.closures[0]
        among = whole == whole[first.key_old]
        estimate = self._verifier.of_estimate(hypothesis, poses, among)
        if not (is_confirmed or fit.beats(estimate, self._log_prior_of_path(hypothesis, is_chance=is_chance))):
            return _Decision.OPEN
        if not is_confirmed and (rival := self._rival(hypothesis, fit, sets)) is not None:
            self._ambiguous[hypothesis.key] = rival
            return _Decision.OPEN
        key = hypothesis.key if among[first.key_new] else int(max(whole[first.key_old], whole[first.key_new]))
        is_bridge = self._steps.is_bridge if key in self._steps.refuted() else None
        is_carried = (failure := self._steps.failures.get(key)) is not None and failure.is_carried
        if not is_carried and (is_confirmed or hypothesis.is_drift(path, poses, config, is_bridge)):
            if not is_confirmed and not is_chance:
                self._note(key, Outcome.DRIFTED, closures, hypothesis.correction(poses))
            self._steps.failures.pop(key, None)
            self._now = self._now.closed(closures)
            self._steps.update(self._now.factors)
            return _Decision.SETTLED
        return self._break(key, hypothesis, fit, closures)

    def _is_confirmed(self, closures: Sequence[Attempt]) -> bool:
        """Whether most of them say what the present estimate says."""
        near = self._config.verification.near
        return sum(closure.is_near(self._now.poses, near) for closure in closures) > 0.5 * len(closures)

    def _log_prior_of_path(self, hypothesis: Hypothesis, *, is_chance: bool) -> float:
        """How many times as probable as a hypothesis the path is before scans verify either, the logarithm.

        What errors of the path explain takes no robot that was carried, and so no prior against one.
        """
        failure = self._steps.failures.get(hypothesis.key)
        log_odds = 0.0 if failure is None else failure.log_odds_of_path(self._config.view)
        return min(log_odds, 0.0) if is_chance else log_odds

    def _lost(self) -> list[int]:
        """The key poses before which the robot was lost, and nothing says yet how they lie to what was before."""
        return [key for key, failure in self._steps.failures.items() if failure.is_lost]

    def _rival(self, hypothesis: Hypothesis, fit: FitCount, sets: Sequence[Sequence[Attempt]]) -> Vote | None:
        """What speaks for another place of the same scans, if a hypothesis does not clearly beat it.

        How other parts of the path lie to each other is another question.
        """
        poses, config, parts = self._now.poses, self._config.relocalisation, self._parts()
        asked = parts.of(hypothesis.closures[0])
        for closures in sets:
            other = Hypothesis(key=hypothesis.key, closures=[c for c in closures if parts.of(c) == asked])
            if not other.closures:
                continue
            apart = hypothesis.distance_from(other, poses)
            if apart < config.rival_distance or other.support < config.rival_support * hypothesis.support:
                continue
            there = self._verifier.of_hypothesis(other, poses)
            if there.is_passed and not fit.beats(there):
                ends = [closure.key_new for closure in hypothesis.closures]
                count, rival = len(fit.agreeing), len(there.agreeing)
                return Vote(first=min(ends), last=max(ends), count=count, rival=rival, apart=apart)
        return None

    # What becomes of a break.

    def _break(self, key: int, hypothesis: Hypothesis, fit: FitCount, closures: list[Attempt]) -> _Decision:
        """Record a break; the parts are joined only where something else spoke against the path, too.

        Where what the laser sees changed no more than usual nothing did: only perceptual aliasing puts a robot
        elsewhere that was not carried.

        It needs to be sure where nothing did.
        """
        failure = self._steps.failures.get(key)
        is_known = failure is not None and failure.may_be_carried(fit.log_odds)
        if not is_known:
            if self._steps.failure(key).rank <= 1.0 - self._config.failures.believed_inlier_ratio:
                return _Decision.OPEN
            # the closures that span the step speak against it, too
            fit = replace(fit, against=fit.against + int(self._steps.closures_across(self._now.factors)[key]))
        if not (is_known or fit.is_sure):
            return _Decision.OPEN
        first, correction = hypothesis.closures[0], hypothesis.correction(self._now.poses)
        moving = self._parts().moved_by(first, key)
        if not moving[min(closure.key_new for closure in hypothesis.closures)]:
            correction = inverse(correction)
        if not is_known:
            elsewhere = self._steps.failure(key).log_odds(self._config.view) + max(fit.log_odds, 0.0)
            self._note(key, Outcome.CONTRADICTED, closures, correction, probability(elsewhere))
            self._steps.failures.pop(key, None)
            self._steps.is_bridge[key] = False
            return _Decision.SETTLED
        self._move(key, closures, correction, moving, probability(-fit.log_odds))
        return _Decision.JOINED

    def _move(self, key: int, closures: Sequence[Attempt], correction: Floats, moving: Bools, displaced: float) -> None:
        """Join what follows a break to what was before, in a way that is wrong with some probability."""
        self._note(key, Outcome.JOINED, closures, correction, displaced)
        self._steps.failures.pop(key, None)
        self._steps.is_bridge[key] = False
        first = closures[0]
        self._ties[key] = first.key_old if moving[first.key_new] else first.key_new
        self._now = self._now.moved(key, closures, correction, moving, self._config.verification.near)
        self._steps.update(self._now.factors)

    def _note(
        self, key: int, outcome: Outcome, closures: Sequence[Attempt], correction: Floats, displaced: float = 0.0
    ) -> None:
        """Record a break, how far closures that agree move what follows, and how probably it is displaced then."""
        pose, failure = self._now.poses[key], self._steps.failure(key)
        self._breaks[key] = Break(
            key=key,
            outcome=outcome,
            reason=failure.reason,
            closures=len({closure.key_new for closure in closures}),
            moved=float(np.hypot(*(compose(correction, pose) - pose)[:2])),
            scan=failure.scan,
            probability=displaced if displaced >= self._config.failures.doubt else 0.0,
        )

    def _parts(self) -> PathParts:
        """The parts of the path as far as they are known."""
        return PathParts(len(self._now.poses), self._lost(), self._ties)

    def _part(self, key: int) -> None:
        """Nothing sure ties what follows a break to what was before, unless the closures across pass verification."""
        failure = self._steps.failures[key]
        end = min((other for other in self._breaks if other > key), default=len(self._now.poses))
        across = [a for a in self._now.attempts if a.accepted and a.spans(key) and a.key_new < end]
        claimed = Hypothesis(key=key, closures=across)
        if failure.scan is None and claimed.support >= self._config.confirmations:
            fit = replace(self._verifier.of_estimate(claimed, self._now.poses), support=claimed.support)
            if fit.is_passed:
                return
        found = Break(key=key, outcome=Outcome.APART, reason=failure.reason, across=len(across), scan=failure.scan)
        self._breaks[key] = found
        if found.is_sudden and across:
            self._now = self._now.without(across, "too few agree to tie what a sudden loss has torn apart")


def _distinct(closures: Sequence[Attempt]) -> list[Attempt]:
    """One for each pair of key poses, the first."""
    return list({closure.pair: closure for closure in reversed(closures)}.values())[::-1]

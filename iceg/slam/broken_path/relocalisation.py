"""Relocalisation: parts of a path put where their maps belong, when the path cannot say where (kidnapped robot).

Most of a trajectory is held together by loop closures that span it. Where the robot was lost, or may have been carried,
the map of what follows is laid onto what was before. Where nothing spans the path and maps contradict each other as it
has them, it drifted, or was broken unnoticed, and the maps are asked, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from graph.arrays import Ints
from graph.se2 import compose
from iceg.slam.agreement import agree
from iceg.slam.broken_path.bridge_edges import BridgeEdges
from iceg.slam.broken_path.geometric_verification import GeometricVerifier
from iceg.slam.broken_path.map_merging import Alignment, Belief, MapMerger, log_sum, weighed
from iceg.slam.broken_path.path_break import Break, FailureKind, Outcome, TrackingFailure, probability
from iceg.slam.broken_path.path_drift import PathDrift
from iceg.slam.broken_path.path_parts import PathParts
from iceg.slam.broken_path.place_votes import unsettled
from iceg.slam.closures.attempt import Attempt
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution

Failures = Mapping[int, TrackingFailure]


def relocalise(closer: LoopCloser, solution: Solution, failures: Failures) -> tuple[Solution, Failures]:
    """Join the parts of a path that no loop closure ties together, and say where it is broken.

    Args:
        closer: matches and verifies key scans; its settings say how much is tried, and how much must agree.
        solution: the graph as the path and the closures on the way made it.
        failures: by key pose, where the path may be broken.

    Returns:
        The solution with more closures and fewer wrong ones, and the failures as probable as they are now.
    """
    if not (closer.config.enabled and closer.config.relocalise):
        return solution, failures
    search = _Relocalisation(closer, solution, failures)
    search.run()
    return search.solution(), search.failures()


class _Relocalisation:
    """State of the search: the estimate as it changes, and what was found out about the path."""

    def __init__(self, closer: LoopCloser, solution: Solution, failures: Failures) -> None:
        self._track = closer.track
        self._config = closer.config
        self._now = solution
        self._before = failures
        self._steps = BridgeEdges(closer.track, solution.factors, failures, closer.config)
        self._maps = MapMerger(closer.track, GeometricVerifier(closer), closer.config)
        self._beliefs: dict[int, Belief] = {}
        self._asked: set[int] = set()  # by key pose, later pieces of lost parts that were laid onto others
        self._breaks: dict[int, Break] = {}
        self._searches = closer.config.relocalisation.maps.most_searches
        self._ties: dict[int, int] = {}  # by key pose before which parts were joined, another that it is tied to

    def run(self) -> None:
        """Join what can be joined; what nothing ties after a loss is told apart."""
        while self._join_surest(self._suspected()) or self._join_later():
            pass  # what is joined shows more to what is left
        for key, fixed in self._unspanned():
            if self._steps.is_bridge[key] and self._maps.contradict(key, fixed, self._now.poses):
                self._mend(key, fixed)
        for key in self._lost():
            self._part(key)

    def solution(self) -> Solution:
        """What was found."""
        return replace(
            self._now,
            breaks=tuple(self._breaks[key] for key in sorted(self._breaks)),
            ambiguous=unsettled(self._now.ambiguous, self._now.attempts),
        )

    def failures(self) -> Failures:
        """The failures, that the robot was carried as probable as maps leave it."""
        return {
            key: replace(failure, log_odds_carried=-self._beliefs[key].log_odds_path)
            if key in self._beliefs and failure.log_odds_carried is not None
            else failure
            for key, failure in self._before.items()
        }

    # Where tracking failed.

    def _suspected(self) -> list[int]:
        """The key poses before which the robot was lost, or may have been carried, the most probable first."""
        config = self._config.relocalisation.maps
        carried = {
            key: 1.0 if failure.is_lost else failure.probability_carried
            for key, failure in self._steps.failures.items()
            if key > 0 and (failure.is_lost or failure.probability_carried >= config.suspected)
        }
        return sorted(carried, key=lambda key: -carried[key])[: config.most_failures]

    def _join_surest(self, keys: Sequence[int]) -> bool:
        """Join what follows the failure where its map fits those of other parts best, if any does; whether one did.

        Later failures that move along, after which it fits the same way, are explained by that.
        """
        found = {key: alignment for key in keys if (alignment := self._aligned(key, np.arange(key))) is not None}
        if not found:
            return False
        surest = max(found, key=lambda key: self._beliefs[key].log_odds)
        pose, one_way = self._now.poses[surest], self._config.relocalisation.maps.one_way
        there = compose(found[surest].correction, pose)
        odds, broken = self._beliefs[surest].log_odds, self._broken_at(surest, found[surest])
        self._join(broken, found[surest], probability(-odds))
        for key, each in found.items():
            explains = key > broken and agree(compose(each.correction, pose), there, one_way)
            if explains and not self._steps.failure(key).is_lost:
                self._beliefs[key] = Belief(None, 0.0, odds)
                self._settle(key)
        return True

    def _join_later(self) -> bool:
        """Join what follows a failure where a later piece of its map fits: it may lead through new ground first."""
        every = self._config.relocalisation.maps.path
        for key in self._suspected():
            if key in self._beliefs and self._beliefs[key].path is not None:
                continue
            path = self._track.path[: self._parts().end_of(key)]
            later = np.searchsorted(path, np.arange(path[key] + every, path[-1], every)).tolist()
            for piece in (piece for piece in later if piece not in self._asked):
                self._asked.add(piece)
                alignment = self._aligned(piece, np.arange(key), key)
                if alignment is not None:
                    self._join(self._broken_at(key, alignment), alignment, probability(-self._beliefs[key].log_odds))
                    return True
        return False

    def _aligned(self, key: int, fixed: Ints, since: int | None = None) -> Alignment | None:
        """How what follows a key pose lies to (n,) before it, other than as the path has it; None where that is right.

        What maps make of the path, if they tell anything, is remembered.

        Args:
            key: the first key pose of what is laid onto the others.
            fixed: the others.
            since: the key pose before which the path may be broken, if not that.
        """
        if not self._searches:
            return None
        self._searches -= 1
        broken = key if since is None else since
        failure, whole = self._steps.failure(broken), self._parts().whole
        if not failure.is_lost:
            whole = np.where((whole == whole[key]) & (np.arange(len(whole)) >= key), key, whole)
        alignments = self._maps.alignments(key, whole, fixed, self._now.poses)
        belief, known = self._weighed(alignments, failure, fixed, key), self._beliefs.get(broken)
        if known is None or (alignments and (since is None or belief.log_odds > known.log_odds)):
            self._beliefs[broken] = belief
        return belief.elsewhere

    def _broken_at(self, key: int, alignment: Alignment) -> int:
        """The key pose before which the path is broken if an alignment of what follows one is right.

        That is a bridge of its part, after what closures say it fits, and before the first scan that agrees: where
        tracking failed, if it did, else where a match explains least.
        """
        if self._steps.failure(key).is_lost:
            return key
        start = max(start for start in self._parts().starts if start <= key)
        first = max(start, max(closure.key_old for closure in alignment.closures) + 1)
        last = max(key, min(closure.key_new for closure in alignment.closures))
        path, every = self._track.path, self._config.relocalisation.maps.path
        odds = {
            step: failure.log_odds(self._config.view)
            for step, failure in sorted(self._steps.failures.items())
            if first <= step <= last and path[step] > path[key] - every
        }
        if not odds:
            return self._steps.weakest(first, key)
        steps = np.array(list(odds))
        return self._maps.change_point(steps, np.array(list(odds.values())), alignment.correction, self._now.poses)

    def _weighed(self, alignments: Sequence[Alignment], failure: TrackingFailure, fixed: Ints, key: int) -> Belief:
        """What to believe of alignments of what follows a key pose onto (n,) before it, and before a failure.

        One may be right since the robot was carried, or since the path drifted so far; and so may be that what follows
        is new ground.
        """
        nothing = self._config.relocalisation.maps.elsewhere
        prior = failure.log_prior_of_path(self._config.view)
        if failure.kind is FailureKind.UNKNOWN_MOTION or not len(fixed):
            return weighed(alignments, prior + nothing, nothing)
        drift = self._drift()
        either_way = [a if a.is_path else a.also(prior + drift.log_ratio(a.closures)) for a in alignments]
        unseen = log_sum([0.0, prior - drift.log_precision(int(fixed[len(fixed) // 2]), key)])
        return weighed(either_way, prior + nothing, unseen + nothing)

    def _drift(self) -> PathDrift:
        path = [factor for factor in self._now.factors if factor.kind in {"odometry", "ice"}]
        return PathDrift(path, self._now.poses, self._config.drift_factor)

    # Where nothing spans the path.

    def _unspanned(self) -> list[tuple[int, Ints]]:
        """Key poses along chains of bridges, each with (n,) before it to be compared with.

        Before the weakest step of each chain anything may be wrong; along the rest the path drifts, and what lies
        just before tells nothing of that.
        """
        path, every = self._track.path, self._config.relocalisation.maps.path
        found = []
        for weakest, chain in self._steps.chains(besides=self._suspected()):
            found.append((weakest, np.arange(weakest)))
            pieces = np.rint((path[chain] - path[weakest]) / every).astype(np.int64)
            for piece in np.unique(pieces[pieces != 0]).tolist():
                near = np.abs(path[chain] - path[weakest] - piece * every)
                key = int(chain[near.argmin()])
                found.append((key, np.flatnonzero(path < path[key] - every)))
        return sorted(found, key=lambda each: each[0])

    def _mend(self, key: int, fixed: Ints) -> None:
        """Put what follows a key pose where its map fits: the path drifted, or is broken."""
        alignment = self._aligned(key, fixed)
        if alignment is None:
            self._doubt(key, self._steps.weakest(int(fixed[-1]) + 1, key))
            return
        broken = self._broken_at(key, alignment)
        displaced = probability(-self._beliefs[key].log_odds)
        prior = self._steps.failure(broken).log_prior_of_path(self._config.view)
        if prior + self._drift().log_ratio(alignment.closures) > 0.0:
            self._note(broken, Outcome.DRIFTED, alignment, displaced)
            self._close(alignment.closures)
        else:
            self._join(broken, alignment, displaced)

    def _doubt(self, key: int, broken: int) -> None:
        """Tell how probably the path is wrong where its maps contradict each other and none belongs elsewhere."""
        if key not in self._beliefs:
            return
        wrong = probability(-self._beliefs[key].log_odds_path)
        if wrong >= self._config.failures.doubt:
            reason = self._steps.failure(broken).reason
            self._breaks[broken] = Break(key=broken, outcome=Outcome.DOUBTFUL, reason=reason, probability=wrong)

    # What becomes of the path.

    def _join(self, key: int, alignment: Alignment, displaced: float) -> None:
        """Join what follows a break to what was before, in a way that is wrong with some probability."""
        self._note(key, Outcome.JOINED, alignment, displaced)
        first = alignment.closures[0]
        moving = self._parts().moved_by(first, key)
        self._ties[key] = first.key_old if moving[first.key_new] else first.key_new
        near = self._config.verification.near
        self._now = self._now.moved(key, alignment.closures, alignment.correction, moving, near)
        self._settle(key)

    def _close(self, closures: Sequence[Attempt], key: int | None = None) -> None:
        """Tie the path as it is, before a failure if there was one."""
        self._now = self._now.closed(closures)
        self._settle(key)

    def _settle(self, key: int | None) -> None:
        """Nothing speaks against a step any more, and closures have come in."""
        if key is not None:
            self._steps.failures.pop(key, None)
            self._steps.is_bridge[key] = False
        self._steps.update(self._now.factors)

    def _note(self, key: int, outcome: Outcome, alignment: Alignment, displaced: float) -> None:
        """Record a break, how far what follows moves, and how probably it is displaced then."""
        pose, failure = self._now.poses[key], self._steps.failure(key)
        self._breaks[key] = Break(
            key=key,
            outcome=outcome,
            reason=failure.reason,
            closures=len({closure.key_new for closure in alignment.closures}),
            moved=float(np.hypot(*(compose(alignment.correction, pose) - pose)[:2])),
            scan=failure.scan,
            probability=displaced if displaced >= self._config.failures.doubt else 0.0,
        )

    def _lost(self) -> list[int]:
        """The key poses before which the robot was lost, and nothing says yet how they lie to what was before."""
        return [key for key, failure in self._steps.failures.items() if failure.is_lost]

    def _parts(self) -> PathParts:
        """The parts of the path as far as they are known."""
        return PathParts(len(self._now.poses), self._lost(), self._ties)

    def _part(self, key: int) -> None:
        """Nothing ties what follows a loss to what was before, unless maps, or the closures across, confirm the path.

        Where maps tell nothing of it, nor that the view changed at once, closures that agree are enough.
        """
        belief, failure = self._beliefs.get(key), self._steps.failures[key]
        confirmed = None if belief is None else belief.path
        if confirmed is not None:
            self._close(confirmed.closures, key)
            return
        end = min((other for other in self._breaks if other > key), default=len(self._now.poses))
        across = [a for a in self._now.attempts if a.accepted and a.spans(key) and a.key_new < end]
        is_tied = failure.scan is None and len({closure.key_new for closure in across}) >= self._config.confirmations
        if is_tied and (belief is None or belief.log_odds_path > 0.0):
            return
        found = Break(key=key, outcome=Outcome.APART, reason=failure.reason, across=len(across), scan=failure.scan)
        self._breaks[key] = found
        if found.is_sudden and across:
            self._now = self._now.without(across, "too few agree to tie what a sudden loss has torn apart")

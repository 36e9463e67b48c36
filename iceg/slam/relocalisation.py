"""Places found again by their looks alone, where the path cannot say where they are.

Most of a trajectory is held together by loop closures that span it. Where none spans it (the robot was carried, nothing
matched for a while, or the loop is so long that the drift left the search behind) the parts before and after are
compared by the signatures of their places. What looks alike is matched metres and half turns wide; only a set of
closures that agree pairwise is a hypothesis, and every hypothesis must pass an examination that the present estimate
takes, too: placed as it says, do the scans agree with what else was seen there?
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graph.batch import BatchConfig, optimize
from graph.consistency import cumulative_covariances, maximum_clique, pairwise_consistency
from graph.factors import Factor
from graph.measurement import NoMatch
from graph.se2 import between, compose, inverse, logmap
from iceg.slam.config import LoopClosureConfig
from iceg.slam.loop_closure import ANCHOR_SPACING, Attempt, LoopCloser, closure_factor, is_near, lies_near
from iceg.slam.place_signature import place_signatures
from iceg.slam.track import KeyScan, Track

Outcome = Literal["joined", "apart", "contradicted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """Why the path may be broken just before a key pose.

    Attributes:
        reason: what was noticed there, for a person.
        strength: compares doubts: the strongest is where a break is put.
    """

    reason: str
    strength: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """Where the path from scan to scan does not hold.

    Attributes:
        key: the first key pose after it.
        outcome: "joined" by loop closures on both sides; "apart": nothing ties what follows to what was before, and
            odometry alone says where it is; "contradicted": closures disagree with the path, nothing else speaks
            against it, and the map follows the path.
        reason: what was noticed there.
        closures: how many agree about it.
        moved: how far they say that the robot is from where the path puts it [m].
    """

    key: int
    outcome: Outcome
    reason: str
    closures: int = 0
    moved: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A graph, what is known of its closures, and where its path is broken.

    Attributes:
        factors: in force.
        poses: (k, 3) T_map_robot of the key poses.
        attempts: every loop closure tried.
        breaks: in the order of the path.
    """

    factors: list[Factor]
    poses: NDArray[np.float64]
    attempts: list[Attempt]
    breaks: tuple[Break, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Hypothesis:
    """Closures that agree about how what follows a key pose lies to what was before.

    Attributes:
        key: the first key pose after the break, or after the stretch whose drift they end.
        closures: they.
    """

    key: int
    closures: list[Attempt]

    @property
    def support(self) -> int:
        return len({closure.key_new for closure in self.closures})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Exam:
    """How scans fit where they are put.

    Attributes:
        agreeing: matches that say the same.
        against: how many scans contradict what else was seen there, or fit better elsewhere.
    """

    agreeing: list[Attempt]
    against: int

    @property
    def is_passed(self) -> bool:
        """Whether enough agree, and hardly any do not."""
        return len(self.agreeing) >= max(_FEWEST_VOTES, _MAJORITY * self.against)

    def beats(self, other: "_Exam") -> bool:
        """Whether this is clearly the better of two."""
        return len(self.agreeing) - self.against > _BELIEF * (len(other.agreeing) - other.against)


_LOG_END = 12.0
"""A break so near to the beginning or the end of the path matters to nobody [m]."""
_VOUCHED = 10
"""Closures that span a doubtful step and settle the doubt."""
_WEAK_SCORE = 0.7
"""A match that explains less of a scan leaves room for doubt where few closures span it."""
_SAME_PASS = 3
"""Places so few rows apart are one pass."""
_PLACES_AT_ONCE = 512
_BIAS_SIGMAS2 = 9.0
"""The path explains an offset if errors of up to three standard deviations at every step, all alike, do."""
_EXAM_DEVIATIONS = np.array([0.3, 0.3, 0.1])
_EXAM_OVERLAP = 0.5
_EXAM_REACH = 8.0
"""Key scans within so much path of a closure are examined [m] …"""
_EXAM_PASS = 16.0
"""… against the pass of the closure, within so much path [m] …"""
_EXAM_KEYS = 24
"""… at most so many."""
_FEWEST_VOTES, _MAJORITY = 6, 3.0
"""A hypothesis needs at least so many votes, and so many times those against it …"""
_BELIEF = 2.0
"""… and so many times what speaks for the path …"""
_SURE = 6.0
"""… but so many times those against it to contradict a path in which nothing else is doubtful."""
_MOST = 0.75
_MOST_HYPOTHESES = 6
_UNKNOWN = np.diag([100.0, 100.0, np.pi]) ** 2
"""Covariance of a step on which the robot was carried [m², rad²]."""
_BATCH = BatchConfig(max_iterations=50, relative_tolerance=1e-6, absolute_tolerance=1e-4)


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


def describe_break(found: Break, track: Track) -> str:
    """A break in a sentence for a person."""
    where = f"before scan {track.keys[found.key].index} ({found.reason})"
    if found.outcome == "joined":
        return (
            f"the path is broken {where}: {found.closures} key scans that agree put the robot {found.moved:.1f} m from "
            "where the path does, and the map follows them"
        )
    if found.outcome == "apart":
        return f"the path is broken {where}: no loop closure ties the rest to what was before, it may be displaced"
    return (
        f"the path may be broken {where}: {found.closures} key scans that agree put the robot {found.moved:.1f} m from "
        "where the path does; the robot was carried, or two places look alike; the map follows the path"
    )


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
        self._keys = track.keys
        self._config = config
        self._factors, self._poses = estimate.factors, estimate.poses
        self._attempts = list(estimate.attempts)
        self._tried: list[Attempt] = []
        self._path = np.cumsum([key.motion.distance for key in track.keys])
        inner = (self._path > _LOG_END) & (self._path < self._path[-1] - _LOG_END)
        self._breaks: dict[int, Break] = {}
        spanned = self._spanned()
        self._doubts = {
            key: doubt
            for key, doubt in doubts.items()
            if inner[key] and (spanned[key] < _VOUCHED or doubt.strength >= LOST)
        }
        scores = np.array([_score(key) for key in track.keys])
        self._weak = inner & (scores < _WEAK_SCORE) & (spanned < _VOUCHED)
        self._untied = inner & (spanned == 0) | self._weak
        self._untied[list(self._doubts)] = True

    def run(self) -> None:
        if not self._untied.any():
            return
        hypotheses = self._hypotheses(self._verified(self._alike()))
        for closures in hypotheses[:_MOST_HYPOTHESES]:
            hypothesis = self._about_one_key(closures)
            if hypothesis is not None and hypothesis.support >= self._config.place_confirmations:
                self._try(hypothesis)
        for key, doubt in self._doubts.items():
            if doubt.strength >= LOST:
                self._part(key, doubt)

    def estimate(self) -> Estimate:
        closed = {(attempt.key_old, attempt.key_new) for attempt in self._attempts if attempt.accepted}
        alone = [
            replace(
                attempt, accepted=False, reason=f"looks alike{', too few agree' * attempt.accepted}; {attempt.reason}"
            )
            for attempt in self._tried
            if (attempt.key_old, attempt.key_new) not in closed
        ]
        breaks = tuple(self._breaks[key] for key in sorted(self._breaks))
        return Estimate(factors=self._factors, poses=self._poses, attempts=[*self._attempts, *alone], breaks=breaks)

    def _spanned(self) -> NDArray[np.int64]:
        """(k,) how many closures span the step that leads to each key pose, with all the key scans they rest on."""
        change, half = np.zeros(len(self._keys) + 1, dtype=np.int64), self._config.reference_half
        for factor in self._factors:
            if factor.kind == "closure" and factor.i is not None:
                first, last = (
                    min(factor.i, factor.j) + half,
                    max(factor.i, factor.j) + min(self._config.support_offsets),
                )
                if first < last:
                    change[first + 1] += 1
                    change[last + 1] -= 1
        return np.cumsum(change)[:-1]

    def _alike(self) -> list[tuple[int, int]]:
        """Pairs of key poses of untied parts whose places look alike, the most alike first.

        Half of them where the place itself does, half where the stretches around do: among hundreds of places that
        look alike anyway, as along the doors of a corridor, only a stretch tells.
        """
        config = self._config
        signatures = place_signatures(self._keys, self._closer.judge, ANCHOR_SPACING)
        places = signatures.keys
        breaks_before, path = np.cumsum(self._untied)[places], self._path[places]
        likeness_of, rows = [], []
        for first in range(0, len(places), _PLACES_AT_ONCE):
            queries = np.arange(first, min(first + _PLACES_AT_ONCE, len(places)))
            likeness = signatures.likeness(queries)
            apart = breaks_before[queries, None] > breaks_before[None, :]
            earlier = path[queries, None] - path[None, :] > config.min_path
            likeness[~(apart & earlier)] = 0.0
            for query, row in zip(queries.tolist(), likeness, strict=True):
                best = _best(row, config.places_each)
                likeness_of += [value for value, _ in best]
                rows += [(other, query) for _, other in best]
        if not rows:
            return []
        pairs = np.array(rows)
        along = signatures.likeness_along(pairs[:, 1], pairs[:, 0])
        order = np.argsort(np.minimum(_ranks(np.array(likeness_of)), _ranks(along)), kind="stable")[: config.places]
        return [(int(places[old]), int(places[new])) for old, new in pairs[order].tolist()]

    def _verified(self, pairs: Sequence[tuple[int, int]]) -> list[Attempt]:
        """What matches and is supported by the neighbours, among places that look alike."""
        self._tried = [self._closer.match_anywhere(old, new, self._poses) for old, new in sorted(pairs)]
        return [attempt for attempt in self._tried if attempt.accepted]

    def _hypotheses(self, closures: list[Attempt]) -> list[list[Attempt]]:
        """Sets of closures that agree pairwise along the path as the front end saw it, the largest first."""
        chain = [factor for factor in self._factors if factor.kind in {"odometry", "ice"}]
        T_track_keys = np.array([key.T_track_robot for key in self._keys])
        cumulative = cumulative_covariances(chain, T_track_keys)
        factors = [closure_factor(closure) for closure in closures]
        agree = pairwise_consistency(factors, T_track_keys, cumulative)
        left, sets = np.arange(len(closures)), []
        while len(left) >= self._config.place_confirmations:
            members = maximum_clique(agree[np.ix_(left, left)])
            sets.append([closures[index] for index in left[members].tolist()])
            left = left[~members]
        return sorted(sets, key=len, reverse=True)

    def _about_one_key(self, closures: list[Attempt]) -> _Hypothesis | None:
        """Those that span the same untied step: the most doubtful among the steps that most of them span.

        Not all need to: the reference of a closure may hold key scans from both sides of a break.
        """
        spans = np.zeros(len(self._keys) + 1, dtype=np.int64)
        for closure in closures:
            spans[closure.key_old + 1] += 1
            spans[closure.key_new + 1] -= 1
        spans = np.where(self._untied, np.cumsum(spans)[:-1], 0)
        if not spans.any():
            return None
        steps = np.flatnonzero(spans >= _MOST * spans.max()).tolist()
        key = max(steps, key=lambda step: (self._doubt(step).strength, step))
        return _Hypothesis(key=key, closures=[c for c in closures if c.key_old < key <= c.key_new])

    def _doubt(self, key: int) -> Doubt:
        """What speaks against the step to a key pose; where nothing does, how little its match explained."""
        known = self._doubts.get(key)
        if known is not None:
            return known
        score = _score(self._keys[key])
        return Doubt(reason=f"only {score:.0%} of the beams agreed with what was known before", strength=1.0 - score)

    def _try(self, hypothesis: _Hypothesis) -> None:
        """Examine a hypothesis, and the present estimate where they differ; act on what holds."""
        exam = self._examined(hypothesis, moved=True)
        closures = _distinct([*exam.agreeing, *hypothesis.closures])
        is_confirmed = sum(is_near(closure, self._poses) for closure in closures) > 0.5 * len(closures)
        if not exam.is_passed or not (is_confirmed or exam.beats(self._examined(hypothesis, moved=False))):
            return
        key = hypothesis.key
        if is_confirmed or self._is_drift(hypothesis):
            self._doubts.pop(key, None)
            self._close(closures)
            return
        doubt, is_known = self._doubt(key), key in self._doubts
        if not is_known and len(exam.agreeing) < _SURE * exam.against:
            return
        correction = self._correction(hypothesis)
        moved = (compose(correction, self._poses[key]) - self._poses[key])[:2]
        self._breaks[key] = Break(
            key=key,
            outcome="joined" if is_known else "contradicted",
            reason=doubt.reason,
            closures=len({closure.key_new for closure in closures}),
            moved=float(np.hypot(*moved)),
        )
        self._doubts.pop(key, None)
        self._untied[key] = False
        if is_known:
            self._join(key, closures, correction)

    def _examined(self, hypothesis: _Hypothesis, *, moved: bool) -> _Exam:
        """Key scans after the break matched against everything before it, where a hypothesis or the path puts them."""
        agreeing, against = [], 0
        for key, nearest in self._to_examine(hypothesis):
            T_map_key = self._poses[key]
            if moved:
                assert nearest.match is not None
                T_map_nearest = compose(self._poses[nearest.key_old], nearest.match.T_ref_cur)
                T_near_key = between(self._keys[nearest.key_new].T_track_robot, self._keys[key].T_track_robot)
                T_map_key = compose(T_map_nearest, T_near_key)
            for candidate in self._closer.seen_from(key, T_map_key, self._poses, hypothesis.key, _EXAM_DEVIATIONS):
                if moved and abs(self._path[candidate.key_old] - self._path[nearest.key_old]) > _EXAM_PASS:
                    continue  # other passes may have drifted away from this one
                attempt = self._closer.match(candidate, self._poses)
                if attempt.accepted and lies_near(attempt, candidate.T_old_new):
                    agreeing.append(attempt)
                elif attempt.overlap >= _EXAM_OVERLAP:
                    against += 1
        return _Exam(agreeing=agreeing, against=against)

    def _to_examine(self, hypothesis: _Hypothesis) -> list[tuple[int, Attempt]]:
        """Key poses near those of a hypothesis, each with the closure nearest to it along the path."""
        path, ends = self._path, np.array([closure.key_new for closure in hypothesis.closures])
        keys = np.arange(hypothesis.key, len(self._keys), ANCHOR_SPACING)
        far = np.abs(path[keys][:, None] - path[ends][None, :])
        near = np.flatnonzero(far.min(axis=1) < _EXAM_REACH)
        near = near[:: max(1, -(-len(near) // _EXAM_KEYS))]
        return [(int(keys[k]), hypothesis.closures[int(far[k].argmin())]) for k in near]

    def _correction(self, hypothesis: _Hypothesis) -> NDArray[np.float64]:
        """(3,) what moves the poses after the break, in the map: that of the closure nearest to the break."""
        nearest = min(hypothesis.closures, key=lambda closure: closure.key_new)
        assert nearest.match is not None
        T_map_new = compose(self._poses[nearest.key_old], nearest.match.T_ref_cur)
        return compose(T_map_new, inverse(self._poses[nearest.key_new]))

    def _is_drift(self, hypothesis: _Hypothesis) -> bool:
        """Whether the path, with errors at every step that are larger than it claims and all alike, explains it."""
        chain = [factor for factor in self._factors if factor.kind in {"odometry", "ice"}]
        cumulative = cumulative_covariances(chain, self._poses)
        for closure in hypothesis.closures:
            assert closure.match is not None
            T_map_new = compose(self._poses[closure.key_old], closure.match.T_ref_cur)
            error = logmap(compose(T_map_new, inverse(self._poses[closure.key_new])))
            covariance = cumulative[closure.key_new] - cumulative[closure.key_old]
            steps = closure.key_new - closure.key_old
            if error @ np.linalg.solve(covariance, error) > _BIAS_SIGMAS2 * steps:
                return False
        return True

    def _close(self, closures: list[Attempt]) -> None:
        self._attempts += [
            replace(c, reason=f"by its looks, with {len(closures) - 1} others; {c.reason}") for c in closures
        ]
        self._factors = [*self._factors, *(closure_factor(closure) for closure in closures)]
        self._poses = optimize(self._factors, self._poses, _BATCH).poses
        spanned = self._spanned()
        self._untied &= (spanned == 0) | (self._weak & (spanned < _VOUCHED))
        self._untied[list(self._doubts)] = True

    def _join(self, key: int, closures: list[Attempt], correction: NDArray[np.float64]) -> None:
        """Let the step to `key` go, move what follows to where the closures put it, and take out what contradicts."""
        until = min((other for other in self._breaks if other > key), default=len(self._keys))
        self._poses = self._poses.copy()
        self._poses[key:until] = compose(correction, self._poses[key:until])
        self._factors = [
            replace(factor, covariance=_UNKNOWN) if _spans(factor, key) and factor.kind != "closure" else factor
            for factor in self._factors
        ]
        self._take_out(key, f"contradicted by {len(closures)} closures that agree", keep_near=True)
        self._close(closures)

    def _part(self, key: int, doubt: Doubt) -> None:
        """What follows a break hangs on odometry alone, unless the closures across it stand an examination."""
        across = [a for a in self._attempts if a.accepted and a.key_old < key <= a.key_new]
        if len({attempt.key_new for attempt in across}) >= self._config.confirmations:
            exam = self._examined(_Hypothesis(key=key, closures=across), moved=False)
            if exam.is_passed:
                return
        self._breaks[key] = Break(key=key, outcome="apart", reason=doubt.reason)
        if across:
            self._take_out(key, "too few agree across a break of the path", keep_near=False)
            self._poses = optimize(self._factors, self._poses, _BATCH).poses

    def _take_out(self, key: int, why: str, *, keep_near: bool) -> None:
        """Remove the closures that span the step to `key`, but for those that fit the poses as they are now."""
        gone = set()
        for index, attempt in enumerate(self._attempts):
            if attempt.accepted and attempt.key_old < key <= attempt.key_new:
                if keep_near and is_near(attempt, self._poses):
                    continue
                gone.add((attempt.key_old, attempt.key_new))
                self._attempts[index] = replace(
                    attempt, accepted=False, removed=True, reason=f"{why}; {attempt.reason}"
                )
        self._factors = [f for f in self._factors if f.kind != "closure" or (f.i, f.j) not in gone]


LOST = 3.0
"""Strength of a doubt from which on nothing was known when the robot went on."""


def _best(likeness: NDArray[np.float32], wanted: int) -> list[tuple[float, int]]:
    """The places most alike and how much, the best of each pass."""
    found = []
    for _ in range(wanted):
        best = int(likeness.argmax())
        if likeness[best] <= 0.0:
            break
        found.append((float(likeness[best]), best))
        likeness[max(0, best - _SAME_PASS) : best + _SAME_PASS + 1] = 0.0
    return found


def _ranks(values: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """(n,) place of each value among all, the largest first."""
    ranks = np.empty(len(values), dtype=np.int64)
    ranks[np.argsort(-values, kind="stable")] = np.arange(len(values))
    return ranks


def _distinct(closures: Sequence[Attempt]) -> list[Attempt]:
    """One for each pair of key poses, the first."""
    return list({(c.key_old, c.key_new): c for c in reversed(closures)}.values())[::-1]


def _spans(factor: Factor, key: int) -> bool:
    return factor.i is not None and min(factor.i, factor.j) < key <= max(factor.i, factor.j)


def _score(key: KeyScan) -> float:
    """Of the match of a key scan, 0 without one."""
    return 0.0 if isinstance(key.match, NoMatch) else key.match.score

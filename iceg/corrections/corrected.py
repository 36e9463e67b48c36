"""The graph that a run has found, corrected by hand and settled anew."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.config import PoseGraphConfig
from graph.factors import Factor, RobustKernel
from graph.pose_graph import PoseGraph
from iceg.corrections.by_hand import ByHand, closures_by_hand
from iceg.corrections.corrections import Corrections, Distrusted, Pinned
from iceg.corrections.forbidden import forbids
from iceg.corrections.settled import Contradiction, Settled, contradiction, settled
from iceg.corrections.verdicts import from_verdicts
from iceg.slam.back_end import Solution
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.closures.attempt import FORBIDDEN, Attempt, Verdict, closure_factor
from iceg.slam.closures.closure import Closure
from iceg.slam.config import FinishConfig
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.run_warning import RunWarning
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Corrected:
    """A solution after corrections.

    Attributes:
        solution: the graph at its optimum, each closure that is not pinned under a robust kernel.
        by_hand: the record of closures by hand.
        consistent: factors of closures by hand that the rest agrees with.
        distrusted: key poses whose points are not to be believed.
        warnings: what contradicts what, and corrections that had no effect.
    """

    solution: Solution
    by_hand: tuple[Closure, ...] = ()
    consistent: tuple[Factor, ...] = ()
    distrusted: frozenset[int] = frozenset()
    warnings: tuple[RunWarning, ...] = ()


def corrected(
    solution: Solution,
    corrections: Corrections,
    track: Track,
    closer: Callable[[], LoopCloser],
    kernel: RobustKernel,
    finish: FinishConfig,
    graph_config: PoseGraphConfig,
) -> Corrected:
    """Apply corrections to a graph.

    Args:
        solution: the graph at its optimum, and the closures tried.
        corrections: scans counted as the track counts them.
        track: key scans.
        closer: makes what matches closures by hand that only name scans.
        kernel: of closures that are not pinned.
        finish: which closures are outliers, and how far the path is bent for one by hand.
        graph_config: of the graph.

    Returns:
        What it settles at; the solution itself where no correction is about the graph.
    """
    corrections = from_verdicts(corrections, solution.attempts, track)
    if not (corrections.forbidden or corrections.added or corrections.pinned or corrections.distrusted):
        return Corrected(solution=solution)
    found, warnings = _without_forbidden(_Found.of(solution), corrections, track)
    found, unknown = _pinned(found, corrections.pinned, track)
    distrusted = _distrusted_keys(corrections.distrusted, track)
    found = found.loosened(distrusted)
    matcher = closer() if any(closure.T_i_j is None for closure in corrections.added) else None
    by_hand = closures_by_hand(corrections.added, track, matcher, solution.poses, kernel)
    there = [each for each in by_hand if each.factor is not None]
    added = [each.factor for each in there if each.factor is not None]
    here = settled(
        [*found.chain, *found.loops, *added], [f for f in added if f.kernel is not None], solution.poses, finish
    )
    against = {id(factor): contradiction(here, factor, solution.poses, finish) for factor in (*found.pinned, *added)}
    conflicts = {id(each): None if each.factor is None else against[id(each.factor)] for each in by_hand}
    lost = [f for f in added if f.kernel is not None and here.weight_of(f) < finish.outlier_weight]
    in_force = [factor for factor in here.factors if not any(factor is other for other in lost)]
    after = replace(
        solution,
        graph=PoseGraph.from_factors(in_force, here.poses, graph_config),
        poses=here.poses,
        attempts=found.attempts,
        breaks=_breaks(solution, here, in_force),
    )
    return Corrected(
        solution=after,
        by_hand=tuple(_record(each, conflicts[id(each)], lost, track) for each in by_hand),
        consistent=tuple(factor for factor in added if _is_consistent(factor, here, against[id(factor)])),
        distrusted=frozenset(distrusted),
        warnings=(
            *warnings,
            *unknown,
            *_pin_warnings(found, against, track),
            *(warning for each in by_hand if (warning := _warning(each, conflicts[id(each)], lost)) is not None),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """What the program has found, as far as it is corrected.

    Attributes:
        chain: the factors without a robust kernel, pinned closures among them.
        loops: the closures under robust kernels.
        pinned: the pinned of the program's own closures.
        attempts: the record of closures tried.
    """

    chain: list[Factor]
    loops: list[Factor]
    pinned: list[Factor]
    attempts: list[Attempt]

    @classmethod
    def of(cls, solution: Solution) -> "_Found":
        factors = solution.graph.factors
        return cls(
            chain=[factor for factor in factors if factor.kind != "closure"],
            loops=[factor for factor in factors if factor.kind == "closure"],
            pinned=[],
            attempts=solution.attempts,
        )

    def loosened(self, by_key: dict[int, float]) -> "_Found":
        """The same, whatever measures one of some key poses surer by less."""
        if not by_key:
            return self

        def loose(factor: Factor) -> Factor:
            if factor.i is None:
                return factor
            loosest = max(by_key.get(factor.i, 1.0), by_key.get(factor.j, 1.0))
            return factor if loosest == 1.0 else replace(factor, covariance=loosest**2 * factor.covariance)

        kept = set(map(id, self.pinned))
        chain = [factor if id(factor) in kept else loose(factor) for factor in self.chain]
        return replace(self, chain=chain, loops=[loose(factor) for factor in self.loops])


def _without_forbidden(found: _Found, corrections: Corrections, track: Track) -> tuple[_Found, list[RunWarning]]:
    is_forbidden = forbids(corrections.forbidden, track)
    attempts = [
        replace(attempt, accepted=False, removed=False, reason=f"{FORBIDDEN}; {attempt.reason}")
        if (attempt.accepted or attempt.removed) and is_forbidden(attempt.key_old, attempt.key_new)
        else attempt
        for attempt in found.attempts
    ]
    loops = [loop for loop in found.loops if loop.i is None or not is_forbidden(loop.i, loop.j)]
    warnings = []
    tried = {(attempt.key_old, attempt.key_new) for attempt in found.attempts}
    for each in corrections.forbidden:
        if each.is_single and not tried & _ends(each.one[0], each.other[0], track):
            sentence = f"{each.where}: no closure between scans {each.one[0]} and {each.other[0]} was tried"
            warnings.append(RunWarning(kind="corrections", sentence=sentence, scan=each.one[0]))
    return replace(found, attempts=attempts, loops=loops), warnings


def _pinned(found: _Found, pins: Sequence[Pinned], track: Track) -> tuple[_Found, list[RunWarning]]:
    attempts, pinned, warnings = list(found.attempts), list(found.pinned), []
    for pin in pins:
        ends = _ends(pin.scan_i, pin.scan_j, track)
        row = next((k for k, a in enumerate(attempts) if (a.key_old, a.key_new) in ends and a.match is not None), None)
        if row is None:
            sentence = (
                f"{pin.where}: no closure between scans {pin.scan_i} and {pin.scan_j} was matched, so that there is "
                "none to pin; add it instead"
            )
            warnings.append(RunWarning(kind="corrections", sentence=sentence, scan=pin.scan_i))
            continue
        attempts[row] = replace(attempts[row], accepted=True, removed=False, reason=f"pinned; {attempts[row].reason}")
        pinned.append(closure_factor(attempts[row]))
    ends_of_pinned = {(factor.i, factor.j) for factor in pinned}
    loops = [loop for loop in found.loops if (loop.i, loop.j) not in ends_of_pinned]
    return replace(found, attempts=attempts, loops=loops, pinned=pinned, chain=[*found.chain, *pinned]), warnings


def _ends(scan_i: int, scan_j: int, track: Track) -> set[tuple[int, int]]:
    """The key poses of two scans, in either order."""
    i, j = track.key_of_scan[[scan_i, scan_j]].tolist()
    return {(i, j), (j, i)}


def _distrusted_keys(intervals: Sequence[Distrusted], track: Track) -> dict[int, float]:
    """The key poses of intervals that are not to be trusted, each with its factor."""
    found: dict[int, float] = {}
    for interval in intervals:
        first, last = interval.scans
        for key in np.unique(track.key_of_scan[first : last + 1]).tolist():
            found[key] = max(interval.factor, found.get(key, 1.0))
    return found


def _breaks(solution: Solution, here: Settled, in_force: Sequence[Factor]) -> tuple[Break, ...]:
    """What became of each break of the path, now that closures are gone or more."""
    closures = [(f.i, f.j) for f in in_force if f.kind == "closure" and id(f) in here.holding and f.i is not None]
    before = {(f.i, f.j) for f in solution.graph.factors if f.kind == "closure"}

    def spanning(ends: Sequence[tuple[int, int]], key: int) -> int:
        return sum(min(i, j) < key <= max(i, j) for i, j in ends)

    breaks = []
    for found in solution.breaks:
        fresh = spanning([ends for ends in closures if ends not in before], found.key)
        if found.outcome is Outcome.JOINED and not spanning(closures, found.key):
            breaks.append(replace(found, outcome=Outcome.APART, closures=0, moved=0.0))
        elif found.outcome is Outcome.APART and fresh:
            moved = _moved(solution.poses, here.poses, found.key)
            breaks.append(replace(found, outcome=Outcome.JOINED, closures=fresh, moved=moved))
        else:
            breaks.append(found)
    return tuple(breaks)


def _moved(before: NDArray[np.float64], after: NDArray[np.float64], key: int) -> float:
    return float(np.hypot(*(after[key] - before[key])[:2]))


def _is_consistent(factor: Factor, here: Settled, conflict: Contradiction | None) -> bool:
    return conflict is None or (not conflict.closures and here.weight_of(factor) >= 1.0 and factor.kernel is not None)


def _record(each: ByHand, conflict: Contradiction | None, lost: Sequence[Factor], track: Track) -> Closure:
    if each.factor is None:
        return each.record(Verdict.REJECTED, track)
    if conflict is None:
        return each.record(Verdict.ACCEPTED, track)
    is_lost = any(each.factor is factor for factor in lost)
    told = replace(each, reason=f"{each.reason}; {_contradicts(conflict)}")
    return told.record(Verdict.REMOVED if is_lost else Verdict.ACCEPTED, track)


def _contradicts(conflict: Contradiction) -> str:
    off = f"{conflict.sigmas:.0f} standard deviations off"
    if not conflict.closures:
        return (
            f"the path, bent for it, contradicts it, {off}"
            if conflict.is_followed
            else f"the path contradicts it, {off}"
        )
    others = (
        "another closure contradicts" if conflict.closures == 1 else f"{conflict.closures} other closures contradict"
    )
    return f"{others} it, {off}"


def _warning(each: ByHand, conflict: Contradiction | None, lost: Sequence[Factor]) -> RunWarning | None:
    closure, end = each.closure, ""
    if each.factor is not None and conflict is None:
        return None
    if each.factor is None:
        what = "takes no part: " + each.reason
    else:
        if closure.pinned:
            end = "; it is believed all the same, for it is pinned"
        elif any(each.factor is factor for factor in lost):
            end = "; it takes no part unless it is pinned"
        assert conflict is not None
        what = f"is inconsistent: {_contradicts(conflict)}{end}"
    sentence = f"{closure.where}: the closure by hand between scans {closure.scan_i} and {closure.scan_j} {what}"
    return RunWarning(kind="corrections", sentence=sentence, scan=closure.scan_i)


def _pin_warnings(found: _Found, against: dict[int, Contradiction | None], track: Track) -> list[RunWarning]:
    warnings = []
    for factor in found.pinned:
        conflict = against[id(factor)]
        if conflict is not None and factor.i is not None:
            scan_i, scan_j = track.keys[factor.i].index, track.keys[factor.j].index
            sentence = (
                f"the closure pinned between scans {scan_i} and {scan_j} is inconsistent: {_contradicts(conflict)}"
            )
            warnings.append(RunWarning(kind="corrections", sentence=sentence, scan=scan_i))
    return warnings

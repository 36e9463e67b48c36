"""The graph that a run has found, corrected by hand and settled anew."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.factors import Factor
from iceg.config import Config
from iceg.corrections.by_hand import closures_by_hand
from iceg.corrections.corrections import Corrections, Distrusted, Pinned
from iceg.corrections.forbidden import forbids
from iceg.corrections.judged import Judged
from iceg.corrections.settled import Settled, contradiction, settled
from iceg.corrections.verdicts import from_verdicts
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.closures.attempt import FORBIDDEN, closure_factor
from iceg.slam.closures.closure import Closure
from iceg.slam.config import FinishConfig
from iceg.slam.map_matcher import MapMatcher
from iceg.slam.run_warning import RunWarning
from iceg.slam.solution import Solution
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
    solution: Solution, corrections: Corrections, track: Track, matcher: MapMatcher, config: Config
) -> Corrected:
    """Apply corrections to a graph.

    Args:
        solution: the graph at its optimum, and the closures tried.
        corrections: scans counted as the track counts them.
        track: key scans.
        matcher: for closures by hand that only name scans.
        config: what is a match, which closures are outliers, and how far the path is bent for one by hand.

    Returns:
        What it settles at; the solution itself where no correction is about the graph.
    """
    corrections = from_verdicts(corrections, solution.attempts, track)
    if not (corrections.forbidden or corrections.added or corrections.pinned or corrections.distrusted):
        return Corrected(solution=solution)
    distrusted = _distrusted_keys(corrections.distrusted, track)
    found, not_tried = _without_forbidden(solution, corrections, track)
    found, pinned, unmatched = _pinned(_loosened(found, distrusted), corrections.pinned, track)
    by_hand = closures_by_hand(corrections.added, track, matcher, solution.poses, config)
    added = [each.factor for each in by_hand if each.factor is not None]
    here = settled([*found.factors, *added], [f for f in added if f.kernel is not None], solution.poses, config.finish)
    judged = [Judged.of(each, here, solution.poses, config.finish) for each in by_hand]
    lost = {id(each.factor) for each in judged if each.is_lost}
    in_force = [factor for factor in here.factors if id(factor) not in lost]
    return Corrected(
        solution=replace(found, factors=in_force, poses=here.poses, breaks=_breaks(solution, here, in_force)),
        by_hand=tuple(each.record(track) for each in judged),
        consistent=tuple(each.factor for each in judged if each.factor is not None and each.is_consistent),
        distrusted=frozenset(distrusted),
        warnings=(
            *not_tried,
            *unmatched,
            *_contradicted_pins(pinned, here, solution.poses, track, config.finish),
            *(warning for each in judged if (warning := each.warning()) is not None),
        ),
    )


def _without_forbidden(found: Solution, corrections: Corrections, track: Track) -> tuple[Solution, list[RunWarning]]:
    """Without the closures that are forbidden, and a warning for each that was not even tried."""
    is_forbidden = forbids(corrections.forbidden, track)
    attempts = [
        replace(attempt, accepted=False, removed=False, reason=f"{FORBIDDEN}; {attempt.reason}")
        if (attempt.accepted or attempt.removed) and is_forbidden(attempt.key_old, attempt.key_new)
        else attempt
        for attempt in found.attempts
    ]
    factors = [f for f in found.factors if f.kind != "closure" or f.i is None or not is_forbidden(f.i, f.j)]
    warnings = []
    tried = {(attempt.key_old, attempt.key_new) for attempt in found.attempts}
    for each in corrections.forbidden:
        if each.is_single and not tried & _ends(each.one[0], each.other[0], track):
            sentence = f"{each.where}: no closure between scans {each.one[0]} and {each.other[0]} was tried"
            warnings.append(RunWarning(kind="corrections", sentence=sentence, scan=each.one[0]))
    return replace(found, factors=factors, attempts=attempts), warnings


def _loosened(found: Solution, by_key: dict[int, float]) -> Solution:
    """The same, whatever measures one of some key poses surer by less."""

    def loose(factor: Factor) -> Factor:
        if factor.i is None:
            return factor
        loosest = max(by_key.get(factor.i, 1.0), by_key.get(factor.j, 1.0))
        return factor if loosest == 1.0 else replace(factor, covariance=loosest**2 * factor.covariance)

    return replace(found, factors=[loose(factor) for factor in found.factors])


def _pinned(found: Solution, pins: Sequence[Pinned], track: Track) -> tuple[Solution, list[Factor], list[RunWarning]]:
    """With pinned closures without a robust kernel, before the others; these, and a warning for each not matched."""
    attempts, pinned, warnings = list(found.attempts), [], []
    rows: set[int] = set()
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
        if row in rows:  # pinned twice it is still one measurement
            continue
        rows.add(row)
        attempts[row] = replace(attempts[row], accepted=True, removed=False, reason=f"pinned; {attempts[row].reason}")
        pinned.append(closure_factor(attempts[row]))
    ends_of_pinned = {factor.pair for factor in pinned}
    chain = [factor for factor in found.factors if factor.kind != "closure"]
    loops = [f for f in found.factors if f.kind == "closure" and f.pair not in ends_of_pinned]
    return replace(found, factors=[*chain, *pinned, *loops], attempts=attempts), pinned, warnings


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
    before = {f.pair for f in solution.factors if f.kind == "closure"}

    def spanning(ends: Sequence[tuple[int, int]], key: int) -> int:
        return sum(min(i, j) < key <= max(i, j) for i, j in ends)

    breaks = []
    for found in solution.breaks:
        fresh = spanning([ends for ends in closures if ends not in before], found.key)
        if found.outcome is Outcome.JOINED and not spanning(closures, found.key):
            breaks.append(replace(found, outcome=Outcome.APART, closures=0, moved=0.0))
        elif not fresh:
            breaks.append(found)
        elif found.outcome is Outcome.APART:
            moved = _moved(solution.poses, here.poses, found.key)
            breaks.append(replace(found, outcome=Outcome.JOINED, closures=fresh, moved=moved, probability=0.0))
        elif found.outcome not in {Outcome.CONFLICT, Outcome.DOUBTFUL}:
            breaks.append(replace(found, probability=0.0))
        # Of the others nothing is left to tell: who closes a loop across them says which is right.
    return tuple(breaks)


def _moved(before: NDArray[np.float64], after: NDArray[np.float64], key: int) -> float:
    return float(np.hypot(*(after[key] - before[key])[:2]))


def _contradicted_pins(
    pinned: Sequence[Factor], here: Settled, poses: NDArray[np.float64], track: Track, config: FinishConfig
) -> list[RunWarning]:
    warnings = []
    for factor in pinned:
        conflict = contradiction(here, factor, poses, config)
        if conflict is not None and factor.i is not None:
            scan_i, scan_j = track.keys[factor.i].index, track.keys[factor.j].index
            sentence = f"the closure pinned between scans {scan_i} and {scan_j} is inconsistent: {conflict.sentence}"
            warnings.append(RunWarning(kind="corrections", sentence=sentence, scan=scan_i))
    return warnings

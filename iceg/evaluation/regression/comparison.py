"""What changed between two tables, in numbers and cell by cell."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iceg.evaluation.bench.tables import Row
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.outcome import Outcome
from iceg.evaluation.regression.paired import by_family, chance, interval, scatter
from iceg.evaluation.regression.totals import LEAST_M, Totals

A_FIFTH = math.log(1.2)
"""A cell is told whose error changed by more than a fifth …"""
BEYOND_SCATTER = 2.0
"""… and counted as beyond chance if by so many standard deviations of what a millimetre of noise does to it."""
_THE_SAME = 2e-6
"""Tables keep so many digits [m]."""

Pair = tuple[Outcome, Outcome]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Cells that two tables have in common, before and after a change.

    Attributes:
        before: sums over those cells …
        after: … and after the change.
        ratio: geometric mean of the errors after, over before.
        low: 95 % bootstrap interval of it …
        high: ….
        error_chance: probability of such a ratio, or one farther from 1, if the change does nothing (sign flips) …
        good_chance: … of such a change in the number of good runs (McNemar's test where seeds do not repeat) …
        ruined_chance: … of those ruined …
        silent_chance: … and of those off in silence …
        nees_chance: … and of the change of the NEES.
        changed: cells on which the change has any effect at all, to the micrometre …
        better: … those whose error is smaller by a fifth or more …
        worse: … and larger.
        cpu_ratio: processor time after, over before; of two runs at the same time on the same machine only.
    """

    before: Totals
    after: Totals
    ratio: float
    low: float
    high: float
    error_chance: float
    good_chance: float
    ruined_chance: float
    silent_chance: float
    nees_chance: float
    changed: int
    better: int
    worse: int
    cpu_ratio: float

    def row(self) -> Row:
        """For a table: the sums after the change, and how they differ."""
        return {
            **{name: value for name, value in self.after.row().items() if name != "CPU [s]"},
            "cells changed": self.changed,
            "a fifth better": self.better,
            "a fifth worse": self.worse,
            "error ratio": self.ratio,
            "from": self.low,
            "to": self.high,
            "p error": self.error_chance,
            "p good": self.good_chance,
            "p ruined": self.ruined_chance,
            "p silent": self.silent_chance,
            "p NEES": self.nees_chance,
            "CPU ratio": self.cpu_ratio,
        }


def in_common(before: Sequence[Outcome], after: Sequence[Outcome]) -> list[Pair]:
    """The cells that are in both tables.

    Raises:
        EvaluationError: there are none.
    """
    known = {outcome.name: outcome for outcome in before}
    pairs = [(known[outcome.name], outcome) for outcome in after if outcome.name in known]
    if not pairs:
        raise EvaluationError(f"found no cell in common between tables of {len(before)} and {len(after)}")
    return pairs


def compare(before: Sequence[Outcome], after: Sequence[Outcome]) -> Comparison:
    """What a change does to the cells that two tables have in common.

    Raises:
        EvaluationError: there are none.
    """
    pairs = in_common(before, after)
    families = [pair[0].family for pair in pairs]
    logs = [log_ratio(pair) for pair in pairs]
    first, last = (Totals.of([pair[side] for pair in pairs]) for side in (0, 1))
    sums = by_family(zip(families, logs, strict=True))
    counts = by_family((family, 1.0) for family in families)

    def differing(count: Callable[[Outcome], bool]) -> float:
        return chance(by_family((one.family, float(count(two)) - float(count(one))) for one, two in pairs))

    nees = [(one.family, math.log(two.nees / one.nees)) for one, two in pairs if one.nees and two.nees]
    low, high = interval(sums, counts)
    return Comparison(
        before=first,
        after=last,
        ratio=last.error_m / first.error_m,
        low=low,
        high=high,
        error_chance=chance(sums),
        good_chance=differing(lambda one: one.verdict.is_good),
        ruined_chance=differing(lambda one: one.verdict.is_ruined),
        silent_chance=differing(lambda one: one.verdict.is_off_in_silence),
        nees_chance=chance(by_family(nees)),
        changed=sum(_is_changed(pair) for pair in pairs),
        better=sum(log < -A_FIFTH for log in logs),
        worse=sum(log > A_FIFTH for log in logs),
        cpu_ratio=last.cpu_s / first.cpu_s,
    )


def log_ratio(pair: Pair) -> float:
    """Logarithm of the error after, over before."""
    before, after = pair
    return math.log(max(after.error_m, LEAST_M) / max(before.error_m, LEAST_M))


def changed_cells(before: Sequence[Outcome], after: Sequence[Outcome]) -> list[Row]:
    """The cells whose error changed by a fifth, or whose verdict changed, the largest changes first.

    Whether a change is beyond what a millimetre of noise does is told where the first table has several seeds of it.
    """
    pairs = in_common(before, after)
    known = _scatter(before)
    told = [pair for pair in pairs if abs(log_ratio(pair)) > A_FIFTH or in_words(pair[0]) != in_words(pair[1])]
    told.sort(key=lambda pair: (-abs(log_ratio(pair)), pair[0].name))
    return [_changed(pair, known.get(pair[0].family)) for pair in told]


def _is_changed(pair: Pair) -> bool:
    before, after = pair
    nees = before.nees or 0.0, after.nees or 0.0
    return abs(after.error_m - before.error_m) > _THE_SAME or abs(nees[1] - nees[0]) > _THE_SAME


def _changed(pair: Pair, scatter_of_log: float | None) -> Row:
    before, after = pair
    least = None if scatter_of_log is None else BEYOND_SCATTER * math.sqrt(2.0) * scatter_of_log
    return {
        "cell": after.name,
        "before [m]": before.error_m,
        "after [m]": after.error_m,
        "verdict before": in_words(before),
        "verdict after": in_words(after),
        "scatter of its logarithm": scatter_of_log,
        "beyond it": None if least is None else "yes" if abs(log_ratio(pair)) > least else "no",
    }


def in_words(outcome: Outcome) -> str:
    """What became of a cell: good, off or ruined, and whether it says so."""
    verdict = outcome.verdict
    word = "good" if verdict.is_good else "ruined" if verdict.is_ruined else "off"
    return word if verdict.is_good else f"{word}, {'said' if verdict.is_said else 'silent'}"


def _scatter(outcomes: Sequence[Outcome]) -> dict[str, float]:
    errors: dict[str, list[float]] = {}
    for outcome in outcomes:
        errors.setdefault(outcome.family, []).append(max(outcome.error_m, LEAST_M))
    return scatter(errors)

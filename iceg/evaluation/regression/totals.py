"""One number for each thing that matters, over a table of outcomes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graph.elementary import log
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.regression.outcome import Outcome

LEAST_M = 0.001
"""Errors are not taken to be smaller [m]: a log judged by its own run without a fault may lie on it."""
DISHONEST = 12.0
"""A mean NEES above this: standard deviations too small by two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Totals:
    """Sums over a table.

    Attributes:
        cells: how many.
        good: as `Verdict` says …
        ruined_and_said: …
        ruined_in_silence: …
        off_in_silence: ….
        error_m: geometric mean [m].
        nees: median over the runs of the mean NEES of their key poses; None where the truth is not known.
        dishonest: share of the runs whose mean NEES is above 12.
        worse: runs that are worse than the odometry they were given, and not good.
        cpu_s: processor time of all [s].
    """

    cells: int
    good: int
    ruined_and_said: int
    ruined_in_silence: int
    off_in_silence: int
    error_m: float
    nees: float | None
    dishonest: float | None
    worse: int
    cpu_s: float

    @classmethod
    def of(cls, outcomes: Sequence[Outcome]) -> "Totals":
        """The sums of at least one outcome."""
        verdicts = [outcome.verdict for outcome in outcomes]
        errors = np.array([max(outcome.error_m, LEAST_M) for outcome in outcomes])
        nees = np.array([outcome.nees for outcome in outcomes if outcome.nees is not None])
        return cls(
            cells=len(outcomes),
            good=sum(one.is_good for one in verdicts),
            ruined_and_said=sum(one.is_ruined_and_said for one in verdicts),
            ruined_in_silence=sum(one.is_ruined_in_silence for one in verdicts),
            off_in_silence=sum(one.is_off_in_silence for one in verdicts),
            error_m=math.exp(log(errors).mean()),
            nees=float(np.median(nees)) if len(nees) else None,
            dishonest=float((nees > DISHONEST).mean()) if len(nees) else None,
            worse=sum(outcome.is_worse_than_odometry for outcome in outcomes),
            cpu_s=sum(outcome.cpu_s for outcome in outcomes),
        )

    def row(self) -> Row:
        """For a table."""
        return {
            "cells": self.cells,
            "good": self.good,
            "ruined and said": self.ruined_and_said,
            "ruined in silence": self.ruined_in_silence,
            "off in silence": self.off_in_silence,
            "geometric mean [mm]": 1e3 * self.error_m,
            "NEES": self.nees,
            "above 12 [%]": None if self.dishonest is None else 100.0 * self.dishonest,
            "worse than odometry": self.worse,
            "CPU [s]": self.cpu_s,
        }


def by_group(outcomes: Sequence[Outcome]) -> list[tuple[str, list[Outcome]]]:
    """The outcomes of each group, and of all together at the end where there are several."""
    groups = {
        group: [one for one in outcomes if one.group == group] for group in dict.fromkeys(o.group for o in outcomes)
    }
    return [*groups.items(), *([("all", list(outcomes))] if len(groups) > 1 else [])]

"""How probable the truth is under what the factors of a run claim: a measure that no single decision tips.

The error of a run may hang on one match that is believed or not, so that versions which are equally good differ tenfold
in a tenth of the cells. What each factor says of its own two poses does not: of odometry, matches and closures the mean
log-density of the true relative pose tells in a hundred scenes whether a change makes them truer or more honest.

`python -m iceg.evaluation.regression.likelihood -o FILE --seeds A-B [--baseline FILE]` runs random scenes and writes a
row for each; with a table of the same scenes it tells what changed, and whether that is chance.
"""

import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from frontends.simulator.random_scenes.devices import Quality
from graph import dense
from graph.elementary import log
from graph.errors import IcegError
from graph.factors import Factor
from graph.se2 import between, logmap
from iceg.evaluation.bench.tables import Row, format_markdown, write_csv
from iceg.evaluation.consistency import nees
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.paired import chance
from iceg.evaluation.regression.random_cells import random_cells
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import CONFIG
from iceg.evaluation.regression.study import of_scenes
from iceg.pipeline import run

KINDS = ("odometry", "ice", "closure")
"""Of the factors that are judged."""
FARTHEST = 100.0
"""Squared Mahalanobis distance from which on an error is wrong, and how wrong does not count."""
_DIGITS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Likelihood:
    """Of one scene.

    Attributes:
        scene: its name.
        of_kinds: mean log-density [nats] of the truth under the factors of each of `KINDS`, None where there are none.
    """

    scene: str
    of_kinds: tuple[float | None, ...]

    def row(self) -> Row:
        """For a table."""
        figures = {
            kind: None if mean is None else round(mean, _DIGITS)
            for kind, mean in zip(KINDS, self.of_kinds, strict=True)
        }
        return {"scene": self.scene, **figures}


def log_densities(factors: Sequence[Factor], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) log-density [nats] of the true relative pose under each factor, metres and radians being the units.

    Args:
        factors: between two poses each.
        truth: (n, 3) T_map_robot of the poses.
    """
    if not factors:
        return np.empty(0)
    first = [factor.i for factor in factors if factor.i is not None]
    second = [factor.j for factor in factors]
    measured = np.array([factor.T_i_j for factor in factors])
    covariances = np.array([factor.covariance for factor in factors])
    errors = logmap(between(measured, between(truth[first], truth[second])))
    diagonals = np.diagonal(dense.cholesky(covariances), axis1=-2, axis2=-1)
    squared = np.minimum(nees(errors, covariances), FARTHEST)
    return np.asarray(-0.5 * squared - log(diagonals).sum(axis=-1) - 1.5 * float(log(np.float64(2.0 * pi))))


def likelihood_of(cell: Cell) -> Likelihood:
    """Run a random scene and judge its factors."""
    recording = recording_of(cell, None)
    if recording.truth is None:
        raise EvaluationError(f"{cell.source}: the truth is not known exactly, by which factors are judged")
    result = run(recording.log, CONFIG)
    truth, factors = recording.truth[result.key_scans], result.findings.solution.factors
    densities = [log_densities([factor for factor in factors if factor.kind == kind], truth) for kind in KINDS]
    return Likelihood(scene=cell.source, of_kinds=tuple(float(one.mean()) if len(one) else None for one in densities))


def compared(before: Sequence[Likelihood], after: Sequence[Likelihood]) -> list[Row]:
    """A row for each kind: by how much the truth became more probable in the scenes of both tables.

    Raises:
        EvaluationError: there are none.
    """
    known = {one.scene: one.of_kinds for one in before}
    pairs = [(known[one.scene], one.of_kinds) for one in after if one.scene in known]
    if not pairs:
        raise EvaluationError(f"found no scene in common between tables of {len(before)} and {len(after)}")
    rows: list[Row] = []
    for k, kind in enumerate(KINDS):
        both = [(one[k], two[k]) for one, two in pairs]
        gains = np.array([two - one for one, two in both if one is not None and two is not None])
        rows.append(
            {
                "factors": kind,
                "scenes": len(gains),
                "gain [nats]": float(gains.mean()) if len(gains) else None,
                "better": int((gains > 0.0).sum()),
                "worse": int((gains < 0.0).sum()),
                "p": chance(gains),
            }
        )
    return rows


def read_likelihoods(path: Path) -> list[Likelihood]:
    """Read what `JudgeFactors` wrote.

    Raises:
        EvaluationError: the file is not there, or holds something else.
    """
    expected = ["scene", *KINDS]
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            if reader.fieldnames != expected:
                raise EvaluationError(f"{path}: found the columns {reader.fieldnames}, expected {expected}")
            return [_parsed(row, f"{path}:{number}") for number, row in enumerate(reader, start=2)]
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(f"{path}: cannot be read as a table of likelihoods: {error}") from error


def _parsed(row: dict[str, str], where: str) -> Likelihood:
    try:
        words = [row[kind] for kind in KINDS]
        means = tuple(float(word) if word != "" else None for word in words)
    except (TypeError, ValueError) as error:
        raise EvaluationError(
            f"{where}: expected a number or nothing for each of {', '.join(KINDS)}: {error}"
        ) from error
    return Likelihood(scene=row["scene"], of_kinds=means)


@dataclass(frozen=True, kw_only=True)
class JudgeFactors:
    """Run random scenes and tell how probable the truth is under what their factors claim."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE")]
    """The table, a CSV."""
    seeds: str
    """Of the scenes, such as 26000-26099."""
    odometry: tuple[Quality, ...] = ()
    """Only scenes whose robot has wheels of these qualities."""
    laser: str | None = None
    """The laser that all robots have; each the one it draws when left out."""
    baseline: Path | None = None
    """A table of the same scenes by another version."""
    workers: int = 2
    """Processes at a time."""

    def __call__(self) -> None:
        """Run, write, compare.

        Raises:
            IcegError: no such scenes, laser or table, or fewer processes than one.
        """
        baseline = None if self.baseline is None else read_likelihoods(self.baseline)
        cells = random_cells(self.seeds, self.odometry, self.laser)
        found = of_scenes(likelihood_of, cells, self.workers)
        write_csv([one.row() for one in found], self.output)
        if baseline is not None:
            sys.stdout.write(format_markdown(compared(baseline, found)) + "\n")


def main() -> None:
    """What the command line asks for; an error is one line."""
    asked = tyro.cli(JudgeFactors, prog="python -m iceg.evaluation.regression.likelihood")
    try:
        asked()
    except IcegError as error:
        sys.exit(f"likelihood: {error}")


if __name__ == "__main__":
    main()

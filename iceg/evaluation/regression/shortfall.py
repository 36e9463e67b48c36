"""Whether matches fall short of the truth along the way, in the mean of those that claim to know it equally well.

A match that errs by chance does no harm that its covariance does not tell. One that errs to the same side with every
step bends the map, has the odometry calibrated wrong, and no covariance says so. Phantom walls that go along with the
robot, walls that turn towards the beams, chords in place of arcs: each had matches understate the way by 1 to 3 %, and
showed here before anywhere else, some of them with a laser that does not err at all.

`python -m iceg.evaluation.regression.shortfall --seeds A-B [--laser NAME [--perfect]]` runs random scenes that have
odometry, without loop closures and finish, and prints a row for each kind of claim.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from frontends.simulator.laser import Laser
from frontends.simulator.random_scenes.scene import drawn_odometry, simulate_random
from graph.errors import IcegError
from graph.factors import Factor
from graph.se2 import between, logmap
from iceg.evaluation.bench.tables import Row, format_markdown
from iceg.evaluation.consistency import nees
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.random_cells import named_laser, seed_range
from iceg.evaluation.regression.runner import CONFIG
from iceg.evaluation.regression.study import of_scenes
from iceg.pipeline import run

CLAIMS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.5)
"""Standard deviations [m] between which matches are counted together."""
_LEAST_STEP = 0.05
"""Steps no longer than this [m] tell nothing of the way."""
_WRONG = 60.0
"""Squared Mahalanobis distance from which on a match is a wrong one, and none that falls short."""
_FEWEST = 10
"""So many matches make a row."""


class AlongTrack(NamedTuple):
    """(n,) each, of matches from key scan to key scan.

    Attributes:
        errors: truth less match along the robot [m]: positive where the match falls short.
        claimed: standard deviations of these by the matches [m].
        steps: how far the robot went [m].
    """

    errors: NDArray[np.float64]
    claimed: NDArray[np.float64]
    steps: NDArray[np.float64]


def along_track_errors(factors: Sequence[Factor], truth: NDArray[np.float64]) -> AlongTrack:
    """Along-track errors of the matches of steps ahead, wrong ones left out.

    Args:
        factors: of a run, of all kinds.
        truth: (n, 3) T_map_robot of its key poses.
    """
    chosen = [factor for factor in factors if factor.kind == "ice" and factor.i is not None]
    if not chosen:
        return AlongTrack(np.empty(0), np.empty(0), np.empty(0))
    first = [factor.i for factor in chosen if factor.i is not None]
    steps = between(truth[first], truth[[factor.j for factor in chosen]])
    errors = logmap(between(np.array([factor.T_i_j for factor in chosen]), steps))
    covariances = np.array([factor.covariance for factor in chosen])
    counts = (steps[:, 0] > _LEAST_STEP) & (nees(errors, covariances) < _WRONG)
    return AlongTrack(errors[counts, 0], np.sqrt(covariances[counts, 0, 0]), steps[counts, 0])


def by_claim(alongs: Sequence[AlongTrack]) -> list[Row]:
    """A row for each kind of claim that enough matches of all scenes together make."""
    errors, claimed, steps = (np.concatenate(parts) for parts in zip(*alongs, strict=True))
    rows: list[Row] = []
    for low, high in pairwise(CLAIMS):
        chosen = (claimed >= low) & (claimed < high)
        n = int(chosen.sum())
        if n < _FEWEST:
            continue
        off, share = errors[chosen], errors[chosen].sum() / steps[chosen].sum()
        rows.append(
            {
                "claimed [mm]": f"{1e3 * low:g} to {1e3 * high:g}",
                "matches": n,
                "short by [mm]": 1e3 * float(off.mean()),
                "±": 1e3 * float(off.std()) / sqrt(n),
                "share of the way [%]": 100.0 * float(share),
                "rms of the error / claimed": sqrt(float(np.mean((off / claimed[chosen]) ** 2))),
            }
        )
    return rows


def perfect(laser: Laser) -> Laser:
    """The same laser, but its ranges do not err, and no beam hits two things at once."""
    return replace(laser, range_std=0.0, range_std_per_metre=0.0, mixed_share=0.0, quantisation=0.0, beam_width=0.0)


def shortfall_of(seed: int, laser: Laser | None) -> AlongTrack:
    """Run a random scene with such a laser, its own for None, and see what its matches are off along the way."""
    simulation = simulate_random(seed, laser=laser)
    alone = replace(CONFIG, loops=replace(CONFIG.loops, enabled=False), finish=replace(CONFIG.finish, enabled=False))
    result = run(simulation.log, alone)
    return along_track_errors(result.findings.solution.factors, simulation.truth[result.key_scans])


@dataclass(frozen=True, kw_only=True)
class JudgeMatches:
    """Run random scenes and tell by how much their matches fall short of the truth along the way."""

    seeds: str
    """Of the scenes, such as 9100-9160; those without odometry are left out."""
    laser: str | None = None
    """The laser that all robots have; each the one it draws when left out."""
    perfect: bool = False
    """Its ranges do not err: what is left is the matcher's own."""
    workers: int = 2
    """Processes at a time."""

    def __call__(self) -> None:
        """Run and print.

        Raises:
            IcegError: no such scenes or laser, one that is to be perfect and not named, or no process.
        """
        if self.perfect and self.laser is None:
            raise EvaluationError("--perfect needs a laser: --laser NAME")
        laser = None if self.laser is None else named_laser(self.laser)
        if laser is not None and self.perfect:
            laser = perfect(laser)
        seeds = [seed for seed in seed_range(self.seeds) if drawn_odometry(seed) != "none"]
        if not seeds:
            raise EvaluationError(f"found no scene with odometry among seeds {self.seeds}")
        rows = by_claim(of_scenes(partial(shortfall_of, laser=laser), seeds, self.workers))
        if not rows:
            raise EvaluationError(
                f"found too few matches in seeds {self.seeds}, expected {_FEWEST} of one claim at least"
            )
        sys.stdout.write(format_markdown(rows) + "\n")


def main() -> None:
    """What the command line asks for; an error is one line."""
    asked = tyro.cli(JudgeMatches, prog="python -m iceg.evaluation.regression.shortfall")
    try:
        asked()
    except IcegError as error:
        sys.exit(f"shortfall: {error}")


if __name__ == "__main__":
    main()

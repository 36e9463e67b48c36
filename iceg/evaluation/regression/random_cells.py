"""Cells of random scenes by their seeds: samples larger than the table's own, and of one kind of robot."""

import re
from collections.abc import Sequence

from frontends.simulator.laser import Laser
from frontends.simulator.lasers import LASERS
from frontends.simulator.random_scenes.devices import Quality
from frontends.simulator.random_scenes.scene import drawn_odometry
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.cells import NO_FAULT, Cell

_SEEDS = re.compile(r"(\d{1,18})(?:-(\d{1,18}))?", re.ASCII)
_MOST = 10_000
"""Scenes of one range: more take days."""


def random_cells(
    seeds: str, odometry: Sequence[Quality] = (), laser: str | None = None, fault: str = NO_FAULT
) -> list[Cell]:
    """The random scenes of a range of seeds.

    Args:
        seeds: the first and the last, such as "5000-5899", or one alone.
        odometry: only scenes whose robot has wheels of these qualities; of any when left out.
        laser: name of one of `frontends.simulator.lasers.LASERS` that all robots have; each the one it draws when left
            out.
        fault: one of `degradation.DEGRADATIONS` that all logs have.

    Returns:
        A cell for each, without noise.

    Raises:
        EvaluationError: no such range, no such scene in it, or no such laser or fault.
    """
    if fault != NO_FAULT and fault not in DEGRADATIONS:
        raise EvaluationError(f"found fault '{fault}', expected one of {', '.join(DEGRADATIONS)}")
    if laser is not None:
        named_laser(laser)
    ending = "" if laser is None else f" {laser}"
    found = [
        Cell(group="random", source=f"random:{seed}{ending}", fault=fault)
        for seed in seed_range(seeds)
        if not odometry or drawn_odometry(seed) in odometry
    ]
    if not found:
        raise EvaluationError(f"found no scene with odometry {', '.join(odometry)} among seeds {seeds}")
    return found


def named_laser(name: str) -> Laser:
    """The laser of that name.

    Raises:
        EvaluationError: there is none.
    """
    if name not in LASERS:
        raise EvaluationError(f"found laser '{name}', expected one of {', '.join(LASERS)}")
    return LASERS[name]()


def in_words(seeds: str, odometry: Sequence[Quality] = (), laser: str | None = None, fault: str = NO_FAULT) -> str:
    """What such a sample is, for a table: "random scenes 5000-5899, odometry none, kinect"."""
    wheels = [f"odometry {' or '.join(odometry)}"] if odometry else []
    return ", ".join([f"random scenes {seeds}", *wheels, *([laser] if laser else []), *([fault] * (fault != NO_FAULT))])


def seed_range(seeds: str) -> range:
    """The seeds from the first to the last of "5000-5899", or one alone.

    Raises:
        EvaluationError: no such range.
    """
    match = _SEEDS.fullmatch(seeds)
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, -1)
    if not 0 <= last - first < _MOST:
        raise EvaluationError(
            f"found seeds '{seeds}', expected one or a range of no more than {_MOST}, such as 5000-5899"
        )
    return range(first, last + 1)

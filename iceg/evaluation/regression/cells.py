"""What the regression table is made of: every cell is one recording, perhaps with a fault, perhaps with noise."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from frontends.simulator.random_scenes.scene import drawn_odometry
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression.lasers import LASERS

Group = Literal["worlds", "logs", "faults", "simulated", "carried", "random", "degraded"]
"""Recordings with exact truth from another simulator; public logs as they are; these and the worlds with one
fault each; own simulations, and the same with a robot that somebody carries; scenes drawn at random, and others of them
with one fault each."""
GROUPS: tuple[Group, ...] = get_args(Group)

NO_FAULT = "none"
LOGS = ("office", "intel", "mit-csail", "aces", "mrpt-simul")
"""The embedded log and the public ones."""
SEEDS = (1, 2, 3, 4)
"""Of the millimetre of noise, where that decides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One run of the table.

    Attributes:
        group: what it is a sample of.
        source: the recording: a name of `LOGS`, of a file in `worlds/`, scene and laser of a simulation, or
            `random:SEED`, with the name of another laser than it draws behind it.
        fault: of `DEGRADATIONS`, or "none".
        seed: of a millimetre of noise on the ranges; 0 for none.
        is_short: whether it belongs to the short form.
    """

    group: Group
    source: str
    fault: str = NO_FAULT
    seed: int = 0
    is_short: bool = False

    @property
    def family(self) -> str:
        """Cells that differ by their noise alone are no independent samples."""
        return f"{self.source}, {self.fault}"

    @property
    def is_simulated(self) -> bool:
        """Whether it needs no folder of recordings."""
        return self.group in {"simulated", "carried", "random", "degraded"}

    @property
    def name(self) -> str:
        """Of the cell, unique in the table."""
        return f"{self.family}, {self.seed}"


_SCENES = (
    *("aisles", "alike", "arena", "building", "campus", "corridor", "home"),
    *("mall", "office", "pillars", "ring", "rooms", "supermarket", "park"),
)
_NEEDS_8_M = frozenset({"campus", "mall", "park", "pillars"})
"""Where a shorter laser sees next to nothing."""
_CARRIED = (("alike", "lms30"), ("building", "rplidar"), ("home", "lds"), ("office", "utm"), ("pillars", "utm"))
_CLOSE = (
    ("mit-csail", "every 10th scan"),
    ("mit-csail", "half the view"),
    ("mit-csail", "noise 5 cm, 10 % outliers"),
    ("mit-csail", "laser stuck 2"),
    ("mit-csail", "carried"),
    ("aces", "90° view"),
    ("aces", "crowd of 4"),
    ("aces", "half the view + ten jumps 30°"),
    ("mrpt-simul", "4 m"),
    ("mrpt-simul", "carried"),
    ("office", "odometry dies + covered"),
    ("office", "odometry dies + crowd of 4"),
)
"""Where a millimetre decides whether a run is ruined …"""
_CLOSE_SHORT = frozenset({("mit-csail", "half the view"), ("aces", "90° view"), ("aces", "crowd of 4")})
"""… and those of the short form."""
_SHORT_EVERY = 2
"""In the short form every other fault is tried on one log, another one each time: a tenth of all."""

_WORLD_FAULTS = ("carried", "noise 3 cm", "every 2nd scan")
"""One of them for each recorded world, in turn."""
_SHORT_LASERS = (0, 2, 3)
"""So far on from its first are the lasers with which a scene is simulated in the short form."""
_RANDOM, _RANDOM_SHORT = 192, 24
"""So many scenes are drawn, and so many of them in the short form: as many of each kind of place."""
_DEGRADED = range(200, 236)
"""Seeds of scenes that come with each of these faults, in the short form with one, if their robots have wheels."""
_OF_SCENES = ("carried", "gap", "odometry noise 50 %", "laser stuck 5", "crowd of 4", "half the view")


def cells(data: Path | None) -> list[Cell]:
    """All there is.

    Args:
        data: folder of the public logs and of `worlds/`; without it the embedded log and the simulations are left.
    """
    return [
        *_worlds(data),
        *_logs(data),
        *_faults(data),
        *_world_faults(data),
        *_simulated(),
        *_carried(),
        *_random(),
        *_degraded(),
    ]


def chosen(data: Path | None, groups: Sequence[Group] = (), *, short: bool = True) -> list[Cell]:
    """The cells of some groups, of all when left out, in the short form or the long.

    Raises:
        EvaluationError: there are none.
    """
    found = [cell for cell in cells(data) if (cell.is_short or not short) and (not groups or cell.group in groups)]
    if not found:
        raise EvaluationError(f"found no recording for {', '.join(groups)} in {data}, expected the public logs there")
    return found


def close_cells(data: Path | None, seeds: Sequence[int]) -> list[Cell]:
    """The faults where a millimetre decides, with other seeds of it than those of the table.

    Versions are held against the table, so that its own seeds flatter whichever was kept.

    Args:
        data: folder of the public logs; without it the embedded log is left.
        seeds: of the noise.
    """
    present = _present(data)
    close = [(source, fault) for source, fault in _CLOSE if source in present]
    return [Cell(group="faults", source=source, fault=fault, seed=seed) for source, fault in close for seed in seeds]


def _worlds(data: Path | None) -> Iterator[Cell]:
    for source in _world_names(data):
        yield Cell(group="worlds", source=source, is_short=True)
        yield from (Cell(group="worlds", source=source, seed=seed) for seed in SEEDS[:2])


def _world_names(data: Path | None) -> list[str]:
    return sorted(path.name.partition(".")[0] for path in (data / "worlds").glob("*.clf.gz")) if data else []


def _world_faults(data: Path | None) -> Iterator[Cell]:
    for world, source in enumerate(_world_names(data)):
        for index, fault in enumerate(_WORLD_FAULTS):
            yield Cell(group="faults", source=source, fault=fault, is_short=world % len(_WORLD_FAULTS) == index)


def _present(data: Path | None) -> list[str]:
    return [name for name in LOGS if name == "office" or (data is not None and (data / f"{name}.clf.gz").exists())]


def _logs(data: Path | None) -> Iterator[Cell]:
    for source in _present(data):
        yield Cell(group="logs", source=source, is_short=True)
        yield from (Cell(group="logs", source=source, seed=seed) for seed in SEEDS[:2])


def _faults(data: Path | None) -> Iterator[Cell]:
    for log, source in enumerate(LOGS):
        if source not in _present(data):
            continue
        for index, fault in enumerate(DEGRADATIONS):
            in_short = index % _SHORT_EVERY == 0 and index // _SHORT_EVERY % len(LOGS) == log
            is_close, is_short = (source, fault) in _CLOSE, in_short or (source, fault) in _CLOSE_SHORT
            yield Cell(group="faults", source=source, fault=fault, is_short=is_short)
            for seed in SEEDS if is_close else ():
                short = (source, fault) in _CLOSE_SHORT
                yield Cell(group="faults", source=source, fault=fault, seed=seed, is_short=short)


def _simulated() -> Iterator[Cell]:
    for index, scene in enumerate(_SCENES):
        names = [name for name, laser in LASERS.items() if scene not in _NEEDS_8_M or laser.geometry.range_max >= 8.0]
        short = {names[(index + step) % len(names)] for step in _SHORT_LASERS}
        for name in names:
            yield Cell(group="simulated", source=f"{scene} {name}", is_short=name in short)


def _carried() -> Iterator[Cell]:
    for scene, laser in _CARRIED:
        yield Cell(group="carried", source=f"{scene} {laser}", fault="carried", is_short=True)
        for seed in SEEDS[:2]:
            yield Cell(group="carried", source=f"{scene} {laser}", fault="carried", seed=seed)


def _random() -> Iterator[Cell]:
    for seed in range(_RANDOM):
        yield Cell(group="random", source=f"random:{seed}", is_short=seed < _RANDOM_SHORT)


def _degraded() -> Iterator[Cell]:
    with_wheels = [seed for seed in _DEGRADED if drawn_odometry(seed) != "none"]
    for place, seed in enumerate(with_wheels):
        for index, fault in enumerate(_OF_SCENES):
            yield Cell(
                group="degraded", source=f"random:{seed}", fault=fault, is_short=place % len(_OF_SCENES) == index
            )

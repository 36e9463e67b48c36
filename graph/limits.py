"""How much of anything is taken in: one table of limits, which the environment can raise.

Numbers beyond them are refused where they come in and sizes before anything is allocated for them, so that no file
fills the memory or keeps the program busy for ever. `ICEG_LIMITS="scans=2e6,log_bytes=8e9"` in the environment changes
some of them.
"""

import dataclasses
import math
import os
from dataclasses import dataclass
from typing import Any

from graph.errors import IcegError

VARIABLE = "ICEG_LIMITS"
"""The environment variable that changes limits: `name=value`, parted by commas."""


class LimitError(IcegError):
    """More of something than is allowed; or a table of limits that is none."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The most of everything that is taken in. The defaults keep every reader below 2 GB."""

    coordinate: float = 1e7
    """Of a pose, a wall or a mounting, from the origin [m]: as far as map projections reach. Float64 knows a micrometre
    there."""
    heading: float = 1e6
    """Of a pose as recorded [rad], which may count all turns since the start."""
    gyro: float = 1e9
    """Of a turn rate integrated over a log, in whatever unit it is recorded: counts of a converter among them."""
    stamp: float = 1e19
    """Of a message [s]; some loggers write nanoseconds."""
    odometry_step: float = 1000.0
    """Between two scans by odometry [m]: farther is no motion of a robot but a number gone wrong."""
    range: float = 10_000.0
    """A reading that is a return, or the limit of a laser [m]."""
    beams: int = 100_000
    """Of one scan."""
    scans: int = 1_000_000
    """Of one log."""
    readings: int = 100_000_000
    """Of all scans of a log together; 10 hours of 270 beams at 10 Hz, some 0.4 GB."""
    lines: int = 5_000_000
    """Of a text log."""
    line_bytes: int = 16_000_000
    """Of one line of a text log."""
    log_bytes: int = 2_000_000_000
    """Of a log, unpacked."""
    settings_bytes: int = 1_000_000
    """Of a file of settings, of an experiment, of a map's description or a summary."""
    drawing_bytes: int = 8_000_000
    """Of a `.world` file or a drawing (SVG)."""
    table_bytes: int = 100_000_000
    """Of a table, a trajectory, a pose graph or a feature map."""
    rows: int = 1_000_000
    """Of such a file."""
    image_bytes: int = 250_000_000
    """Of a floor plan or a map's image."""
    pixels: int = 16_000_000
    """Of a floor plan."""
    walls: int = 200_000
    """Straight pieces of wall in a simulated world."""
    includes: int = 100
    """Files that a `.world` file includes, those that they include counted as well."""
    people: int = 1000
    """Who walk in a simulated world."""
    simulated_time: float = 100_000.0
    """Of a simulated drive [s]."""
    simulated_scans: int = 200_000
    """Of a simulated drive."""
    simulated_beams: int = 100_000_000
    """Of all scans of a simulated drive."""
    simulated_walls: int = 2_000_000_000
    """Scans of a simulated drive times pieces of wall."""
    simulated_people: int = 3_000_000
    """Scans of a simulated drive times people."""
    simulated_waypoints: int = 100_000
    """Of a simulated drive, those of all laps together."""
    grid_cells: int = 150_000_000
    """Of an occupancy grid; at this size it and its pictures take 2 GB."""
    bench_runs: int = 10_000
    """Of one experiment, or of a study of simulated runs."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not 0 < value < math.inf:
                raise LimitError(f"the limit {field.name} is {value}, expected a positive number")


def check_limit(found: float, name: str, what: str) -> None:
    """Refuse more of something than the table allows.

    Args:
        found: how much there is, or would be.
        name: of the limit, a field of `Limits`.
        what: a sentence's beginning with the place and what was found, such as "plan.png: found 10⁹ pixels".

    Raises:
        LimitError: with the limit and how to raise it.
    """
    most = getattr(LIMITS, name)
    if not found <= most:
        raise LimitError(f"{what}, expected {at_most(name)}")


def at_most(name: str) -> str:
    """For messages: a limit and how to raise it."""
    return f"at most {getattr(LIMITS, name):.12g} ({VARIABLE}={name}=… in the environment raises this limit)"


def parse_limits(text: str) -> Limits:
    """The table of limits with those changed that a text names.

    Args:
        text: `name=value`, parted by commas; empty for the defaults.

    Raises:
        LimitError: a name that is no limit, or a value that is no positive number.
    """
    kinds = {name: int if isinstance(most, int) else float for name, most in vars(Limits()).items()}
    changed: dict[str, Any] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (part.strip() for part in entry.partition("="))
        if name not in kinds:
            raise LimitError(f"{VARIABLE}: found '{entry[:60]}', expected NAME=VALUE with one of {', '.join(kinds)}")
        try:
            changed[name] = kinds[name](float(value))
        except (ValueError, OverflowError) as err:
            raise LimitError(f"{VARIABLE}: found '{entry[:60]}', expected a positive number for {name}") from err
    return Limits(**changed)


LIMITS = parse_limits(os.environ.get(VARIABLE, ""))
"""The limits of this process, as its environment said when it began."""

"""What the stamps and the odometry of a log are worth."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError
from graph.limits import LIMITS, at_most
from graph.se2 import wrap_angle

_STILL = 1e-6  # m or rad: odometry that moves less over a whole log does not move
_CHANGED = 0.1  # m: median change of the readings that the robot's standing still does not explain
_SAMPLES = 32
"""Scans compared, spread over the log."""
_FASTEST = 30.0
"""Mean speed of odometry in metres [m/s], at most: robots drive at up to 1.3, a slow one in millimetres at 100."""
_TURNS_FASTEST, _TURNS_FAST = 10.0, 1.0
"""Mean turn rates [rad/s] that no robot has, and that none has whose steps are wide as well: recorded logs reach 0.5,
the same logs in degrees 2 to 16."""
_TURN, _WIDE_TURN = 0.1, 1.0
"""Steps of the heading that count as turns, and that are wide [rad]."""
_WIDE, _MOST_WIDE = 0.15, 0.5
"""Share of the turns that are wide: at most 0.06 in recorded logs, from 0.2 on in the same logs in degrees; and the
share that tells where there are no stamps, and scans may lie far apart."""
_SLOWEST = 20.0
"""Lasers scan several times a second, and recorders keep a scan in ten at least: scans that lie so far apart [s] in the
median are stamped in another unit, milliseconds if not finer."""
_LEAST_TURNS = 10
"""Fewest turns that tell."""


def choose_stamps(both: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[str]]:
    """Pick the message's own stamps, or the logger's where those are too coarse to tell scans apart.

    Args:
        both: (n, 2) stamp of the message and of the logger [s].

    Returns:
        (n,) stamps [s] as recorded, and what a person should know about them.
    """
    own, logger = both[:, 0], both[:, 1]
    distinct, distinct_logger = len(np.unique(own)), len(np.unique(logger))
    stamps, warnings = own, []
    if distinct_logger >= 2 * distinct:
        stamps = logger
        warnings.append(f"the stamps have only {distinct} values for {len(own)} scans: the logger's stamps are taken")
    elif len(own) > 1 and distinct == 1:
        warnings.append(f"all stamps are {own[0]:g} s: times and speeds mean nothing, file order is the order of time")
    warnings += judge_stamps(stamps)
    back = int(np.count_nonzero(np.diff(stamps) < 0))
    if back:
        warnings.append(f"the stamps step back {back} times: file order is taken as the order of time")
    return np.ascontiguousarray(stamps), warnings


def judge_stamps(stamps: NDArray[np.float64]) -> list[str]:
    """What to say of stamps that seem to be in another unit than seconds.

    Args:
        stamps: (n,) as recorded [s].
    """
    step = float(np.median(np.abs(np.diff(stamps)))) if len(stamps) > 1 else 0.0
    if step < _SLOWEST:
        return []
    unit = "nanoseconds" if step > 1e6 * _SLOWEST else "microseconds" if step > 1e3 * _SLOWEST else "milliseconds"
    return [f"the scans lie {step:.3g} s apart by their stamps: seconds expected, are they in {unit}?"]


def check_steps(path: Path, odometry: NDArray[np.float64]) -> None:
    """Refuse odometry that jumps farther from one scan to the next than anything drives.

    Args:
        path: the log, for the message.
        odometry: (n, 3) T_odom_robot.

    Raises:
        LogError: naming the scan, what was found and what was expected.
    """
    steps = np.hypot(*np.diff(odometry[:, :2], axis=0).T)
    longest = int(np.argmax(steps)) if len(steps) else 0
    if len(steps) and steps[longest] > LIMITS.odometry_step:
        raise LogError(
            f"{path}: found odometry that jumps by {steps[longest]:.6g} m from scan {longest} to the next, expected "
            f"{at_most('odometry_step')}"
        )


def judge_odometry(
    odometry: NDArray[np.float64], ranges: NDArray[np.float32], stamps: NDArray[np.float64] | None
) -> tuple[bool, list[str]]:
    """Tell whether recorded odometry says anything, and what a person should know about it.

    It does not when it stays the same all through the log although the scans change, or is zero throughout.

    Args:
        odometry: (n, 3) T_odom_robot.
        ranges: (n, n_beams) [m], NaN where nothing came back.
        stamps: (n,) [s]; None where the log has none.
    """
    if len(odometry) < 2:
        return True, []
    if float(np.ptp(odometry, axis=0).max()) > _STILL:
        return True, _suspect_units(odometry, stamps)
    if not odometry.any():
        return False, ["there is no odometry (zero throughout)"]
    if _scans_change(ranges):
        return False, ["the odometry stays the same while the scans change: it is taken as missing"]
    return True, []


def _suspect_units(odometry: NDArray[np.float64], stamps: NDArray[np.float64] | None) -> list[str]:
    """What to say of odometry that seems to be in millimetres or degrees."""
    duration = 0.0 if stamps is None else float(np.ptp(stamps))
    steps = np.diff(odometry, axis=0)
    turns = np.abs(wrap_angle(steps[:, 2]))
    warnings = []
    speed = float(np.hypot(steps[:, 0], steps[:, 1]).sum()) / duration if duration > 0.0 else 0.0
    if speed > _FASTEST:
        warnings.append(
            f"found odometry that goes {speed:.3g} m/s on average: metres and seconds expected, is it in millimetres?"
        )
    rate = float(turns.sum()) / duration if duration > 0.0 else 0.0
    wide = turns[turns > _TURN] > _WIDE_TURN
    share = float(wide.mean()) if len(wide) >= _LEAST_TURNS else 0.0
    if rate > _TURNS_FASTEST or (rate > _TURNS_FAST and share > _WIDE):
        warnings.append(
            f"found odometry that turns {rate:.3g} rad/s on average: radians expected, is the heading in degrees?"
        )
    elif duration == 0.0 and share > _MOST_WIDE:
        warnings.append(
            f"found odometry of which {100.0 * share:.0f} % of the turns between two scans are more than 1 rad: "
            "radians expected, is the heading in degrees?"
        )
    return warnings


def _scans_change(ranges: NDArray[np.float32]) -> bool:
    """Whether some scan differs from the first by more than noise and passers-by explain."""
    for index in np.linspace(0, len(ranges) - 1, _SAMPLES).astype(int):
        difference = np.abs(ranges[index] - ranges[0])
        difference = difference[np.isfinite(difference)]
        if len(difference) and float(np.median(difference)) > _CHANGED:
            return True
    return False

"""The turn rates of an IMU, brought to the times of the scans."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.bags.records import Laser, Rows
from frontends.bags.times import ScanTimes, covered, pose_times
from graph.limits import LIMITS

_WHOLE = 0.9
"""Share of the scans that an IMU must tell of: behind its last message nobody knows how the robot turns."""


@dataclass(frozen=True, kw_only=True)
class GyroChoice:
    """The IMU of a bag that tells most, if any does.

    Attributes:
        turned: (n, 3) its angular velocity integrated from the first scan to each, as recorded; None where it is not
            taken.
        reason: which one it is, and what becomes of it, for a person.
        warnings: what is odd about it.
    """

    turned: NDArray[np.float64] | None
    reason: str
    warnings: tuple[str, ...] = ()


def choose_gyro(
    imus: Mapping[Laser, Rows], times: ScanTimes, stamps: NDArray[np.float64], *, has_odometry: bool
) -> GyroChoice | None:
    """Pick the IMU that tells of most scans, and of these the one with most messages.

    Args:
        imus: turn rates and accelerations by topic and frame.
        times: of the scans, as their messages state them.
        stamps: (n,) the times its turns are wanted at [s].
        has_odometry: whether the bag holds odometry, beside which turn rates are not asked.

    Returns:
        None where there is no IMU.
    """
    found = [_at_scans(imu, rows, times, stamps) for imu, rows in sorted(imus.items())]
    _, best = max(found, key=lambda each: each[0], default=((0.0, 0), None))
    if best is None or best.turned is None:
        return best
    if not has_odometry:
        return replace(best, reason=f"{best.reason}: odometry of the heading, if the scans confirm it")
    return GyroChoice(turned=best.turned, reason=f"not used, as there is odometry: {best.reason}")


def _at_scans(
    imu: Laser, rows: Rows, times: ScanTimes, stamps: NDArray[np.float64]
) -> tuple[tuple[float, int], GyroChoice]:
    """One IMU, after how much it tells."""
    measured, warnings = pose_times(rows.stamps, rows.recorded, times)
    order = np.argsort(measured, kind="stable")
    measured, rates = measured[order], rows.values[order, :3]
    share = float(covered(measured, stamps).mean())
    worth, name = (share, len(measured)), f"{imu.topic} (Imu), {len(measured)} messages"
    if not rates.any():
        return (0.0, 0), GyroChoice(turned=None, reason=f"not used: {name}: all turn rates are zero")
    if share < _WHOLE:
        return worth, GyroChoice(
            turned=None, reason=f"not used: {name}, which tell of {100 * share:.0f} % of the scans"
        )
    turned = turned_at(measured, rates, stamps)
    if not float(np.abs(turned).max()) <= LIMITS.gyro:
        return worth, GyroChoice(turned=None, reason=f"not used: {name}, whose turn rates are beyond all reason")
    said = tuple(f"{imu.topic}: {warning}" for warning in warnings)
    return worth, GyroChoice(turned=turned, reason=name, warnings=said)


def turned_at(times: NDArray[np.float64], rates: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integrate turn rates by the trapezoidal rule.

    Args:
        times: (m,) of the rates, in order [s].
        rates: (m, k) in any unit per second; before the first and behind the last they stay as they are.
        at: (n,) the times up to which to integrate, from the first of them [s].

    Returns:
        (n, k) in that unit.
    """
    places = np.concatenate([[min(times[0], at.min())], times, [max(times[-1], at.max())]])
    held = np.vstack([rates[:1], rates, rates[-1:]])
    steps = 0.5 * (held[1:] + held[:-1]) * np.diff(places)[:, None]
    turned = np.vstack([np.zeros((1, rates.shape[1])), np.cumsum(steps, axis=0)])
    found = np.column_stack([_integral(places, held[:, k], turned[:, k], at) for k in range(rates.shape[1])])
    return found - found[:1]


def _integral(
    places: NDArray[np.float64], rates: NDArray[np.float64], integrals: NDArray[np.float64], at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n,) of a piecewise linear rate: quadratic between two places."""
    before = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(places) - 2)
    into = at - places[before]
    width = places[before + 1] - places[before]
    slope = np.where(width > 0.0, (rates[before + 1] - rates[before]) / np.where(width > 0.0, width, 1.0), 0.0)
    return integrals[before] + into * (rates[before] + 0.5 * slope * into)

"""How fast a robot usually goes while it turns as it does.

Who turns goes slower than who goes straight on, and a laser beside or ahead of the axle goes aside meanwhile. Both are
told by the steps that matches see: their velocities are regressed on the turns of the scans on the way.
"""

import numpy as np

from graph import dense
from graph.arrays import Bools, Floats, Ints

_WIDTHS = (0.125, 0.25, 0.5, 1.0, 2.0)
"""Rates of turning at which a robot may be half as fast as straight on, in parts of their root mean square: the one
that explains the steps best is taken."""
_HELD = 0.2
"""The coefficients of the turns are held at zero as by so much of a step, lest they explain noise where next to nothing
is seen."""
_LEAST_RATE = 1e-4
"""The root mean square is never taken to be smaller [rad per interval]."""


def usual_velocities(velocities: Floats, turns: Floats, pauses: Floats, starts: Ints, are_observed: Bools) -> Floats:
    """What is usual on every step, by the turns of its scans.

    With ω the rate of turning from scan to scan and w one of a few widths, the velocity along and across is taken for
    a + b · mean(1 / (1 + (ω/w)²)) + c · mean(ω), by least squares over the steps that are seen, each by its time; b
    and c are held at zero as by a part of a step. A turn is as fast as all of them are in the mean.

    Args:
        velocities: (n, 3) of the steps along, across and of their turns, per usual interval [m or rad].
        turns: (m,) from scan to scan, up to the end of the last step [rad], …
        pauses: (m,) … and how many usual intervals each takes.
        starts: (n,) the scans at which the steps begin.
        are_observed: (n,) which of them matches see.

    Returns:
        (n, 3) velocities; zero where no step is seen.
    """
    if not are_observed.any():
        return np.zeros_like(velocities)
    durations = np.add.reduceat(pauses, starts)
    rates = turns / pauses
    rate = max(float(np.sqrt((pauses * rates**2).sum() / durations.sum())), _LEAST_RATE)
    turning = np.add.reduceat(turns, starts) / (rate * durations)
    weights = durations[are_observed] / durations[are_observed].mean()
    found = []
    for width in _WIDTHS:
        straight = np.add.reduceat(pauses / (1.0 + (rates / (rate * width)) ** 2), starts) / durations
        design = np.column_stack([np.ones_like(durations), straight, turning])
        expected = _regressed(design, velocities[:, :2], weights, are_observed)
        left = (expected - velocities[:, :2])[are_observed]
        found.append((float((weights * left[:, 0] ** 2).sum()), expected))
    _, along_and_across = min(found, key=lambda each: each[0])
    mean_turn = (weights * velocities[are_observed, 2]).sum() / weights.sum()
    return np.column_stack([along_and_across, np.full_like(durations, mean_turn)])


def _regressed(design: Floats, values: Floats, weights: Floats, seen: Bools) -> Floats:
    """(n, k) the values that (n, p) features foretell, of which the first is constant; learned from those seen."""
    weighted = design[seen] * weights[:, None]
    information = dense.matmul(weighted.T, design[seen]) + np.diag([0.0, *np.full(design.shape[1] - 1, _HELD)])
    return dense.matmul(design, dense.solve(information, dense.matmul(weighted.T, values[seen])))

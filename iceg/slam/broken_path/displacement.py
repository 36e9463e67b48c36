"""How far what follows a break may be displaced: the robot may have been carried, or found again at a wrong place.

The covariances of a run hold if neither is so. If either is, which has the probability p, the robot may be anywhere: at
any place of the path, as far as is known, heading anywhere. By the law of total variance either coordinate varies by p
times half the mean square distance of two places of the path more, and the heading by p π²/3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graph.arrays import Floats
from iceg.slam.broken_path.path_break import Break

_ANY_HEADING = np.pi**2 / 3.0
"""Variance of a heading that may be any [rad²]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Displacement:
    """Of all that follows a break.

    Attributes:
        key: the first key pose that is displaced.
        variances: (3,) of x, y [m²] and heading [rad²] in the tangent space at it.
    """

    key: int
    variances: Floats


def variance_of_place(poses: Floats) -> float:
    """How far two places along a path of (k, 3) key poses lie apart along either axis, the variance [m²]."""
    return float(poses[:, :2].var(axis=0).sum())


def displacements(breaks: Sequence[Break], poses: Floats) -> tuple[Displacement, ...]:
    """At each break that may be wrong, along a path of (k, 3) key poses."""
    apart = variance_of_place(poses)
    return tuple(
        Displacement(key=found.key, variances=found.probability * np.array([apart, apart, _ANY_HEADING]))
        for found in breaks
        if found.probability > 0.0
    )


def displaced_covariances(found: Sequence[Displacement], n_keys: int) -> Floats:
    """(n_keys, 3, 3) what the covariances of key poses relative to the first grow by."""
    grown = np.zeros((n_keys, 3, 3))
    for each in found:
        grown[each.key :] += np.diag(each.variances)
    return grown

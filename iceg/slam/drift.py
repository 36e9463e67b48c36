"""How uncertain the path is since the last loop closure: how wide to search for the next, and what to believe."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from graph.arrays import Floats
from graph.dense import congruence, inv
from graph.growing_rows import GrowingRows
from graph.se2 import adjoint, between

Covariances = tuple[Floats, ...]


class Spread(NamedTuple):
    """How uncertain a pose is relative to those before it.

    Attributes:
        last: the key pose of the last closure; relative to those before it is as uncertain as relative to it.
        deviations: (n, 2) of position [m] and heading [rad], relative to `last` and those that follow it.
    """

    last: int
    deviations: Floats

    def since(self, key_old: int) -> Floats:
        """(2,) relative to one of those before it."""
        return np.asarray(self.deviations[max(key_old, self.last) - self.last], dtype=np.float64)


class Drift:
    """How uncertain the path between two key poses is, by chaining the steps since the last closure."""

    def __init__(self) -> None:
        self._steps: GrowingRows[np.float64] = GrowingRows((3, 3), np.float64)
        self._searched: GrowingRows[np.float64] = GrowingRows((3, 3), np.float64)
        for steps in (self._steps, self._searched):
            steps.append(np.zeros((3, 3)))  # no step leads to the first key pose
        self._last_closure = 0
        self._new: list[tuple[Covariances, Covariances]] = []

    def add(self, covariances: Covariances, searched: Covariances) -> None:
        """Add the step that leads to the next key pose.

        Args:
            covariances: (3, 3) of each independent measurement of the step …
            searched: … and those that a search relies on, which may be wider.
        """
        self._new.append((covariances, searched))

    def close(self, key: int) -> None:
        """A closure at `key` ends the drift of everything before it."""
        self._last_closure = key

    def spread(self, key_new: int, poses: Floats) -> Spread:
        """How uncertain a pose is relative to any earlier one.

        Args:
            key_new: the pose.
            poses: (k, 3) of all up to it.
        """
        self._fuse()
        last = self._last_closure
        steps = slice(last + 1, key_new + 1)
        lever2 = np.sum((poses[steps, :2] - poses[key_new, :2]) ** 2, axis=1)
        covariances = self._searched.rows[steps]
        position, heading = np.maximum(covariances[:, 0, 0], covariances[:, 1, 1]), covariances[:, 2, 2]
        variances = np.zeros((max(0, key_new - last) + 1, 2))
        variances[:-1, 0] = np.cumsum((position + heading * lever2)[::-1])[::-1]
        variances[:-1, 1] = np.cumsum(heading[::-1])[::-1]
        return Spread(last, np.sqrt(variances))

    def covariance(self, key_old: int, key_new: int, poses: Floats) -> Floats:
        """(3, 3) of the relative pose of two key poses, in the tangent space at the later: the steps between them.

        Where a closure lies between, only the steps since the last one count, so that this is a lower bound.

        Args:
            key_old: the earlier.
            key_new: the later.
            poses: (k, 3) of all up to it.
        """
        self._fuse()
        steps = slice(max(key_old, self._last_closure) + 1, key_new + 1)
        carried = congruence(adjoint(between(poses[key_new], poses[steps])), self._steps.rows[steps])
        return np.asarray(carried.sum(axis=0))

    def _fuse(self) -> None:
        """Take in the new steps, all at once."""
        if not self._new:
            return
        for steps, measured in zip((self._steps, self._searched), zip(*self._new, strict=True), strict=True):
            for covariance in _fused(measured):
                steps.append(covariance)
        self._new.clear()


def _fused(steps: Sequence[Covariances]) -> Floats:
    """(n, 3, 3) what the measurements of each step know together."""
    measured = np.array([each for covariances in steps for each in covariances])
    if len(measured) == len(steps):
        return measured
    starts = np.cumsum([0, *(len(covariances) for covariances in steps[:-1])])
    return np.asarray(inv(np.add.reduceat(inv(measured), starts)))

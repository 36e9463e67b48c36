"""What holds the key poses: every factor with how far the final path is from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graph.problem import Problem
from iceg.report.packing import packed

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

KINDS = ("prior", "odometry", "ice", "closure")


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldBy:
    """The factors of a run, as they were measured, at its final poses.

    Attributes:
        kinds: (m,) index into `KINDS`.
        i: (m,) key pose each is seen from, -1 for the map.
        j: (m,) key pose that is seen.
        sigmas: (m,) distance of the path from the measurement, in standard deviations of the measurement.
        weights: (m,) what the robust kernel leaves of each, 1 for all of it.
    """

    kinds: NDArray[np.int64]
    i: NDArray[np.int64]
    j: NDArray[np.int64]
    sigmas: NDArray[np.float64]
    weights: NDArray[np.float64]

    @classmethod
    def of(cls, result: "SlamResult") -> "HeldBy":
        """Of all factors of a run."""
        problem = Problem.of(result.graph.factors, len(result.key_poses))
        at = problem.evaluate(result.key_poses)
        kinds = np.array([KINDS.index(factor.kind) for factor in result.graph.factors], dtype=np.int64)
        return cls(kinds=kinds, i=problem.i, j=problem.j, sigmas=np.sqrt(at.squared), weights=at.weights)

    def mean_squares(self) -> dict[str, float]:
        """Mean squared residual of each kind, by degree of freedom: 1 where the covariances are right."""
        means = {}
        for code, kind in enumerate(KINDS[1:], start=1):
            chosen = self.kinds == code
            if chosen.any():
                means[kind] = float((self.sigmas[chosen] ** 2).mean() / 3.0)
        return means

    def payload(self) -> Mapping[str, Any]:
        """For the page."""
        return {
            "names": KINDS,
            "kinds": packed(self.kinds, "u1"),
            "i": packed(self.i, "i4"),
            "j": packed(self.j, "i4"),
            "sigmas": packed(self.sigmas, "f4"),
            "weights": packed(self.weights, "f4"),
        }

"""What a matcher says about two poses: a relative pose with its covariance."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.errors import IcegError
from graph.noise import UNOBSERVED_SIGMA
from graph.short_repr import short_repr


class MeasurementError(IcegError):
    """A relative pose whose numbers cannot be a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """By how much wall a match is held where its position is held least, and most.

    Attributes:
        directions: (2, 3) in the tangent space at the measurement: x, y of length 1, and the turn that goes along
            [rad/m]; held least first.
        lengths: (2,) how much wall faces along each [m].
    """

    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativePose:
    """Pose of `cur` in the frame of `ref`, as one matching factor of the graph.

    Attributes:
        T_ref_cur: (3,) x [m], y [m], heading [rad].
        covariance: (3, 3) in the tangent space at the measurement: right perturbation
            `T_ref_cur * exp(ξ)`, order x, y, θ (GTSAM's own convention). Symmetric, positive definite.
        score: correlation score in [0, 1]; 1 means every beam lies on the reference.
        inliers: how many beams agree with the reference.
        overlap: share of the usable beams that fall on known reference, in [0, 1].
        weak_directions: (k, 3) unit vectors of the tangent space along which the match is unobservable
            (a corridor's long axis); k = 0 when everything is observed.
        held: what holds the position; None from a matcher that does not tell.
    """

    T_ref_cur: NDArray[np.float64]
    covariance: NDArray[np.float64]
    score: float
    inliers: int
    overlap: float
    weak_directions: NDArray[np.float64]
    held: Held | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.T_ref_cur.shape != (3,) or not all(map(isfinite, self.T_ref_cur.tolist())):
            raise MeasurementError(f"a relative pose needs 3 finite numbers, found {self.T_ref_cur}")
        if self.covariance.shape != (3, 3) or not all(map(isfinite, self.covariance.ravel().tolist())):
            raise MeasurementError(f"a covariance needs 3x3 finite numbers, found {self.covariance}")
        if self.weak_directions.ndim != 2 or self.weak_directions.shape[1] != 3:
            raise MeasurementError(
                f"weak directions are rows of 3 numbers, (k, 3), found shape {self.weak_directions.shape}"
            )

    @property
    def is_fully_observed(self) -> bool:
        """Whether the match constrains all three degrees of freedom."""
        return len(self.weak_directions) == 0

    def knows_turn(self, deviation: float) -> bool:
        """Whether the match knows the turn to a standard deviation [rad], or observes everything.

        Beside a straight wall it does though it does not see how far the robot came; on an arc the one hangs on the
        other.
        """
        return self.is_fully_observed or bool(self.informed_covariance[2, 2] <= deviation**2)

    @property
    def informed_covariance(self) -> NDArray[np.float64]:
        """(3, 3) the covariance of the match as a factor of a graph: along what it does not observe it says nothing.

        There `covariance` has the standard deviation that the matcher was told to claim, with which gates compute. A
        graph adds up what its factors say, and nothing seen, however often, must not add up to anything.
        """
        if self.is_fully_observed:
            return self.covariance
        weak = self.weak_directions
        return self.covariance + UNOBSERVED_SIGMA**2 * dense.matmul(weak.T, weak)


@dataclass(frozen=True, slots=True, kw_only=True)
class NoMatch:
    """A matcher's statement that it found nothing credible, and why."""

    reason: str

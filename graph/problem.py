"""Nonlinear least squares on the poses of a graph: arrays of factors, Levenberg-Marquardt with a sparse Cholesky."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from graph import _linear_kernels as linear
from graph import _sparse_kernels as sparse
from graph import losses
from graph.block_factor import BlockFactor
from graph.dense import vecdot
from graph.errors import GraphError
from graph.factors import Factor, KernelName
from graph.noise import information_of
from graph.se2 import compose, expmap

_KERNELS: dict[KernelName, int] = {
    "huber": losses.HUBER,
    "cauchy": losses.CAUCHY,
    "geman_mcclure": losses.GEMAN_MCCLURE,
    "dcs": losses.DCS,
}
_FIRST_DAMPING, _MOST_DAMPING = 1e-6, 1e6
_DAMPING_FACTOR = 10.0
"""How much more, or less, the normal equations are damped after a step that failed, or succeeded."""
_EQUAL_ERRORS = 1e-12  # a step may raise the error by rounding


class Evaluation(NamedTuple):
    """Factors at poses: (m, 3) residuals, (m,) squared whitened norms, (m,) losses, (m,) weights."""

    residuals: NDArray[np.float64]
    squared: NDArray[np.float64]
    losses: NDArray[np.float64]
    weights: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Descent:
    """Where Levenberg-Marquardt went.

    Attributes:
        poses: (n, 3) T_map_robot.
        error_before: sum of the losses at the start.
        error_after: the same at `poses`.
        iterations: steps taken.
        converged: whether the error stopped falling before the iterations ran out.
    """

    poses: NDArray[np.float64]
    error_before: float
    error_after: float
    iterations: int
    converged: bool


class Problem:
    """The factors of a graph as arrays, with the order of elimination worked out once.

    Attributes:
        i: (m,) first pose of each factor, −1 for a prior.
        j: (m,) second pose.
        measured: (m, 3) T_i_j.
        information: (m, 3, 3).
    """

    def __init__(
        self,
        n_poses: int,
        i: NDArray[np.int64],
        j: NDArray[np.int64],
        measured: NDArray[np.float64],
        information: NDArray[np.float64],
        kernel: NDArray[np.int64],
        width: NDArray[np.float64],
        structure: "_Structure | None" = None,
    ) -> None:
        self.n_poses = n_poses
        self.i, self.j, self.measured, self.information = i, j, measured, information
        self._kernel, self._width = kernel, width
        self._known_structure = structure

    @classmethod
    def of(cls, factors: Sequence[Factor], n_poses: int) -> "Problem":
        """The problem of these factors on poses 0 … n−1."""
        return cls(
            n_poses,
            i=np.array([-1 if factor.i is None else factor.i for factor in factors], dtype=np.int64),
            j=np.array([factor.j for factor in factors], dtype=np.int64),
            measured=np.array([factor.T_i_j for factor in factors]).reshape(-1, 3),
            information=information_of(np.array([factor.covariance for factor in factors]).reshape(-1, 3, 3)),
            kernel=np.array([_KERNELS[f.kernel.name] if f.kernel else losses.PLAIN for f in factors], dtype=np.int64),
            width=np.array([f.kernel.width if f.kernel else 1.0 for f in factors], dtype=np.float64),
        )

    def with_kernel(self, kernel: KernelName | None, width: float, where: NDArray[np.bool_]) -> "Problem":
        """The same factors, those that (m,) `where` marks with another robust kernel."""
        return Problem(
            self.n_poses,
            self.i,
            self.j,
            self.measured,
            self.information,
            kernel=np.where(where, _KERNELS[kernel] if kernel else losses.PLAIN, self._kernel),
            width=np.where(where, width, self._width),
            structure=self._known_structure,
        )

    def restricted_to(self, kept: NDArray[np.bool_]) -> "Problem":
        """The problem of the factors (m,) marked alone; the others no longer fill the Cholesky factor."""
        if kept.all():
            return self
        return Problem(
            self.n_poses,
            self.i[kept],
            self.j[kept],
            self.measured[kept],
            self.information[kept],
            self._kernel[kept],
            self._width[kept],
        )

    @property
    def is_robust(self) -> bool:
        """Whether any factor has a robust kernel."""
        return bool((self._kernel != losses.PLAIN).any())

    def fade_at(self, suspects: NDArray[np.bool_]) -> float | None:
        """Squared norm beyond which all the factors (m,) marked fade to nothing; None if some never do."""
        kernel, width = self._kernel[suspects], self._width[suspects]
        if not len(kernel) or not np.isin(kernel, (losses.DCS, losses.GEMAN_MCCLURE)).all():
            return None
        return float(np.where(kernel == losses.DCS, width, width * width).max())

    def evaluate(self, poses: NDArray[np.float64]) -> Evaluation:
        """Residuals, losses and weights at (n, 3) poses."""
        errors = linear.residuals(poses, self.i, self.j, self.measured)
        squared = losses.squared_norms(errors, self.information)
        return Evaluation(errors, squared, *losses.losses_and_weights(squared, self._kernel, self._width))

    def descend(
        self,
        poses: NDArray[np.float64],
        *,
        max_iterations: int = 100,
        relative_tolerance: float = 1e-9,
        absolute_tolerance: float = 1e-9,
        trust: NDArray[np.float64] | None = None,
    ) -> Descent:
        """Levenberg-Marquardt, damped only after a step that failed.

        Args:
            poses: (n, 3) start.
            max_iterations: at most so many steps.
            relative_tolerance: stop when |change of error| / error falls below it.
            absolute_tolerance: stop when |change of error| falls below it.
            trust: (m,) weights of the factors besides their kernels, None for ones.

        Returns:
            The poses with the lowest error found.

        Raises:
            GraphError: the factors do not determine the poses.
        """
        here = np.array(poses, dtype=np.float64, order="C")
        at = self.evaluate(here)
        factor_trust = np.ones(len(self.j)) if trust is None else trust
        error = error_before = vecdot(at.losses, factor_trust)
        damping, converged, iterations = 0.0, False, 0
        while iterations < max_iterations and not converged:
            iterations += 1
            system = self._structure.assemble(self, here, at.residuals, at.weights * factor_trust)
            while True:
                step = system.step(damping)
                trial = here if step is None else compose(here, expmap(step[self._structure.row_of]))
                tried = self.evaluate(trial)
                trial_error = vecdot(tried.losses, factor_trust)
                if step is not None and trial_error <= error + _EQUAL_ERRORS * (1.0 + error):
                    break
                damping = max(_FIRST_DAMPING, damping * _DAMPING_FACTOR)
                if damping > _MOST_DAMPING:
                    if step is None:
                        raise GraphError("the normal equations stay indefinite however they are damped")
                    return Descent(
                        poses=here,
                        error_before=error_before,
                        error_after=error,
                        iterations=iterations,
                        converged=True,
                    )
            change = error - trial_error
            converged = change <= absolute_tolerance or change <= relative_tolerance * error
            here, at, error = trial, tried, min(error, trial_error)
            damping = 0.0 if damping <= _FIRST_DAMPING else damping / _DAMPING_FACTOR
        return Descent(
            poses=here, error_before=error_before, error_after=error, iterations=iterations, converged=converged
        )

    def linearized(self, poses: NDArray[np.float64]) -> "Linearization":
        """The normal equations at (n, 3) poses, their Cholesky factor computed.

        Raises:
            GraphError: the factors do not determine every pose.
        """
        at = self.evaluate(poses)
        system = self._structure.assemble(self, poses, at.residuals, at.weights)
        if not system.factorize(0.0):
            raise GraphError("the factors do not determine every pose")
        return Linearization(system, self._structure.row_of)

    @property
    def _structure(self) -> "_Structure":
        """Worked out when first needed: factors that are only evaluated need none."""
        if self._known_structure is None:
            self._known_structure = _Structure(self.i, self.j, self.n_poses)
        return self._known_structure

    def marginal_covariances(
        self, poses: NDArray[np.float64], trust: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """(n, 3, 3) covariance of each pose at the optimum, in the tangent space at it.

        Raises:
            GraphError: the factors do not determine the poses.
        """
        _, on_diagonal = self._inverse(poses, trust)
        return np.asarray(on_diagonal[self._structure.row_of])

    def joint_covariances(
        self, poses: NDArray[np.float64], trust: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """(m, 6, 6) covariance of the two poses of each factor at the optimum, each in the tangent space at it.

        Those of a prior's first pose, which is the map itself, are zero.

        Raises:
            GraphError: the factors do not determine the poses.
        """
        lower, on_diagonal = self._inverse(poses, trust)
        row_of, binary = self._structure.row_of, self.i >= 0
        first, second = row_of[np.maximum(self.i, 0)], row_of[self.j]
        joint = np.zeros((len(self.j), 6, 6))
        joint[:, :3, :3] = np.where(binary[:, None, None], on_diagonal[first], 0.0)
        joint[:, 3:, 3:] = on_diagonal[second]
        places = self._structure.places_of(np.maximum(first, second)[binary], np.minimum(first, second)[binary])
        below = lower[places]  # of the later pose in the order of elimination with the earlier
        turned = (second > first)[binary, None, None]
        joint[binary, 3:, :3] = np.where(turned, below, np.swapaxes(below, 1, 2))
        joint[:, :3, 3:] = np.swapaxes(joint[:, 3:, :3], 1, 2)
        return joint

    def _inverse(
        self, poses: NDArray[np.float64], trust: NDArray[np.float64] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        at = self.evaluate(poses)
        weights = at.weights if trust is None else at.weights * trust
        system = self._structure.assemble(self, poses, at.residuals, weights)
        if not system.factorize(0.0):
            raise GraphError("the factors do not determine every pose")
        return system.inverse()


class Linearization:
    """H x = −g at given poses: what another method needs to add its own terms to a graph.

    All arrays are (n, 3), one row for each pose in the tangent space at it.
    """

    def __init__(self, system: "_System", row_of: NDArray[np.int64]) -> None:
        self._system, self._row_of = system, row_of
        self._pose_of = np.argsort(row_of, kind="stable")

    @property
    def gradient(self) -> NDArray[np.float64]:
        """(n, 3) the derivative g of the error."""
        return np.asarray(self._system.gradient[self._row_of])

    def times(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """H x, both (n, 3)."""
        return np.asarray(self._system.times(x[self._pose_of])[self._row_of])

    def solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """H⁻¹ b, both (n, 3)."""
        return np.asarray(self._system.solved(b[self._pose_of])[self._row_of])

    @property
    def factor(self) -> BlockFactor:
        """The Cholesky factor of H."""
        return self._system.factor


class _Structure:
    """Which blocks the normal equations and their Cholesky factor have, in an order with little fill."""

    def __init__(self, i: NDArray[np.int64], j: NDArray[np.int64], n: int) -> None:
        binary = i >= 0
        self.row_of = _elimination_order(i[binary], j[binary], n)
        a, b = self.row_of[np.maximum(i, 0)], self.row_of[j]
        keys = np.maximum(a, b) * n + np.minimum(a, b)
        pairs, inverse = np.unique(keys[binary], return_inverse=True)
        self.slot = np.zeros(len(i), dtype=np.int64)
        self.slot[binary] = inverse
        self.rows = pairs % n
        self.column_starts = np.searchsorted(pairs // n, np.arange(n + 1)).astype(np.int64)
        self.factor = sparse.factor_structure(n, self.column_starts, self.rows)
        self.n = n

    def places_of(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where the Cholesky factor keeps blocks below the diagonal, given by the rows and columns (k,) they are in."""
        starts, rows_of_l = self.factor[:2]
        keys = np.repeat(np.arange(self.n), np.diff(starts)) * self.n + rows_of_l
        return np.searchsorted(keys, columns * self.n + rows)

    def assemble(
        self,
        problem: Problem,
        poses: NDArray[np.float64],
        residuals: NDArray[np.float64],
        weights: NDArray[np.float64],
    ) -> "_System":
        """The normal equations at poses (n, 3), from residuals (m, 3) and weights (m,) there."""
        system = _System(self)
        linear.normal_equations(
            poses,
            problem.i,
            problem.j,
            residuals,
            problem.information,
            weights,
            self.row_of,
            self.slot,
            system.diagonal,
            system.upper,
            system.gradient,
        )
        return system


class _System:
    """H x = −g, and the factor of H once it was computed."""

    def __init__(self, structure: _Structure) -> None:
        self._structure = structure
        n, n_factor = structure.n, len(structure.factor[1])
        self.diagonal = np.zeros((n, 3, 3))
        self.upper = np.zeros((len(structure.rows), 3, 3))
        self.gradient = np.zeros((n, 3))
        self._values = np.empty((n_factor, 3, 3))
        self._roots = np.zeros((n, 3, 3))

    def factorize(self, damping: float) -> bool:
        """Cholesky factor of H + damping · diag(H); False if it is not positive definite."""
        damped = self.diagonal
        if damping > 0.0:
            damped = self.diagonal.copy()
            axes = np.arange(3)
            damped[:, axes, axes] *= 1.0 + damping
        return bool(
            sparse.factorize(
                self._structure.column_starts,
                self._structure.rows,
                self.upper,
                damped,
                *self._structure.factor,
                self._values,
                self._roots,
            )
        )

    def step(self, damping: float) -> NDArray[np.float64] | None:
        """(n, 3) −(H + damping · diag(H))⁻¹ g in the order of elimination; None if it is not positive definite."""
        if not self.factorize(damping):
            return None
        step = self.solved(-self.gradient)
        return step if np.isfinite(step).all() else None

    @property
    def factor(self) -> BlockFactor:
        """The Cholesky factor, after `factorize`."""
        structure = self._structure
        return BlockFactor(structure.row_of, *structure.factor[:2], self._values, self._roots)

    def solved(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) H⁻¹ b in the order of elimination, after `factorize`."""
        starts, rows = self._structure.factor[:2]
        return np.asarray(sparse.solve_factored(starts, rows, self._values, self._roots, b))

    def times(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) H x in the order of elimination."""
        structure = self._structure
        return np.asarray(sparse.multiplied(structure.column_starts, structure.rows, self.upper, self.diagonal, x))

    def inverse(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Blocks (b, 3, 3) of H⁻¹ below the diagonal, where its factor has any, and (n, 3, 3) on it, factorized."""
        starts, rows = self._structure.factor[:2]
        lower, on_diagonal = sparse.selected_inverse(starts, rows, self._values, self._roots)
        return lower, on_diagonal


def _elimination_order(i: NDArray[np.int64], j: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """(n,) place of each pose in the order of elimination: column approximate minimum degree, by GTSAM."""
    graph = gtsam.SymbolicFactorGraph()
    for first, second in zip(i.tolist(), j.tolist(), strict=True):
        graph.push_factor(first, second)
    for pose in range(n):
        graph.push_factor(pose)
    ordering = gtsam.Ordering.ColamdSymbolicFactorGraph(graph)
    row_of = np.empty(n, np.int64)
    row_of[[ordering.at(row) for row in range(n)]] = np.arange(n)
    return row_of

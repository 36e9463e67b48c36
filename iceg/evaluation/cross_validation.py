"""Are the covariances of a graph honest, without any truth: each factor judged by all the others.

Leave one factor out, let the rest predict it, and compare: the innovation is χ² with three degrees of freedom if every
covariance is right. No graph is solved again for it. Whiten the factor with L, Ω = L Lᵀ: let u = Lᵀ r be its residual
at the optimum and A = Lᵀ P L the covariance of the relative pose that the whole graph predicts, w the weight its robust
kernel leaves it. Taking w Ω away from the information (Woodbury) gives the prediction of the rest,

    u' = (I − wA)⁻¹ u,    A' = (I − wA)⁻¹ A,    χ² = u'ᵀ (I + A')⁻¹ u' = Σ (vₖᵀu)² / ((1 − w aₖ)(1 − w aₖ + aₖ))

with aₖ, vₖ the eigenvalues and vectors of A; at full weight rᵀ (C − P)⁻¹ r, the studentised residual of regression
(Cook and Weisberg, *Residuals and Influence in Regression*, 1982). 1 − w aₖ is the redundancy: the share of what is
known along vₖ that comes from elsewhere. Where it is nothing, nothing can be said.

An error that a factor shares with its neighbours, as matches to one reference do, is not seen: the rest agrees with it.
There the figure is a lower bound (docs/ablation.md compares it with the truth).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.batch import check_determined, optimize
from graph.errors import GraphError
from graph.factors import Factor, FactorKind
from graph.g2o import read_g2o
from graph.problem import Problem
from graph.se2 import between_jacobians
from iceg.evaluation.consistency import Consistency, consistency
from iceg.evaluation.errors import EvaluationError
from iceg.results import whole_results

KINDS: tuple[FactorKind, ...] = ("odometry", "ice", "closure")
_LEAST_REDUNDANCY = 1e-3
"""A factor with less is checked by nothing else."""
FADED = 0.5
"""A factor that its robust kernel leaves no more weight than this is out of force."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """m factors, each as the rest of the graph sees it.

    Attributes:
        chi_square: (m,) squared Mahalanobis distance to what the rest predicts; NaN where the rest says nothing.
        redundancy: (m,) in [0, 1]; the share of its weakest direction that is known from elsewhere.
        weights: (m,) what the robust kernel leaves of each factor, 1 without.
    """

    chi_square: NDArray[np.float64]
    redundancy: NDArray[np.float64]
    weights: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class KindConsistency:
    """One kind of factor.

    Attributes:
        judged: NEES of those that pull and that others check.
        unchecked: how many nothing else in the graph checks.
        faded: how many were taken out of force by their robust kernel.
    """

    judged: Consistency
    unchecked: int
    faded: int


def leave_one_out(factors: Sequence[Factor], poses: NDArray[np.float64]) -> LeftOut:
    """Each factor judged by all the others, to first order around the optimum.

    Args:
        factors: at least one prior among them.
        poses: (n, 3) their optimum.

    Raises:
        GraphError: the factors do not determine every pose.
    """
    check_determined(factors, len(poses))
    problem = Problem.of(factors, len(poses))
    here = np.array(poses, dtype=np.float64, order="C")
    at = problem.evaluate(here)
    whiten = dense.cholesky(problem.information)
    u = dense.matvec(np.swapaxes(whiten, 1, 2), at.residuals)
    predicted = dense.congruence(np.swapaxes(whiten, 1, 2), _predicted_covariances(problem, here))
    a, v = dense.eigh(predicted)
    left = 1.0 - at.weights[:, None] * a
    along = dense.matvec(np.swapaxes(v, 1, 2), u)
    redundancy = np.clip(left.min(axis=1), 0.0, 1.0)
    checked = redundancy > _LEAST_REDUNDANCY
    terms = along**2 / np.where(checked[:, None], left * (left + a), np.nan)
    chi_square = terms.sum(axis=1)
    return LeftOut(chi_square=chi_square, redundancy=redundancy, weights=at.weights)


def cross_validation(factors: Sequence[Factor], poses: NDArray[np.float64]) -> dict[FactorKind, KindConsistency]:
    """The consistency of each kind of factor, kinds without a judged factor left out.

    Args:
        factors: at least one prior among them.
        poses: (n, 3) their optimum.

    Raises:
        GraphError: the factors do not determine every pose.
    """
    found = leave_one_out(factors, poses)
    kinds = np.array([factor.kind for factor in factors])
    faded, unchecked = found.weights <= FADED, np.isnan(found.chi_square)
    judged = ~faded & ~unchecked
    return {
        kind: KindConsistency(
            judged=consistency(found.chi_square[(kinds == kind) & judged]),
            unchecked=int(((kinds == kind) & unchecked & ~faded).sum()),
            faded=int(((kinds == kind) & faded).sum()),
        )
        for kind in KINDS
        if ((kinds == kind) & judged).any()
    }


def cross_validation_report(folder: Path | str) -> dict[str, float]:
    """The figures for the graph that a run left behind.

    Args:
        folder: of a run, or a g2o file itself.

    Raises:
        ResultsError: the files of the folder are not those of one run.
        GraphError: the graph is missing, cannot be read or does not determine every pose.
        EvaluationError: nothing in it is known twice.
    """
    folder = Path(folder)
    path = folder / "graph.g2o" if folder.is_dir() else folder
    with whole_results(folder):
        try:
            graph = read_g2o(path)
        except GraphError as err:
            raise GraphError(f"{err}; consistency is that of a graph: give the folder of a run, or a g2o file") from err
    optimum = optimize(graph.factors, graph.poses).poses
    report: dict[str, float] = {}
    for kind, found in cross_validation(graph.factors, optimum).items():
        report |= {
            f"{kind}_n": found.judged.n,
            f"{kind}_nees_mean": found.judged.mean,
            f"{kind}_nees_low": found.judged.mean_low,
            f"{kind}_nees_high": found.judged.mean_high,
            f"{kind}_nees_median": found.judged.median,
            f"{kind}_share_95": found.judged.share_within_95,
            f"{kind}_unchecked": found.unchecked,
            f"{kind}_faded": found.faded,
        }
    if not report:
        raise EvaluationError(f"{path}: found no factor that others check, expected some between the same poses")
    return report


def _predicted_covariances(problem: Problem, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3, 3) covariance of each factor's relative pose given the whole graph, in the tangent space at it."""
    first = np.where(problem.i[:, None] >= 0, poses[problem.i], 0.0)
    by_first, by_second = between_jacobians(first, poses[problem.j])
    jacobians = np.concatenate([by_first, by_second], axis=-1)
    return dense.congruence(jacobians, problem.joint_covariances(poses))

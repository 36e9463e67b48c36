"""How well a hypothesis explains the new scan: by features (equations (1)-(3) or probabilistic) or by points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graph.elementary import arctan2
from iceg.ice import _hypothesis_kernels as kernels
from iceg.ice.config import Fitness, HypothesisConfig
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints


def importance(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Equation (3): the weight of a feature by its distance from the laser.

    Args:
        distance: (n,) [m].

    Returns:
        (n,) fImp: 0.68 at the robot, 0.60 at 1 m, 0.075 at 20 m.
    """
    return 0.6 - 0.4 * arctan2(0.2 * distance - 0.2, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranking:
    """Scores of n hypotheses.

    Attributes:
        counts: (n,) coinciding features, all 0 when ranked by points.
        correlations: (n,) in [0, 1], larger is better.
        is_count_first: the largest count is the best, whatever its correlation (paper, section III.C.3).
    """

    counts: NDArray[np.int64]
    correlations: NDArray[np.float64]
    is_count_first: bool = False

    @property
    def order(self) -> NDArray[np.int64]:
        """(n,) indices from best to worst."""
        return self.at_least(-np.inf)

    @property
    def best(self) -> int:
        """Index of the best."""
        return int(self.order[0] if self.is_count_first else self.correlations.argmax())

    def at_least(self, correlation: float) -> NDArray[np.int64]:
        """(k,) indices of those with this correlation or a larger one, from best to worst."""
        found = np.flatnonzero(self.correlations >= correlation)
        worse = -self.correlations[found]
        by_rank = np.lexsort((worse, -self.counts[found])) if self.is_count_first else np.argsort(worse, kind="stable")
        return found[by_rank]


def rank_by_points(
    scan_points: ScanPoints,
    local_map: LocalMap,
    hypotheses: NDArray[np.float64],
    config: HypothesisConfig,
    *,
    sift: bool = True,
) -> Ranking:
    """Rank by dense agreement: mean of exp(-d²/2σ²) over the points, d from the wide field of the local map.

    Args:
        scan_points: points of the new scan.
        local_map: the reference.
        hypotheses: (n, 3) T_ref_cur.
        config: number of points and σ.
        sift: judge hypotheses that a few points show to be hopeless by these only.

    Returns:
        The ranking.
    """
    scores = np.empty(len(hypotheses))
    field = local_map.coarse
    n_points = min(len(scan_points), config.ranking_points)
    kernels.score_by_points(
        scan_points.points,
        min(n_points, config.sifting_points) if sift else n_points,
        n_points,
        hypotheses,
        local_map.likelihood(config.field_sigma),
        field.origin,
        field.cell,
        scores,
    )
    return Ranking(counts=np.zeros(len(hypotheses), np.int64), correlations=scores)


def rank_by_features(
    features: FeatureRows, reference: FeatureRows, hypotheses: NDArray[np.float64], fitness: Fitness
) -> Ranking:
    """Rank by coinciding features.

    Args:
        features: features of the new scan.
        reference: features of the local map.
        hypotheses: (n, 3) T_ref_cur.
        fitness: "paper" for equations (1)-(3) turned so that larger is better, "probabilistic" for the
            Mahalanobis distance under both features' covariances. The paper's order is count first, then
            correlation; the probabilistic correlation already grows with the count and is used alone.

    Returns:
        The ranking.
    """
    counts, scores = np.empty(len(hypotheses), np.int64), np.empty(len(hypotheses))
    paper = fitness == "paper"
    kernels.score_by_features(
        features.kinds, features.rows, reference.kinds, reference.rows, hypotheses, paper, counts, scores
    )
    return Ranking(counts=counts, correlations=scores, is_count_first=paper)

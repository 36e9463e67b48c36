"""How the errors of the key poses hang together: what a figure that rests on several of them is uncertain by."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.block_factor import BlockFactor, factorized
from graph.factors import Factor
from graph.problem import Problem
from graph.se2 import adjoint, between
from graph.short_repr import short_repr
from iceg.slam.broken_path.displacement import Displacement, displaced_covariances
from iceg.slam.joint.covariance import PoseInformation
from iceg.slam.joint.marginal_blocks import close_together


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCovariance:
    """The joint covariance of all key poses, worked out when it is first asked for.

    It rests on what the marginals rest on: the points on shared walls, or the factors of the graph where the walls are
    not believed.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        marginals: (k, 3, 3) their covariances as they are believed, displacements included.
        information: of points and odometry; None where the factors tell.
        factors: of the graph.
        displacements: of what follows breaks of the path that may be wrong.
    """

    poses: NDArray[np.float64]
    marginals: NDArray[np.float64]
    information: PoseInformation | None
    factors: Sequence[Factor]
    displacements: Sequence[Displacement] = ()

    __repr__ = short_repr

    @cached_property
    def anchors(self) -> NDArray[np.int64]:
        """(m,) the key poses that the factor has unknowns for."""
        return np.arange(len(self.poses)) if self.information is None else self.information.anchors

    @cached_property
    def anchor_of(self) -> NDArray[np.int64]:
        """(k,) index into `anchors` of the one that each key pose lies behind."""
        return np.arange(len(self.poses)) if self.information is None else self.information.anchor_of

    @cached_property
    def placements(self) -> NDArray[np.float64]:
        """(k, 3, 3) covariance of each key pose as its anchor sees it, tangent space at it."""
        return np.zeros((len(self.poses), 3, 3)) if self.information is None else self.information.placements

    @cached_property
    def excess(self) -> NDArray[np.float64]:
        """(k,) how many times the variance of each key pose is believed to be what the factor says."""
        if self.information is None:
            return np.ones(len(self.poses))
        held = self.marginals - displaced_covariances(self.displacements, len(self.poses))
        ratios = dense.solve(self.information.covariances, held)
        return np.asarray(np.trace(ratios, axis1=1, axis2=2) / 3.0)

    @cached_property
    def factor(self) -> BlockFactor:
        """Of the information matrix of the anchors."""
        if self.information is None:
            return Problem.of(self.factors, len(self.poses)).linearized(self.poses).factor
        row_of = np.empty(len(self.anchors), np.int64)
        row_of[close_together(self.information.matrix)] = np.arange(len(row_of))
        return factorized(self.information.matrix, row_of)

    def variance(self, keys: NDArray[np.int64], gradients: NDArray[np.float64]) -> float:
        """Of a figure that changes with several key poses, to first order.

        Args:
            keys: (n,) the key poses, each once.
            gradients: (n, 3) derivatives by a step in the tangent space at each.
        """
        anchors = self.anchor_of[keys]
        right = np.zeros((len(self.anchors), 3))
        np.add.at(right, anchors, self._carried(self.anchors[anchors], keys, gradients))
        own = (gradients * dense.matvec(self.placements[keys], gradients)).sum()
        known = float((right * self.factor.solve(right)).sum() + own)
        return known * float(self.excess[keys].max()) + self._by_displacements(keys, gradients)

    def _by_displacements(self, keys: NDArray[np.int64], gradients: NDArray[np.float64]) -> float:
        """What displacements add: all key poses after a break move together, so that nothing among them changes."""
        added = 0.0
        for each in self.displacements:
            after = keys >= each.key
            moved = self._carried(np.array(each.key), keys[after], gradients[after]).sum(axis=0)
            added += float((moved**2 * each.variances).sum())
        return added

    def _carried(
        self, others: NDArray[np.int64], keys: NDArray[np.int64], gradients: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(n, 3) gradients by key poses as those by others that move along with them."""
        T_key_other = between(self.poses[keys], self.poses[others])
        return dense.matvec(np.swapaxes(adjoint(T_key_other), 1, 2), gradients)

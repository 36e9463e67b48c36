"""NDT: the normal distributions transform (Biber and Straßer, IROS 2003).

The reference is cut into cells of a metre, each a normal distribution of the points in it; four grids shifted by half a
cell overlap, so that every point meets four cells. Newton's method maximises Σ exp(−dᵀS⁻¹d/2).
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _ndt_kernels as kernels
from frontends.matchers.errors import MatcherError, require
from frontends.matchers.restarts import RestartConfig, other_starts
from frontends.matchers.surfaces import weak_directions
from frontends.scan import Scan
from graph import dense
from graph.measurement import NoMatch, RelativePose
from graph.se2 import transform_points

_INLIER_GATE = 9.21
"""99 % of a normal distribution in the plane lies within this squared Mahalanobis distance."""
_LINK = 0.3
"""Neighbouring returns nearer than this lie on one surface [m]."""
_SMALLEST = 1e-4
"""Least standard deviation along any direction [m, rad]."""
_THIN = 0.15
"""A distribution says something along an axis that is thinner than this share of its cell (0.29 fills the cell)."""


@dataclass(frozen=True, kw_only=True)
class NdtConfig:
    """Settings of NDT; the paper's where it names them."""

    cell: float = 1.0
    """Side of a cell [m]."""
    min_points: int = 3
    """A cell needs this many points."""
    eigenvalue_ratio: float = 0.001
    """The smaller eigenvalue of a cell's covariance is at least this share of the larger one."""
    coarse_cell: float = 2.0
    """Side of a cell of the wide first stage [m] …"""
    coarse_ratio: float = 0.03
    """… and the share of its eigenvalues: blunter walls reach farther. The value of `eigenvalue_ratio` leaves the stage
    out and with it all that is not in the paper."""
    iterations: int = 40
    """Most Newton steps."""
    tolerance: float = 1e-4
    """Newton's method ends with a step shorter than this [m]."""
    reach: float = 25.0
    """Reference points farther than this from the newest scan are left out [m]."""
    min_inliers: float = 0.45
    """A match needs at least this share of its points within a cell's 99 % ellipse."""
    inflation: float = 5.0
    """Factor on the covariance; calibrated against simulated truth."""
    weak_facing: float = 0.03
    """A direction is unobservable if the squared cosines between it and the normals are less than this on average."""
    weak_sigma: float = 1.0
    """Standard deviation given to an unobservable direction [m, rad]."""
    restarts: RestartConfig = field(default_factory=RestartConfig)
    """Other starts where the first one ends badly."""

    def __post_init__(self) -> None:
        require(self.cell > 0, f"ndt.cell must be positive, found {self.cell}")
        require(self.reach > 0, f"ndt.reach must be positive, found {self.reach}")
        require(self.min_points >= 3, f"ndt.min_points must be at least 3, found {self.min_points}")
        require(
            0 < self.eigenvalue_ratio <= 1, f"ndt.eigenvalue_ratio must lie in (0, 1], found {self.eigenvalue_ratio}"
        )
        require(self.iterations >= 1, f"ndt.iterations must be at least 1, found {self.iterations}")
        require(0 <= self.min_inliers <= 1, f"ndt.min_inliers must lie in [0, 1], found {self.min_inliers}")
        require(self.inflation > 0, f"ndt.inflation must be positive, found {self.inflation}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NdtMap:
    """The normal distributions of a reference.

    Attributes:
        cells: (4, rows, columns, 6) of the four grids, see `_ndt_kernels`.
        origin: (2,) lower left corner of the first grid [m].
        cell: side of a cell [m].
    """

    cells: NDArray[np.float64]
    origin: NDArray[np.float64]
    cell: float
    coarse: "NdtMap | None" = None


class NdtMatcher:
    """Matches a scan against the normal distributions of earlier scans (implements `Matcher`)."""

    def __init__(self, config: NdtConfig | None = None) -> None:
        self.config = config or NdtConfig()

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> NdtMap:
        """Normal distributions of the points of all scans, (n, 3) poses."""
        if not scans:
            raise MatcherError("a reference needs at least one scan, found none")
        config = self.config
        points = np.concatenate(
            [transform_points(pose, scan.points) for scan, pose in zip(scans, T_ref_scans, strict=True)]
        )
        near = np.abs(points - T_ref_scans[-1][:2]).max(axis=1, initial=0.0) < config.reach
        points = np.ascontiguousarray(points[near])
        coarse = None
        if config.coarse_ratio != config.eigenvalue_ratio:
            coarse = self._distributions(points, config.coarse_cell, config.coarse_ratio)
        return self._distributions(points, config.cell, config.eigenvalue_ratio, coarse)

    def _distributions(
        self, points: NDArray[np.float64], cell: float, ratio: float, coarse: NdtMap | None = None
    ) -> NdtMap:
        corner = points.min(axis=0) if len(points) else np.zeros(2)
        origin = np.floor(corner / cell) * cell
        size = np.floor((points.max(axis=0) - origin) / cell) if len(points) else np.zeros(2)
        columns, rows = (size.astype(np.int64) + 2).tolist()
        cells = kernels.build_cells(points, origin, cell, rows, columns, self.config.min_points, ratio)
        return NdtMap(cells=cells, origin=origin, cell=cell, coarse=coarse)

    def match(
        self,
        reference: NdtMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the reference, see `frontends.matcher.Matcher`."""
        aligned = self._best(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(aligned, NoMatch):
            return aligned
        covariance, weak = self._covariance(reference, aligned)
        n = len(aligned.points)
        return RelativePose(
            T_ref_cur=aligned.T_ref_cur,
            covariance=covariance,
            score=aligned.inliers / n,
            inliers=aligned.inliers,
            overlap=aligned.met / n,
            weak_directions=weak,
        )

    def track(
        self,
        reference: NdtMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        """As `match`, but only the (3,) pose."""
        aligned = self._best(reference, scan, T_ref_guess, covariance_guess)
        return aligned if isinstance(aligned, NoMatch) else aligned.T_ref_cur

    def _best(
        self, reference: NdtMap, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> "_Aligned | NoMatch":
        """From the guess and, where that ends badly, from other starts around it."""
        config = self.config.restarts
        best = self._align(reference, scan, T_ref_guess)
        if config.below == 0.0 or _enough(best, config.below):
            return best
        for start in other_starts(T_ref_guess, covariance_guess, config):
            other = self._align(reference, scan, start)
            if isinstance(other, NoMatch):
                continue
            if isinstance(best, NoMatch) or other.inliers > best.inliers:
                best = other
            if _enough(best, config.below):
                break
        return best

    def _align(self, reference: NdtMap, scan: Scan, T_ref_guess: NDArray[np.float64]) -> "_Aligned | NoMatch":
        points = np.ascontiguousarray(scan.points)
        if len(points) < 2 * self.config.min_points:
            return NoMatch(reason=f"only {len(points)} beams returned")
        guess = np.asarray(T_ref_guess, dtype=np.float64)
        best = self._newton(reference, points, guess)
        if reference.coarse is not None:
            # The wide stage reaches farther, but a good guess may be better without it.
            wide = self._newton(reference, points, self._newton(reference.coarse, points, guess).T_ref_cur)
            best = wide if wide.inliers > best.inliers else best
        if best.inliers < self.config.min_inliers * len(points):
            return NoMatch(reason=f"only {best.inliers / len(points):.0%} of the beams lie in a cell's distribution")
        return best

    def _newton(self, stage: NdtMap, points: NDArray[np.float64], start: NDArray[np.float64]) -> "_Aligned":
        """Newton's method on one stage."""
        gradients, hessian = np.empty((len(points), 3)), np.empty((3, 3))
        cells, origin, cell = stage.cells, stage.origin, stage.cell
        pose, _, _ = kernels.align(
            points, start, cells, origin, cell, self.config.iterations, self.config.tolerance, gradients, hessian
        )
        inliers, met = kernels.count_inliers(points, pose, cells, origin, cell, _INLIER_GATE)
        return _Aligned(
            T_ref_cur=pose, points=points, gradients=gradients, hessian=hessian, inliers=int(inliers), met=int(met)
        )

    def _covariance(self, reference: NdtMap, aligned: "_Aligned") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Covariance of an M-estimator, H⁻¹ (Σ ggᵀ) H⁻¹, in the tangent space, and its weak directions.

        The gradients are summed per cell first: points of one wall share its error.
        """
        spread = kernels.clustered_spread(
            aligned.points,
            aligned.T_ref_cur,
            aligned.gradients,
            reference.origin,
            reference.cell,
            reference.cells.shape[1],
            reference.cells.shape[2],
        )
        information, pull = kernels.thin_information(
            aligned.points,
            aligned.T_ref_cur,
            reference.cells,
            reference.origin,
            reference.cell,
            _THIN * reference.cell,
        )
        rotation = np.eye(3)
        c, s = math.cos(aligned.T_ref_cur[2]), math.sin(aligned.T_ref_cur[2])
        rotation[:2, :2] = [[c, -s], [s, c]]
        covariance = sandwich(
            dense.congruence(rotation.T, information),
            dense.congruence(rotation.T, self.config.inflation * spread + np.outer(pull, pull)),
            self.config.weak_sigma,
        )
        weak = weak_directions(aligned.points, _LINK, self.config.weak_facing)
        return covariance + self.config.weak_sigma**2 * dense.matmul(weak.T, weak), weak


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aligned:
    """Where Newton's method ended: pose, (n, 3) gradients of the points and (3, 3) Hessian in reference axes."""

    T_ref_cur: NDArray[np.float64]
    points: NDArray[np.float64]
    gradients: NDArray[np.float64]
    hessian: NDArray[np.float64]
    inliers: int
    met: int


def _enough(aligned: "_Aligned | NoMatch", share: float) -> bool:
    return not isinstance(aligned, NoMatch) and aligned.inliers >= share * len(aligned.points)


def sandwich(hessian: NDArray[np.float64], spread: NDArray[np.float64], largest: float) -> NDArray[np.float64]:
    """H⁻¹BH⁻¹, each direction of H within bounds.

    Args:
        hessian: (3, 3) H, of the cost.
        spread: (3, 3) B, covariance of its gradient.
        largest: standard deviation that no principal direction of H exceeds, also where its curvature vanishes.

    Returns:
        (3, 3) covariance.
    """
    curvatures, axes = dense.eigh(hessian)
    noise = dense.congruence(axes.T, spread)
    sigmas = np.sqrt(np.maximum(np.diag(noise), 1e-12))
    inverse = 1.0 / np.maximum(curvatures, sigmas / largest)
    along = inverse[:, None] * noise * inverse[None, :] + np.diag(np.full(3, _SMALLEST**2))
    covariance = dense.congruence(axes, along)
    return np.asarray(0.5 * (covariance + covariance.T))

"""CSM: real-time correlative scan matching (Olson, ICRA 2009).

Every pose of a window is a candidate, scored by the likelihood of the beams' ends in a table rendered from the
reference. Max-pooled tables bound whole blocks of candidates, so that the best is found without looking at all of them:
Olson with two resolutions, here in powers of two with branch and bound, as in Cartographer (Hess et al., ICRA 2016).
The scores around the best pose give its covariance.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _csm_kernels as kernels
from frontends.matchers.errors import MatcherError, require
from frontends.matchers.surfaces import weak_directions
from frontends.scan import Scan
from graph import dense
from graph.elementary import exp, log
from graph.measurement import NoMatch, RelativePose
from graph.se2 import transform_points, wrap_angle

_HALF = 2
_SPACING = 1.1
"""Grid spacing of the score volume in standard deviations."""
_ROUNDS = 3


@dataclass(frozen=True, kw_only=True)
class CsmConfig:
    """Settings of correlative matching."""

    cell: float = 0.03
    """Side of a cell of the likelihood table [m]; Olson's fine resolution."""
    sigma: float = 0.04
    """Standard deviation of a beam's end around the reference [m]."""
    reach_sigmas: float = 3.0
    """Beyond this many of them a beam's end is an outlier, whatever its distance."""
    link: float = 0.3
    """Neighbouring returns nearer than this are joined by a line [m] (Olson, ICRA 2015); 0 renders points only."""
    sigmas: float = 3.0
    """The window reaches this many standard deviations of the guess to each side …"""
    min_translation: float = 0.15
    """… and at least this far [m] …"""
    min_rotation: float = 0.1
    """… and this far [rad]."""
    max_translation: float = 4.0
    """The window is never wider than this to each side [m]."""
    min_turn_step: float = 0.004
    """Angles are at least this far apart [rad] …"""
    max_turn_step: float = 0.0175
    """… and at most this; in between, the upper quartile of the ranges moves by one cell."""
    polish_iterations: int = 12
    """Gauss-Newton steps on the interpolated table after the search; 0 leaves the pose on its grid."""
    reach: float = 25.0
    """Reference points farther than this from the newest scan are left out [m]."""
    min_inliers: float = 0.45
    """A match needs at least this share of its points …"""
    inlier_distance: float = 0.1
    """… nearer to the reference than this [m]; at most `reach_sigmas` times `sigma`."""
    independence: float = 0.5
    """Share of the points that count as independent in the scores' weights; calibrated against simulated truth."""
    points: int = 90
    """Points of the scan used for the covariance."""
    max_step: float = 0.1
    """Largest spacing of the score volume; two of them to each side bound the window [m, rad]."""
    weak_facing: float = 0.03
    """A direction is unobservable if the squared cosines between it and the normals are less than this on average."""
    weak_sigma: float = 1.0
    """Standard deviation given to an unobservable direction [m, rad]."""

    def __post_init__(self) -> None:
        for name in ("cell", "sigma", "reach_sigmas", "sigmas", "reach", "independence", "max_step"):
            value = getattr(self, name)
            require(value > 0, f"csm.{name} must be positive, found {value}")
        require(
            0 < self.min_turn_step <= self.max_turn_step,
            f"csm: need 0 < min_turn_step <= max_turn_step, found {self.min_turn_step} and {self.max_turn_step}",
        )
        require(0 <= self.min_inliers <= 1, f"csm.min_inliers must lie in [0, 1], found {self.min_inliers}")
        require(
            0 < self.inlier_distance <= self.reach_sigmas * self.sigma,
            f"csm.inlier_distance must lie in (0, reach_sigmas·sigma], found {self.inlier_distance}",
        )
        require(self.points >= 10, f"csm.points must be at least 10, found {self.points}")


@dataclass(slots=True, kw_only=True)
class LikelihoodTable:
    """Log-likelihood of a beam's end over the reference, and its max-pooled pyramid, made as far as it is needed.

    Attributes:
        table: (rows, columns) uint8.
        origin: (2,) lower left corner [m].
        cell: side of a cell [m].
    """

    table: NDArray[np.uint8]
    origin: NDArray[np.float64]
    cell: float
    _blocks: NDArray[np.uint8] | None = None
    _pyramid: list[NDArray[np.uint8]] = field(default_factory=list)

    def pyramid(self, levels: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The first `levels` levels above the table itself, one after the other, and (levels, 3) their layout."""
        while len(self._pyramid) < levels:
            self._blocks = kernels.halve(self.table if self._blocks is None else self._blocks)
            self._pyramid.append(kernels.cover(self._blocks))
        wanted = self._pyramid[:levels]
        starts = np.cumsum([0, *(level.size for level in wanted[:-1])])
        layout = np.array([(start, *level.shape) for start, level in zip(starts, wanted, strict=True)], dtype=np.int64)
        return np.concatenate([level.ravel() for level in wanted]), layout


class CsmMatcher:
    """Finds the best pose of a window by correlation (implements `Matcher`)."""

    def __init__(self, config: CsmConfig | None = None) -> None:
        self.config = config or CsmConfig()

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> LikelihoodTable:
        """Render the points of all scans, (n, 3) poses, into a likelihood table."""
        if not scans:
            raise MatcherError("a reference needs at least one scan, found none")
        config = self.config
        points = np.concatenate(
            [
                transform_points(pose, kernels.contours(scan.points, config.link, config.cell))
                for scan, pose in zip(scans, T_ref_scans, strict=True)
            ]
        )
        near = np.abs(points - T_ref_scans[-1][:2]).max(axis=1, initial=0.0) < config.reach
        points = np.ascontiguousarray(points[near])
        reach = config.reach_sigmas * config.sigma
        low = points.min(axis=0) - reach if len(points) else np.zeros(2)
        high = points.max(axis=0) + reach if len(points) else np.ones(2)
        origin = np.floor(low / config.cell) * config.cell
        columns, rows = (np.ceil((high - origin) / config.cell).astype(np.int64) + 1).tolist()
        table = np.zeros((rows, columns), np.uint8)
        kernels.render_table(points, origin, config.cell, reach, table)
        return LikelihoodTable(table=table, origin=origin, cell=config.cell)

    def match(
        self,
        reference: LikelihoodTable,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the reference, see `frontends.matcher.Matcher`."""
        points = np.ascontiguousarray(scan.points)
        found = self._search(reference, points, T_ref_guess, covariance_guess)
        if isinstance(found, NoMatch):
            return found
        inliers, known = self._agreeing(reference, points, found)
        covariance, weak = self.covariance(reference, points, found)
        return RelativePose(
            T_ref_cur=found,
            covariance=covariance,
            score=inliers / len(points),
            inliers=inliers,
            overlap=known / len(points),
            weak_directions=weak,
        )

    def track(
        self,
        reference: LikelihoodTable,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        """As `match`, but only the (3,) pose."""
        return self._search(reference, np.ascontiguousarray(scan.points), T_ref_guess, covariance_guess)

    def search(
        self,
        reference: LikelihoodTable,
        points: NDArray[np.float64],
        T_ref_guess: NDArray[np.float64],
        translation: float,
        rotation: float,
    ) -> tuple[NDArray[np.float64], float]:
        """The best pose of a window, on its grid of whole cells.

        Args:
            reference: the table.
            points: (n, 2) of the scan in the robot frame [m].
            T_ref_guess: (3,) middle of the window.
            translation: its half-width in x and y [m].
            rotation: its half-width in heading [rad].

        Returns:
            (3,) pose, and its mean value in the table, in [0, 1].
        """
        turns = self._turns(points, rotation)
        guess = np.asarray(T_ref_guess, dtype=np.float64)
        cells = kernels.turned_cells(points, guess, turns, reference.origin, reference.cell)
        span = max(1, math.ceil(translation / reference.cell))
        levels = max(1, (2 * span).bit_length() - 2)
        best, turn, dr, dc, _ = kernels.branch_and_bound(cells, span, reference.table, *reference.pyramid(levels), -1)
        pose = guess + np.array([dc * reference.cell, dr * reference.cell, turns[turn]])
        return pose, best / (kernels.FULL * len(points))

    def covariance(
        self, reference: LikelihoodTable, points: NDArray[np.float64], T_ref_cur: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Second moment Σ = K/s − uuᵀ/s² of the likelihood around a pose (Olson 2009, equation 11).

        The grid of poses follows the principal directions of the moment found the round before, so that it resolves
        the peak whatever its shape. What lies outside its largest window is not seen. Lone points are left out: they
        coincide with lone points of the reference in some places along a wall, which looks like a peak and is none.

        Args:
            reference: the table.
            points: (n, 2) of the scan in the robot frame [m].
            T_ref_cur: (3,) the best pose.

        Returns:
            (3, 3) in the tangent space at the pose, and (k, 3) directions along which the scores do not fall off.
        """
        config = self.config
        points = _on_surfaces(points, config.link)
        axes, steps = np.eye(3), np.array([0.02, 0.02, 0.01])
        stride = max(1, len(points) // config.points)
        # log-likelihood of all points = −½·reach_sigmas²·Σ(1 − value)
        sharpness = 0.5 * config.reach_sigmas**2 * len(points) * config.independence
        volume = np.empty((2 * _HALF + 1,) * 3)
        for _ in range(_ROUNDS):
            kernels.score_volume(
                points,
                T_ref_cur,
                axes,
                steps,
                _HALF,
                reference.table,
                reference.origin,
                reference.cell,
                stride,
                volume,
            )
            weights = exp(sharpness * (volume - volume.max()))
            moment = _moment(weights / weights.sum(), steps)
            moment += np.diag((steps / 5.0) ** 2)
            observed = dense.congruence(axes, moment)
            variances, turn = dense.eigh(moment)
            new_steps = np.clip(_SPACING * np.sqrt(variances), 2e-4, config.max_step)
            if np.abs(log(new_steps / np.sort(steps))).max() < 0.1:
                break
            axes, steps = dense.matmul(axes, turn), new_steps
        weak = weak_directions(points, config.link, config.weak_facing)
        covariance = observed + config.weak_sigma**2 * dense.matmul(weak.T, weak)
        return 0.5 * (covariance + covariance.T), weak

    def _search(
        self,
        reference: LikelihoodTable,
        points: NDArray[np.float64],
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        config = self.config
        if len(points) < 10:
            return NoMatch(reason=f"only {len(points)} beams returned")
        widest = max(float(covariance_guess[0, 0]), float(covariance_guess[1, 1]))
        translation = min(max(config.min_translation, config.sigmas * math.sqrt(widest)), config.max_translation)
        rotation = min(max(config.min_rotation, config.sigmas * math.sqrt(float(covariance_guess[2, 2]))), math.pi)
        pose, _ = self.search(reference, points, T_ref_guess, translation, rotation)
        if config.polish_iterations:
            pose = kernels.polish(
                points, pose, reference.table, reference.origin, reference.cell, config.polish_iterations
            )
        pose[2] = wrap_angle(float(pose[2]))
        inliers, _ = self._agreeing(reference, points, pose)
        if inliers < config.min_inliers * len(points):
            return NoMatch(reason=f"only {inliers / len(points):.0%} of the beams agree with the reference")
        return pose

    def _turns(self, points: NDArray[np.float64], rotation: float) -> NDArray[np.float64]:
        """Angles of the window, the guess itself among them [rad]."""
        far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.75))
        step = min(max(self.config.cell / max(far, 1e-3), self.config.min_turn_step), self.config.max_turn_step)
        half = math.ceil(rotation / step)
        return np.asarray(np.arange(-half, half + 1) * (rotation / half), dtype=np.float64)

    def _agreeing(
        self, reference: LikelihoodTable, points: NDArray[np.float64], T_ref_cur: NDArray[np.float64]
    ) -> tuple[int, int]:
        least = 1.0 - (self.config.inlier_distance / (self.config.reach_sigmas * self.config.sigma)) ** 2
        high, some = kernels.count_values(
            points, np.asarray(T_ref_cur, dtype=np.float64), reference.table, reference.origin, reference.cell, least
        )
        return int(high), int(some)


def _on_surfaces(points: NDArray[np.float64], link: float) -> NDArray[np.float64]:
    """The points that have a neighbour nearer than `link` [m]; all, where hardly any has."""
    near = np.hypot(*np.diff(points, axis=0).T) < link
    joined = np.append(near, False) | np.insert(near, 0, False)
    return np.ascontiguousarray(points[joined]) if np.count_nonzero(joined) >= 10 else points


def _moment(weights: NDArray[np.float64], steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) Σ = K/s − uuᵀ/s² of normalised weights on a grid."""
    offsets = np.arange(-_HALF, _HALF + 1, dtype=np.float64)
    marginals = [weights.sum(axis=tuple(k for k in range(3) if k != i)) for i in range(3)]
    u = np.array([dense.vecdot(marginal, offsets) for marginal in marginals])
    second = np.diag([dense.vecdot(marginal, offsets**2) for marginal in marginals])
    for i, j in ((0, 1), (0, 2), (1, 2)):
        second[i, j] = second[j, i] = dense.vecdot(np.outer(offsets, offsets), weights.sum(axis=3 - i - j))
    return np.asarray((second - np.outer(u, u)) * np.outer(steps, steps), dtype=np.float64)

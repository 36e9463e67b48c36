"""Joint refinement of poses and map: the points of all key scans on the walls they share, every pose at once.

Matches tell how two key scans lie to each other, and the graph takes them for independent; yet all of them rest on
the same points. Here the points speak for themselves: pieces of wall are unknowns beside the poses (bundle adjustment),
every scan that sees a piece holds its line, and the line holds them together, along the path as across its passes.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from frontends.scan import Scan
from graph.arrays import Floats, Ints
from graph.dense import vecdot
from graph.factors import Factor
from graph.problem import Linearization, Problem
from graph.se2 import between, compose, expmap, inverse, logmap
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice._normal_kernels import Evenness
from iceg.ice.noise import PLAIN
from iceg.ice.points import thinned_points
from iceg.memory import release_freed_memory
from iceg.slam.joint import _wall_kernels as kernels
from iceg.slam.joint._system_kernels import JointSystem, product
from iceg.slam.joint.covariance import PoseInformation, Walls, joint_information
from iceg.slam.joint.wall_claims import believed_covariances, variance_factor
from iceg.slam.joint.wall_pieces import WallPieces
from iceg.slam.joint_config import JointRefinementConfig
from iceg.slam.track import Track

_LINE_ROUNDS = 3
"""Of weighing points anew for a line."""
_APART = 1e5
"""Between parts that share nothing [m]."""
_TOLERANCE, _MOST_PRODUCTS = 0.03, 60
"""Conjugate gradients stop at this share of the first residual: with a tenth, the first pose, which few points hold
along a corridor, stays behind. At most so many products are taken."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointRefinement:
    """What the joint refinement did.

    Attributes:
        poses: (k, 3) T_map_robot of the key poses.
        error_before: half the sum of squared whitened residuals of the graph's factors at the start …
        error: … and in the end.
        residual_before: weighted root mean square distance of the points from the walls at the start [m] …
        residual: … and in the end [m].
        share: how much of the way from the graph's optimum to that of the points the steps went, 0 to 1: the least that
            one of them did.
        variance_factor: by which walls and factors contradict each other; in the covariances.
        covariances: (k, 3, 3) marginal covariances of the poses in the end, None if the points do not determine them.
        information: what the covariances rest on, None where they are.
        walls: the pieces of wall in the end, in the frame of the poses.
    """

    poses: Floats
    error_before: float
    error: float
    residual_before: float
    residual: float
    walls: WallPieces
    share: float
    variance_factor: float = 1.0
    covariances: Floats | None = None
    information: PoseInformation | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Clouds:
    """The points of scans that hang on key poses.

    Attributes:
        points: (n, 2) robot frames of the scans [m].
        normals: (n, 2) of the surfaces they lie on; 0, 0 where unknown.
        errors: (n, 2) standard deviations along their beams, beyond what the settings allow for [m].
        spreads: (n,) variance of each in that of a typical point.
        starts: (m + 1,) scan j has the points from starts[j] to starts[j + 1].
        key_of_scan: (m,) the key pose of each scan, increasing; each key pose has at least one.
        T_key_scan: (m, 3).
        stand_for: how many points each stands for: in long logs, most are left out.
        variance_scale: by how much their variances exceed what they say.
    """

    points: Floats
    normals: Floats
    errors: Floats
    spreads: Floats
    starts: Ints
    key_of_scan: Ints
    T_key_scan: Floats
    stand_for: float = 1.0
    variance_scale: float = 1.0

    @property
    def key_starts(self) -> Ints:
        """(k + 1,) first point of each key pose."""
        first = np.flatnonzero(np.diff(self.key_of_scan, prepend=-1))
        return np.append(self.starts[first], self.starts[-1])

    def without(self, keys: Collection[int]) -> "Clouds":
        """The same, the points of some key poses lying on no wall."""
        if not keys:
            return self
        silent = np.repeat(np.isin(self.key_of_scan, sorted(keys)), np.diff(self.starts))
        return replace(self, normals=np.where(silent[:, None], 0.0, self.normals))


def refine_jointly(
    factors: Sequence[Factor],
    poses: Floats,
    clouds: Clouds,
    config: JointRefinementConfig,
    parts: Sequence[int] = (),
    believed: Sequence[Factor] | None = None,
) -> JointRefinement:
    """Gauss-Newton on the distances of all points from the walls they share, plus the graph's factors.

    Args:
        factors: of the graph.
        poses: (k, 3) its optimum, T_map_robot of the key poses.
        clouds: the points of each.
        config: pieces of wall and steps.
        parts: key poses at which a part begins that nothing ties to what was before: it shares no walls with it.
        believed: the factors with the covariances that those of the poses rest on, if they are others.

    Returns:
        The refined poses, the first where it was; all as given if the points lie no better on the walls then.
    """
    problem = Problem.of(factors, len(poses))
    part_of = np.searchsorted(np.asarray(parts, dtype=np.int64), np.arange(len(poses)), side="right")
    sight = _Sight(clouds, config, part_of)
    first = sight.walls(poses)
    refined, walls, shares = _descended(problem, poses, first, sight)
    # Judged on the pieces of the start: grouping anew changes the figures by chance.
    last = walls if walls.piece_of is first.piece_of else sight.walls(refined, first)
    share = min(shares, default=0.0)
    if last.on_walls < first.on_walls:
        refined, share = poses, 0.0
        last = sight.walls(poses, first)
    known, residual_before = factors if believed is None else believed, first.residual
    del first, walls, sight  # the covariances of a long run need more memory than any other stage
    release_freed_memory()
    # As a whole the map may move, held by the prior alone: put the first pose back.
    back = compose(poses[0], inverse(refined[0]))
    information, covariances, factor = _covariances(known, poses, refined, back, share, clouds, last, config)
    refined = compose(back, refined) if shares else poses
    return JointRefinement(
        poses=refined,
        error_before=float(problem.evaluate(poses).losses.sum()),
        error=float(problem.evaluate(refined).losses.sum()),
        residual_before=residual_before,
        residual=last.residual,
        walls=WallPieces.of(last, clouds.spreads, clouds.key_starts, back, config.on_wall_weight),
        share=share,
        variance_factor=factor,
        covariances=covariances,
        information=information,
    )


def _descended(problem: Problem, poses: Floats, walls: Walls, sight: "_Sight") -> tuple[Floats, Walls, list[float]]:
    """Steps from (k, 3) poses until they move no more: poses and walls there, and the points' share in each step."""
    clouds, config = sight.clouds, sight.config
    shares: list[float] = []
    pull = _Pull.of(clouds, walls, poses, config)
    while len(shares) < config.steps and len(walls.lines):
        step = config.over_relaxation * _step(pull, problem.linearized(poses))
        poses = compose(poses, expmap(step))
        moved = np.hypot(step[:, 0], step[:, 1]).mean()
        walls = sight.walls(poses, walls if moved < config.regroup_cells * config.cell else None)
        before, pull = pull, _Pull.of(clouds, walls, poses, config)
        shares.append(_share(step, before, pull, config.over_relaxation))
        if moved < config.tolerance:
            break
    return poses, walls, shares


def _covariances(
    factors: Sequence[Factor],
    start: Floats,
    poses: Floats,
    back: Floats,
    share: float,
    clouds: Clouds,
    walls: Walls,
    config: JointRefinementConfig,
) -> tuple[PoseInformation, Floats, float] | tuple[None, None, float]:
    """Of poses that went a share of the way from the optimum of the graph to that of the points, and their factor.

    Of points far away, where noise decides which return at all, nothing is believed.
    """
    if not len(walls.lines):
        return None, None, 1.0
    near = np.hypot(clouds.points[:, 0], clouds.points[:, 1]) <= config.telling_reach
    told = replace(walls, weights=np.where(near, walls.weights, 0.0)).running_on(config)
    precision = _precision(clouds, walls, config) * max(1.0, clouds.stand_for / config.correlated_points) ** (2.0 / 3.0)
    try:
        information = joint_information(factors, poses, clouds.key_starts, told, precision)
    except np.linalg.LinAlgError:
        return None, None, 1.0
    graph = Problem.of(factors, len(start)).marginal_covariances(start)
    covariances = believed_covariances(information.covariances, graph, share)
    way = logmap(between(start, compose(back, poses)))
    factor = variance_factor(way, graph, covariances, config.contradiction_prior)
    return information, factor * covariances, factor


def _precision(clouds: Clouds, walls: Walls, config: JointRefinementConfig) -> float:
    """Of one point of weight 1 [1/m²]."""
    return float(config.independence / clouds.variance_scale / max(walls.residual, config.min_residual) ** 2)


def key_clouds(
    track: Track, scan_of: Callable[[int], Scan], config: JointRefinementConfig, noise: RangeNoise = PLAIN
) -> Clouds:
    """The points of each key scan, and of some scans between it and the next, which hang on it rigidly.

    Args:
        track: what the front end found.
        scan_of: the scans of the log by index.
        config: how many scans and points.
        noise: of the ranges beyond what the settings allow for.

    Returns:
        The points; those beyond reach have no normal.
    """
    n_keys, n_beams = len(track.keys), track.keys[0].scan.geometry.n_beams
    affordable = max(1, config.max_thinning * config.max_points // (n_keys * n_beams))
    members = _members(track, min(config.scans_per_key, affordable))
    scans = [index for some in members for index in some]
    every = max(1, -(-len(scans) * n_beams // config.max_points))
    taken = [
        key.scan if index == key.index else scan_of(index)
        for key, some in zip(track.keys, members, strict=True)
        for index in some
    ]
    key_of_scan = np.repeat(np.arange(len(members)), [len(some) for some in members])
    offsets = np.concatenate([np.arange(len(some)) % every for some in members])
    even = Evenness(roughness=config.roughness, factor=config.evenness)
    seen = thinned_points(taken, offsets, every, even, noise=noise)
    points, normals, spreads = seen.points, seen.normals, seen.spreads
    normals[np.hypot(points[:, 0], points[:, 1]) > config.reach] = 0.0
    # One that errs by more would meet, on either side of its wall, only those that err as it does.
    normals[spreads * (noise.allowed + noise.typical) > config.half_width**2] = 0.0
    T_key_scan = track.T_key_scan[scans]
    T_key_scan[np.diff(key_of_scan, prepend=-1) > 0] = 0.0
    available = int(np.minimum(np.bincount(track.key_of_scan, minlength=n_keys), config.scans_per_key).sum())
    return Clouds(
        points=points,
        normals=normals,
        errors=seen.errors,
        spreads=spreads,
        starts=seen.starts,
        key_of_scan=key_of_scan,
        T_key_scan=T_key_scan,
        stand_for=max(1.0, available * every / len(scans)),
    )


def _members(track: Track, most: int) -> list[list[int]]:
    """For each key scan its index and those of up to `most` - 1 scans tied to it, evenly spread."""
    bounds = np.searchsorted(track.key_of_scan, np.arange(len(track.keys) + 1)).tolist()
    members = []
    for key, first, last in zip(track.keys, bounds, bounds[1:], strict=False):
        first_other = max(key.index + 1, first)
        spread = _spread(max(0, last - first_other), most - 1)
        members.append([key.index, *(first_other + step for step in spread)])
    return members


@lru_cache
def _spread(n: int, most: int) -> tuple[int, ...]:
    """At most so many of n places in a row, evenly spread."""
    return tuple(np.linspace(0, n - 1, min(most, n)).round().astype(int).tolist())


class _Sight:
    """Looks for the walls that scans at given poses see.

    Every look overwrites the points, residuals and weights of the last: new arrays cost more than what they hold.
    """

    def __init__(self, clouds: Clouds, config: JointRefinementConfig, part_of: Ints) -> None:
        """Of scans of (k,) parts, which share no walls."""
        self.clouds, self.config = clouds, config
        # Far apart, parts share nothing.
        self._apart = np.repeat(_APART * part_of, np.diff(clouds.key_starts)) if part_of.any() else None
        n = len(clouds.points)
        self._placed = kernels.Points(np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2)))
        self._surfel_of = np.empty(n, np.int64)
        self._residuals, self._weights = np.empty(n), np.empty(n)

    def walls(self, poses: Floats, grouped: Walls | None = None) -> Walls:
        """Pieces of wall with the scans at (k, 3) poses; the points are grouped anew unless by walls seen before."""
        clouds, config = self.clouds, self.config
        T_map_scans = compose(poses[clouds.key_of_scan], clouds.T_key_scan)
        seen = kernels.Points(clouds.points, clouds.normals, clouds.errors)
        kernels.place(T_map_scans, clouds.starts, seen, self._placed)
        piece_of, n_pieces = self._pieces() if grouped is None else (grouped.piece_of, len(grouped.lines))
        lines = np.empty((n_pieces, 4))
        total, squares = kernels.fit_lines(
            self._placed,
            clouds.spreads,
            piece_of,
            kernels.LineFit(config.scale, _LINE_ROUNDS, config.elongation, config.facing),
            lines,
            self._residuals,
            self._weights,
        )
        return Walls(
            placed=self._placed.points,
            errors=self._placed.errors,
            piece_of=piece_of,
            lines=lines,
            residuals=self._residuals,
            weights=self._weights,
            roughness=config.roughness,
            on_walls=total / max(1, int(np.count_nonzero(piece_of >= 0))),
            residual=float(np.sqrt(squares / max(total, 1e-9))),
            bends=np.zeros((n_pieces, 2)),
        )

    def _pieces(self) -> tuple[Ints, int]:
        """(n,) piece of each point, -1 without a normal, and how many; the surfel with most points begins the first."""
        placed, config = self._placed.points, self.config
        if len(placed) == 0:
            return np.empty(0, np.int64), 0
        if self._apart is not None:
            placed = placed + np.column_stack([self._apart, np.zeros(len(placed))])
        surfels, keys, surfel_at = kernels.surfels(
            placed, self._placed.normals, config.cell, config.cell_facing, self._surfel_of
        )
        order = np.argsort(-surfels[:, 4], kind="stable")
        piece = np.empty(len(surfels) + 1, np.int64)
        n_pieces = kernels.group(
            surfels,
            order,
            config.cell,
            config.half_length,
            config.half_width,
            config.facing,
            keys,
            surfel_at,
            piece[:-1],
        )
        piece[-1] = -1
        return piece[self._surfel_of], n_pieces


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pull:
    """How the points pull at the poses, as their normal equations say.

    Attributes:
        system: of the points.
        n_lines: how many lines were eliminated.
        precision: of one point of weight 1 [1/m²].
    """

    system: JointSystem
    n_lines: int
    precision: float

    @classmethod
    def of(cls, clouds: Clouds, walls: Walls, poses: Floats, config: JointRefinementConfig) -> "_Pull":
        """Of the points of scans at (k, 3) poses."""
        return cls(
            system=walls.normal_equations(poses, clouds.key_starts),
            n_lines=len(walls.lines),
            precision=_precision(clouds, walls, config),
        )

    @property
    def gradient(self) -> Floats:
        """(k, 3)."""
        return self.precision * self.system.gradient

    def times(self, x: Floats) -> Floats:
        """(k, 3) H x."""
        return np.asarray(self.precision * product(self.system, self.n_lines, x))


def _step(pull: _Pull, graph: Linearization) -> Floats:
    """(k, 3) Gauss-Newton step of points and factors together, in the tangent space at each pose."""

    def times(x: Floats) -> Floats:
        return np.asarray(pull.times(x) + graph.times(x))

    return _conjugate_gradients(times, graph, -(pull.gradient + graph.gradient))


def _share(step: Floats, before: _Pull, after: _Pull, over_relaxation: float) -> float:
    """How much of the way to the optimum of the points a step went, that was taken so many times longer.

    The normal equations take lines and weights as they are; both follow the points, and little of the pull may be left
    where few surfaces face along the step s. If the gradient of the points changes along it by κ sᵀH s instead of
    sᵀH s, the optimum is 1 / κ times as far away as a full step goes.
    """
    expected = vecdot(step, before.times(step))
    if expected <= 0.0:  # there was nothing left to go
        return 1.0
    return float(np.clip(over_relaxation * vecdot(step, after.gradient - before.gradient) / expected, 0.0, 1.0))


def _conjugate_gradients(times: Callable[[Floats], Floats], graph: Linearization, right: Floats) -> Floats:
    """Solve A x = right; the graph alone, which has nearly the same soft directions, is the preconditioner."""
    x = np.zeros_like(right)
    left = right
    direction = scaled = graph.solve(left)
    size = first = vecdot(left, scaled)
    for _ in range(_MOST_PRODUCTS):
        if size <= _TOLERANCE**2 * first:
            break
        product = times(direction)
        length = size / vecdot(direction, product)
        x = x + length * direction
        left = left - length * product
        scaled = graph.solve(left)
        before, size = size, vecdot(left, scaled)
        direction = scaled + (size / before) * direction
    return x

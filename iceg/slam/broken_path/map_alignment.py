"""How the maps of two parts of a path may lie to each other, whatever the path says between them.

A scan sees little, a part of the path has a map. Laid onto the map of another part at the right place nearly all of its
walls lie on walls and none in open space, where the other has seen what is there, and so the other way round. How far
that makes any relative pose more probable than that the parts have nothing to do with each other is a sum over cells;
the Fourier transform tells it of all shifts at once, rotation by rotation (map merging; Carpin, Fast and accurate map
merging for multi-robot systems, 2008, weighs overlap so, too). Weights are whole numbers, so that sums are exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, log, pi

import numpy as np

from frontends.scan import Scan
from graph.arrays import Bools, Floats, Ints
from graph.se2 import compose, transform_points
from iceg.slam.agreement import agree
from iceg.slam.closure_config import MapAlignmentConfig


class PartMaps:
    """The maps of two parts of a path, and what any way of laying one onto the other tells."""

    def __init__(
        self, scans: Sequence[Scan], poses: Floats, fixed: Ints, moving: Ints, config: MapAlignmentConfig
    ) -> None:
        """Collect what both have seen.

        Args:
            scans: k of one laser.
            poses: (k, 3) T_map_robot, good within each part.
            fixed: (n,) the scans of one part.
            moving: (m,) those of the other.
            config: how finely.
        """
        self._scans, self._poses, self._config = scans, poses, config
        self._there, self._here = (_rays(scans, poses, part, config) for part in (fixed, moving))

    @property
    def are_empty(self) -> bool:
        """Whether either has seen nothing."""
        return not len(self._there.ends) or not len(self._here.ends)

    @property
    def middle(self) -> Floats:
        """(2,) of what the second part has seen [m]."""
        return np.asarray(self._here.ends.mean(axis=0))

    def log_odds(self, correction: Floats) -> float:
        """What a way of laying the second map onto the first tells.

        Args:
            correction: (3,) moves the poses of the second part, in the map.

        Returns:
            How many times as probable what both show is as if they had nothing to do with each other, the logarithm,
            as if cells told independently of each other.
        """
        return self._fine.total(correction) / self._config.resolution

    def log_odds_of_each(self, keys: Ints, correction: Floats) -> Floats:
        """(m,) the same by each of (m,) scans alone."""
        each = (_rays(self._scans, self._poses, keys[k : k + 1], self._config) for k in range(len(keys)))
        totals = [self._fine.total(correction, rays) if len(rays.ends) else 0.0 for rays in each]
        return np.array(totals) / self._config.resolution

    def alignments(self) -> list[Floats]:
        """The ways in which the second map fits the first, the best first: (3,) each, moves the poses of the second."""
        found = sorted(
            self._coarse.best(self.middle, ceil(self._config.apart / self._coarse.cell)), key=lambda p: -p[0]
        )
        kept: list[Floats] = []
        for score, pose in found:
            if score <= 0.0 or len(kept) == self._config.most:
                break
            if not any(agree(pose, other, self._config.one_way) for other in kept):
                kept.append(pose)
        back = np.array([*-self.middle, 0.0])
        return [compose(pose, back) for pose in kept]

    @cached_property
    def _fine(self) -> "_Overlay":
        return self._overlay(self._config.most_compared)

    @cached_property
    def _coarse(self) -> "_Overlay":
        return self._overlay(self._config.most_cells)

    def _overlay(self, most_cells: int) -> "_Overlay":
        """Both maps, no wider than so many cells."""
        width = max(self._there.width, self._here.width)
        return _Overlay(self._there, self._here, max(self._config.cell, width / most_cells), self._config)


@dataclass(frozen=True, slots=True)
class _Rays:
    """Beams of a part: (n, 2) where each one ended, and from where it came [m]."""

    ends: Floats
    origins: Floats

    @property
    def width(self) -> float:
        """The longer side of what was seen [m]."""
        return float((self.ends.max(axis=0) - self.ends.min(axis=0)).max())

    def cells(self, cell: float, least_share: float) -> "_Cells":
        """What they tell of the cells they pass."""
        along = self.ends - self.origins
        length = np.hypot(*along.T)
        steps = np.arange(0.5 * cell, max(float(length.max()), cell), cell)
        beam, step = np.nonzero(steps[None, :] < length[:, None] - 1.5 * cell)
        passed = self.origins[beam] + along[beam] * (steps[step] / length[beam])[:, None]
        extent = np.vstack([self.ends, self.origins])
        corner = extent.min(axis=0) - cell
        size = np.floor((extent.max(axis=0) - corner) / cell).astype(np.int64) + 2
        hits, misses = (_histogram(_cells_of(points - corner, cell), size) for points in (self.ends, passed))
        return _Cells(corner, hits > least_share * (hits + misses), (misses > 0) & (hits == 0))


@dataclass(frozen=True, slots=True)
class _Cells:
    """What a part has seen: its corner (2,) [m], and which cells, (n, m), are occupied, and which free."""

    corner: Floats
    occupied: Bools
    free: Bools

    def centres(self, cell: float) -> tuple[Floats, Floats]:
        """(n, 2) of the occupied cells and (m, 2) of the free ones [m]."""
        occupied, free = (self.corner + (np.argwhere(which) + 0.5) * cell for which in (self.occupied, self.free))
        return occupied, free


class _Overlay:
    """One map over another, in cells of one size."""

    def __init__(self, there: _Rays, here: _Rays, cell: float, config: MapAlignmentConfig) -> None:
        below = there.cells(cell, config.least_share)
        self.cell = cell
        self._least_share = config.least_share
        self._each_rotation = config.each_rotation
        self._corner = below.corner
        self._walls, self._space = _weights(below, config)
        self._occupied, self._free = here.cells(cell, config.least_share).centres(cell)

    def total(self, correction: Floats, here: _Rays | None = None) -> float:
        """Sum of the weights below the upper map, or what some beams tell, moved so."""
        occupied, free = self._occupied, self._free
        if here is not None:
            occupied, free = here.cells(self.cell, self._least_share).centres(self.cell)
        total = 0.0
        for centres, weights in ((occupied, self._walls), (free, self._space)):
            cells = _cells_of(transform_points(correction, centres) - self._corner, self.cell)
            inside = (cells >= 0).all(axis=1) & (cells < weights.shape).all(axis=1)
            total += float(weights[tuple(cells[inside].T)].sum())
        return total

    def best(self, middle: Floats, apart: int) -> list[tuple[float, Floats]]:
        """The best shifts of each rotation.

        Args:
            middle: (2,) about which the upper map is turned.
            apart: cells between two shifts of one rotation.

        Returns:
            Sum of the weights, and where that puts the middle, (3,).
        """
        from scipy import fft  # 0.07 s, and most paths are whole

        occupied, free = self._occupied - middle, self._free - middle
        if not len(occupied):
            return []
        far = np.hypot(*occupied.T)
        half = ceil(max(float(far.max()), float(np.hypot(*free.T).max(initial=0.0))) / self.cell) + 1
        rows, cols = self._walls.shape
        shape = fft.next_fast_len(rows + 2 * half, real=True), fft.next_fast_len(cols + 2 * half, real=True)
        walls, space = fft.rfft2(self._walls, shape), fft.rfft2(self._space, shape)
        count = max(8, ceil(pi * float(np.quantile(far, 0.9)) / self.cell))  # walls a cell beside count, too
        size = np.array([2 * half, 2 * half])
        found = []
        for angle in (2.0 * pi / count * np.arange(count)).tolist():
            turned = np.array([0.0, 0.0, angle])
            above, open_above = (
                np.conj(fft.rfft2(_histogram(_cells_of(transform_points(turned, each), self.cell) + half, size), shape))
                for each in (occupied, free)
            )
            scores = np.rint(fft.irfft2(walls * above + space * open_above, shape))
            for _ in range(self._each_rotation):
                row, col = divmod(int(scores.argmax()), shape[1])
                shift = np.array([row - shape[0] * (row >= rows), col - shape[1] * (col >= cols)]) + half
                found.append((float(scores[row, col]), np.append(self._corner + shift * self.cell, angle)))
                _take_out(scores, row, col, apart)
        return found


def _rays(scans: Sequence[Scan], poses: Floats, part: Ints, config: MapAlignmentConfig) -> _Rays:
    """Beams of some, (n,), of the scans, taken at (k, 3) poses."""
    ends, origins = [np.zeros((0, 2))], [np.zeros((0, 2))]
    every = -(-len(part) * scans[0].geometry.n_beams // config.most_rays)
    for index in part.tolist():
        scan, first = scans[index], index % every
        ranges = scan.ranges[first::every].astype(np.float64)
        returned = np.isfinite(ranges) & (ranges < config.reach)
        origin = scan.geometry.origin_robot
        seen = origin + ranges[returned, None] * scan.geometry.directions_robot[first::every][returned]
        ends.append(transform_points(poses[index], seen))
        origins.append(np.broadcast_to(transform_points(poses[index], origin[None]), seen.shape))
    return _Rays(np.vstack(ends), np.vstack(origins))


def _weights(below: _Cells, config: MapAlignmentConfig) -> tuple[Floats, Floats]:
    """(n, m) what an occupied cell tells that falls onto each of a map's cells, and what a free one does.

    A wall may lie a cell beside where it is; of a wall, free space tells only at the cell itself.
    """
    near, agree = _grown(below.occupied), config.agree
    walls, space = np.zeros(near.shape), np.zeros(near.shape)
    for weights, on, off in ((walls, near, below.free & ~near), (space, below.free, below.occupied)):
        n_on, n_off = int(on.sum()), int(off.sum())
        usual = min(max(n_on / max(1, n_on + n_off), 1.0 - agree), agree)
        weights[on] = round(config.resolution * log(agree / usual))
        weights[off] = round(config.resolution * log((1.0 - agree) / (1.0 - usual)))
    return walls, space


def _cells_of(points: Floats, cell: float) -> Ints:
    return np.floor(points / cell).astype(np.int64)


def _histogram(cells: Ints, size: Ints) -> Ints:
    """How many of (n, 2) cells are each of a grid."""
    counts = np.bincount(cells[:, 0] * size[1] + cells[:, 1], minlength=int(size[0] * size[1]))
    return counts.reshape(int(size[0]), int(size[1]))


def _grown(cells: Bools) -> Bools:
    """The same with their eight neighbours."""
    grown = np.zeros((cells.shape[0] + 2, cells.shape[1] + 2), np.bool_)
    for row in range(3):
        for col in range(3):
            grown[row : row + cells.shape[0], col : col + cells.shape[1]] |= cells
    return grown[1:-1, 1:-1]


def _take_out(scores: Floats, row: int, col: int, reach: int) -> None:
    """Leave a place and what is near it out of (n, m) scores, which go round at their borders."""
    rows, cols = ((at + np.arange(-reach, reach + 1)) % n for at, n in zip((row, col), scores.shape, strict=True))
    scores[np.ix_(rows, cols)] = -np.inf

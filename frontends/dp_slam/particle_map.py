"""The maps of all particles in one grid: ancestry tree, observations, and the caches of a generation."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam import _ancestry_kernels, _beam_kernels
from frontends.dp_slam.config import DpSlamConfig, DpSlamError


class ParticleMaps:
    """One grid whose cells keep observations keyed by ancestor, and the tree that says whose they are.

    It begins with one particle, the root. Layouts are those of `_beam_kernels`.
    """

    def __init__(self, half_extent: float, n_beams: int, config: DpSlamConfig) -> None:
        side = 2 * math.ceil(half_extent / config.resolution)
        if side * side > config.max_cells:
            raise DpSlamError(
                f"the log spans a square of {2 * half_extent:.0f} m, {side * side} cells of {config.resolution} m; at"
                f" most max_cells = {config.max_cells} are allowed"
            )
        self._config = config
        self._shape = (side, side)
        self._origin = -0.5 * side * config.resolution
        self._longest = n_beams * (2 * math.ceil(config.max_range / config.resolution) + 4)
        self._heads = np.full(side * side, -1, np.int32)
        self._row_of = np.full(side * side, -1, np.int32)
        self._view_of = np.full(side * side, -1, np.int32)
        n_nodes = 2 * config.particles + 2
        self._parents = np.full(n_nodes, -1, np.int32)
        self._children = np.full(n_nodes, -1, np.int32)
        self._firsts = np.full(n_nodes, -1, np.int32)
        self._scratch = np.empty(n_nodes + config.particles, np.int32)
        self._children[0] = 0
        self._leaves = np.zeros(1, np.int32)
        self._order = np.zeros(1, np.int32)
        self._owners, self._places = np.empty(0, np.int32), np.empty(0, np.int32)
        self._in_cell, self._of_node = np.empty(0, np.int32), np.empty(0, np.int32)
        self._back = np.empty(0, np.int32)
        self._evidence = np.empty((0, 2), np.float32)
        self._pool = np.array([-1, 0], np.int32)
        self._rows, self._rowed = np.empty((0, config.particles), np.int32), np.empty(0, np.int32)
        self._facts = np.empty((0, 2), np.int32)
        self._viewed = np.empty(4 * self._longest, np.int32)
        self._densities = np.empty((self._longest, config.particles), np.float32)
        self._used = np.zeros(3, np.int64)
        self._died = self._merged = self._most_nodes = self._most_observations = 0

    def in_cells(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) poses with x and y in cells of the grid."""
        scaled = np.array(poses)
        scaled[:, :2] = (poses[:, :2] - self._origin) / self._config.resolution
        return scaled

    def log_likelihoods(
        self,
        lasers: NDArray[np.float64],
        particle_of: NDArray[np.int32],
        directions: NDArray[np.float64],
        readings: NDArray[np.float64],
        returned: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], int]:
        """How well a scan fits each sample, in the map of its particle.

        Args:
            lasers: (n, 3) x, y [cells], heading [rad].
            particle_of: (n,) particle of each.
            directions: (n_beams, 2) of the beams at the laser.
            readings: (n_beams,) [cells].
            returned: (n_beams,) whether each met an obstacle.

        Returns:
            (n,) log-likelihoods, −inf for those culled; and how many survived the quick evaluation.
        """
        config, cell = self._config, self._config.resolution
        scores = np.empty(len(lasers))
        while True:
            survivors = _beam_kernels.localise(
                lasers,
                particle_of,
                directions,
                readings,
                returned,
                config.passes,
                config.cull,
                config.floor,
                config.quick_before / cell,
                config.quick_beyond / cell,
                config.trace_margin / cell,
                config.max_range / cell,
                self._shape,
                config.prior_density * cell,
                config.range_variance / cell**2,
                self._heads,
                self._owners,
                self._in_cell,
                self._evidence,
                self._parents,
                self._order,
                self._leaves,
                self._scratch,
                self._row_of,
                self._rows,
                self._facts,
                self._view_of,
                self._viewed,
                self._densities,
                self._used,
                scores,
            )
            if survivors >= 0:
                return scores, int(survivors)
            self._viewed = np.concatenate([self._viewed, np.empty_like(self._viewed)])
            self._densities = np.concatenate([self._densities, np.empty_like(self._densities)])

    def descend(self, parent_of: NDArray[np.int32]) -> None:
        """Go on to the next generation.

        Args:
            parent_of: (n,) from which old particle each new one descends, in ascending order.
        """
        _beam_kernels.forget(self._used, self._row_of, self._rowed, self._view_of, self._viewed)
        kept = np.bincount(parent_of, minlength=len(self._leaves)).astype(np.int64)
        died, merged = _ancestry_kernels.prune(
            self._leaves,
            kept,
            self._heads,
            self._owners,
            self._places,
            self._in_cell,
            self._back,
            self._of_node,
            self._evidence,
            self._pool,
            self._parents,
            self._children,
            self._firsts,
        )
        self._died += int(died)
        self._merged += int(merged)
        free = iter(np.flatnonzero(self._children < 0).tolist())
        leaves = np.empty(len(parent_of), np.int32)
        for new, old in enumerate(parent_of.tolist()):
            above = int(self._leaves[old])
            if kept[old] == 1:  # the only child of its parent is the parent
                leaves[new] = above
                continue
            node = next(free)
            leaves[new] = node
            self._parents[node], self._children[node], self._firsts[node] = above, 0, -1
            self._children[above] += 1
        self._leaves = leaves
        self._order = _ancestry_kernels.tree_order(self._parents, self._children)
        self._most_nodes = max(self._most_nodes, len(self._order))

    def add(
        self,
        lasers: NDArray[np.float64],
        directions: NDArray[np.float64],
        readings: NDArray[np.float64],
        returned: NDArray[np.bool_],
    ) -> None:
        """Add a scan to the map of every particle.

        Args:
            lasers: (n, 3) where each particle has its laser: x, y [cells], heading [rad].
            directions: (n_beams, 2) of the beams at the laser.
            readings: (n_beams,) [cells].
            returned: (n_beams,) whether each met an obstacle.
        """
        for particle, laser in enumerate(lasers):
            self._reserve()
            _beam_kernels.add_scan(
                laser,
                particle,
                directions,
                readings,
                returned,
                self._shape,
                self._config.prior_length / self._config.resolution,
                self._heads,
                self._owners,
                self._places,
                self._in_cell,
                self._back,
                self._of_node,
                self._evidence,
                self._pool,
                self._parents,
                self._firsts,
                self._order,
                self._leaves,
                self._scratch,
                self._row_of,
                self._rowed,
                self._rows,
                self._facts,
                self._used,
            )
        self._most_observations = max(self._most_observations, len(self._owners) - int(self._pool[1]))

    def densities(self, particle: int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Map of one particle, cut to what it has seen.

        Returns:
            (rows, cols) stops per cell length, NaN where unknown; and the lower left corner, (2,) [m].
        """
        densities = np.empty(len(self._heads), np.float32)
        _ancestry_kernels.densities_of(
            int(self._leaves[particle]),
            self._config.prior_length / self._config.resolution,
            self._heads,
            self._owners,
            self._in_cell,
            self._evidence,
            self._parents,
            densities,
        )
        grid = densities.reshape(self._shape)
        known = np.isfinite(grid)
        if not known.any():
            return np.full((1, 1), np.nan, np.float32), np.full(2, self._origin)
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        cut = grid[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        corner = np.array([columns[0], rows[0]], dtype=np.float64)
        return cut.copy(), self._origin + self._config.resolution * corner

    def counts(self) -> dict[str, int]:
        """Size of the tree and of the maps, for the summary."""
        return {
            "most_nodes": self._most_nodes,
            "nodes_died": self._died,
            "nodes_merged": self._merged,
            "most_observations": self._most_observations,
        }

    def _reserve(self) -> None:
        """Make room for what one scan can add for one particle."""
        if self._pool[1] < self._longest:
            self._grow(max(len(self._owners), 4 * self._longest))
        if len(self._rowed) - self._used[0] < self._longest:
            more = max(len(self._rowed), 4 * self._longest)
            self._rowed = np.concatenate([self._rowed, np.empty(more, np.int32)])
            self._facts = np.concatenate([self._facts, np.empty((more, 2), np.int32)])
            self._rows = np.concatenate([self._rows, np.empty((more, self._config.particles), np.int32)])

    def _grow(self, more: int) -> None:
        """Append free observations."""
        size = len(self._owners)
        chain = np.arange(size + 1, size + more + 1, dtype=np.int32)
        chain[-1] = self._pool[0]
        self._owners = np.concatenate([self._owners, np.empty(more, np.int32)])
        self._places = np.concatenate([self._places, np.empty(more, np.int32)])
        self._back = np.concatenate([self._back, np.empty(more, np.int32)])
        self._of_node = np.concatenate([self._of_node, np.empty(more, np.int32)])
        self._in_cell = np.concatenate([self._in_cell, chain])
        self._evidence = np.concatenate([self._evidence, np.empty((more, 2), np.float32)])
        self._pool[0], self._pool[1] = size, self._pool[1] + more

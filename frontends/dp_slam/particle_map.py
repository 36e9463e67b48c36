"""The maps of all particles in one grid: ancestry tree, observations, and the caches of a generation."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam import _ancestry_kernels, _beam_kernels
from frontends.dp_slam.config import DpSlamConfig, DpSlamError
from frontends.dp_slam.shared_maps import BeamModel, Beams, Caches, Observations, Tree

_Number = TypeVar("_Number", bound=np.generic)


class ParticleMaps:
    """One grid whose cells keep observations keyed by ancestor, and the tree that says whose they are.

    It begins with one particle, the root.
    """

    def __init__(self, half_extent: float, n_beams: int, config: DpSlamConfig) -> None:
        side = 2 * math.ceil(half_extent / config.resolution)
        if side * side > config.max_cells:
            raise DpSlamError(
                f"the log spans a square of {2 * half_extent:.0f} m, {side * side} cells of {config.resolution} m; at"
                f" most max_cells = {config.max_cells} are allowed"
            )
        self._config = config
        self._model = _in_cells(config)
        self._prior_length = config.prior_length / config.resolution
        self._shape = (side, side)
        self._origin = -0.5 * side * config.resolution
        self._longest = n_beams * (2 * math.ceil(config.max_range / config.resolution) + 4)
        n_nodes = 2 * config.particles + 2
        self._observations = _no_observations(side * side, n_nodes)
        self._tree = _root(n_nodes)
        self._caches = _empty_caches(side * side, self._longest, n_nodes, config.particles)
        self._died = self._merged = self._most_nodes = self._most_observations = 0

    def in_cells(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) poses with x and y in cells of the grid."""
        scaled = np.array(poses)
        scaled[:, :2] = (poses[:, :2] - self._origin) / self._config.resolution
        return scaled

    def log_likelihoods(
        self, lasers: NDArray[np.float64], particle_of: NDArray[np.int32], scan: Beams
    ) -> tuple[NDArray[np.float64], int]:
        """How well a scan fits each sample, in the map of its particle.

        Args:
            lasers: (n, 3) x, y [cells], heading [rad].
            particle_of: (n,) particle of each.
            scan: its beams, readings in cells.

        Returns:
            (n,) log-likelihoods, −inf for those culled; and how many survived the quick evaluation.
        """
        scores = np.empty(len(lasers))
        while True:
            survivors = _beam_kernels.localise(
                lasers,
                particle_of,
                scan,
                self._model,
                self._shape,
                self._observations,
                self._tree,
                self._caches,
                scores,
            )
            if survivors >= 0:
                return scores, int(survivors)
            viewed, densities = self._caches.viewed, self._caches.densities
            self._caches = self._caches._replace(
                viewed=_extended(viewed, len(viewed)), densities=_extended(densities, len(densities))
            )

    def descend(self, parent_of: NDArray[np.int32]) -> None:
        """Go on to the next generation.

        Args:
            parent_of: (n,) from which old particle each new one descends, in ascending order.
        """
        _beam_kernels.forget(self._caches)
        tree = self._tree
        kept = np.bincount(parent_of, minlength=len(tree.leaves)).astype(np.int64)
        died, merged = _ancestry_kernels.prune(kept, self._observations, tree)
        self._died += int(died)
        self._merged += int(merged)
        free = iter(np.flatnonzero(tree.children < 0).tolist())
        leaves = np.empty(len(parent_of), np.int32)
        for new, old in enumerate(parent_of.tolist()):
            above = int(tree.leaves[old])
            if kept[old] == 1:  # the only child of its parent is the parent
                leaves[new] = above
                continue
            node = next(free)
            leaves[new] = node
            tree.parents[node], tree.children[node], self._observations.firsts[node] = above, 0, -1
            tree.children[above] += 1
        order = _ancestry_kernels.tree_order(tree.parents, tree.children)
        self._tree = tree._replace(leaves=leaves, order=order)
        self._most_nodes = max(self._most_nodes, len(order))

    def add(self, lasers: NDArray[np.float64], scan: Beams) -> None:
        """Add a scan to the map of every particle.

        Args:
            lasers: (n, 3) where each particle has its laser: x, y [cells], heading [rad].
            scan: its beams, readings in cells.
        """
        for particle, laser in enumerate(lasers):
            self._reserve()
            _beam_kernels.add_scan(
                laser, particle, scan, self._prior_length, self._shape, self._observations, self._tree, self._caches
            )
        in_use = len(self._observations.owners) - int(self._observations.pool[1])
        self._most_observations = max(self._most_observations, in_use)

    def densities(self, particle: int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Map of one particle, cut to what it has seen.

        Returns:
            (rows, cols) stops per cell length, NaN where unknown; and the lower left corner, (2,) [m].
        """
        leaf = int(self._tree.leaves[particle])
        densities = _ancestry_kernels.densities_of(leaf, self._prior_length, self._observations, self._tree)
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
        observations, caches = self._observations, self._caches
        if observations.pool[1] < self._longest:
            self._observations = _grown(observations, max(len(observations.owners), 4 * self._longest))
        if len(caches.rowed) - caches.counts[0] < self._longest:
            more = max(len(caches.rowed), 4 * self._longest)
            self._caches = caches._replace(
                rowed=_extended(caches.rowed, more),
                facts=_extended(caches.facts, more),
                rows=_extended(caches.rows, more),
            )


def _in_cells(config: DpSlamConfig) -> BeamModel:
    cell = config.resolution
    return BeamModel(
        prior_density=config.prior_density * cell,
        range_variance=config.range_variance / cell**2,
        floor=config.floor,
        quick_before=config.quick_before / cell,
        quick_beyond=config.quick_beyond / cell,
        trace_margin=config.trace_margin / cell,
        max_range=config.max_range / cell,
        passes=config.passes,
        cull=config.cull,
    )


def _no_observations(n_cells: int, n_nodes: int) -> Observations:
    owners, places, in_cell, back, of_node = (np.empty(0, np.int32) for _ in range(5))
    return Observations(
        heads=np.full(n_cells, -1, np.int32),
        owners=owners,
        places=places,
        in_cell=in_cell,
        back=back,
        of_node=of_node,
        firsts=np.full(n_nodes, -1, np.int32),
        evidence=np.empty((0, 2), np.float32),
        pool=np.array([-1, 0], np.int32),
    )


def _grown(old: Observations, more: int) -> Observations:
    """The same observations and more free ones."""
    size = len(old.owners)
    chain = np.arange(size + 1, size + more + 1, dtype=np.int32)
    chain[-1] = old.pool[0]
    return old._replace(
        owners=_extended(old.owners, more),
        places=_extended(old.places, more),
        in_cell=np.concatenate([old.in_cell, chain]),
        back=_extended(old.back, more),
        of_node=_extended(old.of_node, more),
        evidence=_extended(old.evidence, more),
        pool=np.array([size, old.pool[1] + more], np.int32),
    )


def _root(n_nodes: int) -> Tree:
    """The tree of one particle."""
    parents, children = np.full(n_nodes, -1, np.int32), np.full(n_nodes, -1, np.int32)
    children[0] = 0
    return Tree(parents=parents, children=children, order=np.zeros(1, np.int32), leaves=np.zeros(1, np.int32))


def _empty_caches(n_cells: int, n_views: int, n_nodes: int, n_particles: int) -> Caches:
    return Caches(
        row_of=np.full(n_cells, -1, np.int32),
        rowed=np.empty(0, np.int32),
        rows=np.empty((0, n_particles), np.int32),
        facts=np.empty((0, 2), np.int32),
        view_of=np.full(n_cells, -1, np.int32),
        viewed=np.empty(4 * n_views, np.int32),
        densities=np.empty((n_views, n_particles), np.float32),
        counts=np.zeros(3, np.int64),
        nearest=np.empty(n_nodes, np.int32),
        seen=np.empty(n_particles, np.int32),
    )


def _extended(rows: NDArray[_Number], more: int) -> NDArray[_Number]:
    """An array with room for more rows."""
    return np.concatenate([rows, np.empty((more, *rows.shape[1:]), rows.dtype)])

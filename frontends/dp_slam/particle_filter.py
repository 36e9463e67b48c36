"""DP-SLAM (Eliazar and Parr, IJCAI 2003 and ICRA 2004): the loop over the scans.

Each scan: draw samples from the motion model, judge each by the map of its particle, resample, let the ancestry tree
follow, and add the scan to the map of every particle that is left.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam._resampling_kernels import resample
from frontends.dp_slam.config import DpSlamConfig, DpSlamError
from frontends.dp_slam.motion import draw_motions
from frontends.dp_slam.particle_map import ParticleMaps
from frontends.dp_slam.shared_maps import Beams
from frontends.scan import Log
from graph.elementary import cos_sin, exp, log
from graph.se2 import between, compose

_CERTAIN = 0.98
"""Probabilities of the grid are kept this far from certainty when they become log-odds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DpSlamResult:
    """The best particle at the end.

    Attributes:
        trajectory: (n, 3) T_map_robot of every scan; the first is the identity.
        grid: (rows, cols) float32 probability that a cell stops a beam that crosses it from corner to corner; NaN where
            it was never seen. The path credited to new cells by the filter's prior is left out. Row 0 is the lowest y.
        origin: (2,) lower left corner of cell (0, 0) in the map frame [m].
        resolution: side of a cell [m].
        summary: counts and times.
    """

    trajectory: NDArray[np.float64]
    grid: NDArray[np.float32]
    origin: NDArray[np.float64]
    resolution: float
    summary: dict[str, Any]

    def log_odds(self) -> NDArray[np.float32]:
        """(rows, cols) float32 log-odds of the grid, within ±3.9 (0.02 to 0.98); 0 where nothing is known."""
        probability = np.clip(self.grid, 1.0 - _CERTAIN, _CERTAIN)
        return np.nan_to_num(log(probability / (1.0 - probability)), nan=0.0).astype(np.float32)


def dp_slam(
    log: Log, config: DpSlamConfig | None = None, progress: Callable[[int, int], None] | None = None
) -> DpSlamResult:
    """Estimate trajectory and map of a log.

    Args:
        log: with odometry.
        config: settings; the defaults when left out.
        progress: called with the number of scans done and of all scans.

    Returns:
        What the best particle of the last scan believes.

    Raises:
        DpSlamError: the log has no scan or no odometry, or needs a grid beyond `max_cells`.
    """
    config = config or DpSlamConfig()
    if not len(log):
        raise DpSlamError(f"{log.path}: found no scan, expected one or more")
    if not log.has_odometry and len(log) > 1:
        raise DpSlamError(f"{log.path}: found no odometry, which DP-SLAM draws its samples around")
    started = time.perf_counter()
    run = _Filter(log, config)
    if progress is not None:
        progress(1, len(log))
    for index in range(1, len(log)):
        run.step(index)
        if progress is not None:
            progress(index + 1, len(log))
    seconds = time.perf_counter() - started
    grid, origin = run.best_grid()
    return DpSlamResult(
        trajectory=run.best_trajectory(),
        grid=grid,
        origin=origin,
        resolution=config.resolution,
        summary={
            "method": "dp-slam",
            "log": log.path.name,
            "scans": len(log),
            "particles": config.particles,
            "samples": config.samples,
            "resolution_m": config.resolution,
            "seed": config.seed,
            **run.counts(),
            "seconds": round(seconds, 4),
            "scans_per_second": round(len(log) / max(seconds, 1e-9), 2),
        },
    )


class _Filter:
    """The particles of the last scan, their maps, and the history that leads to them."""

    def __init__(self, log: Log, config: DpSlamConfig) -> None:
        self._config = config
        self._log = log
        self._rng = np.random.default_rng(config.seed)
        geometry = log.geometry
        self._beams = np.arange(0, geometry.n_beams, math.ceil(geometry.n_beams / config.max_beams))
        bearings = geometry.bearings[self._beams]
        self._directions = np.stack(cos_sin(bearings), axis=1)
        self._steps = between(log.odometry[:-1], log.odometry[1:])
        self._maps = ParticleMaps(half_extent(log, config), len(bearings), config)
        self._poses = np.zeros((1, 3))
        self._samples_of = np.array([config.samples], dtype=np.int64)
        self._weights = np.ones(1)
        self._history: list[tuple[NDArray[np.float64], NDArray[np.int32]]] = [(self._poses, np.zeros(1, np.int32))]
        self._quick_survivors = self._full_survivors = self._kept = 0
        self._maps.add(self._lasers(self._poses), self._scan(0))

    def step(self, index: int) -> None:
        """Move on to the next scan."""
        config = self._config
        scan = self._scan(index)
        particle_of = np.repeat(np.arange(len(self._poses), dtype=np.int32), self._samples_of)
        motions = draw_motions(self._steps[index - 1], config.motion, self._rng.standard_normal((config.samples, 3)))
        samples = compose(self._poses[particle_of], motions)
        scores, survivors = self._maps.log_likelihoods(self._lasers(samples), particle_of, scan)
        weights = exp(scores - scores.max())
        times = np.empty(config.samples, np.int64)
        resample(weights / weights.sum(), self._rng.random(config.samples), config.particles, times)
        chosen = np.flatnonzero(times)
        self._maps.descend(particle_of[chosen])
        self._poses, self._samples_of, self._weights = samples[chosen], times[chosen], weights[chosen]
        self._history.append((self._poses, particle_of[chosen]))
        self._maps.add(self._lasers(self._poses), scan)
        self._quick_survivors += survivors
        self._full_survivors += int(np.isfinite(scores).sum())
        self._kept += len(chosen)

    def best_trajectory(self) -> NDArray[np.float64]:
        """(n, 3) the path that leads to the best particle."""
        trajectory = np.empty((len(self._history), 3))
        particle = int(np.argmax(self._weights))
        for index in range(len(self._history) - 1, -1, -1):
            poses, parents = self._history[index]
            trajectory[index] = poses[particle]
            particle = int(parents[particle])
        return trajectory

    def best_grid(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Probability to stop a beam that crosses a cell from corner to corner, and the lower left corner [m]."""
        densities, origin = self._maps.densities(int(np.argmax(self._weights)))
        return (1.0 - exp(-math.sqrt(2.0) * densities)).astype(np.float32), origin

    def counts(self) -> dict[str, float | int]:
        """What the filter did, for the summary."""
        steps = max(len(self._history) - 1, 1)
        return {
            "samples_after_quick_cull": round(self._quick_survivors / steps, 2),
            "samples_after_full_cull": round(self._full_survivors / steps, 2),
            "particles_kept": round(self._kept / steps, 2),
            **self._maps.counts(),
        }

    def _scan(self, index: int) -> Beams:
        """The beams in use, cut at the maximum range."""
        ranges = self._log.ranges[index, self._beams].astype(np.float64)
        returned = np.isfinite(ranges) & (ranges < self._config.max_range)
        readings = np.where(returned, ranges, self._config.max_range) / self._config.resolution
        return Beams(directions=self._directions, readings=readings, returned=returned)

    def _lasers(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) poses of the laser for robot poses: x, y [cells of the grid], heading [rad]."""
        return self._maps.in_cells(compose(poses, self._log.geometry.T_robot_laser))


def half_extent(log: Log, config: DpSlamConfig) -> float:
    """Half the side of a square around the first pose that holds all that may be seen [m]."""
    away = np.hypot(*(log.odometry[:, :2] - log.odometry[0, :2]).T).max()
    mount = math.hypot(*log.geometry.T_robot_laser[:2].tolist())
    return float(1.2 * away + config.max_range + mount + 3.0)

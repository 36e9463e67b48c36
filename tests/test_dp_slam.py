"""DP-SLAM against a twin whose particles own whole maps, and its parts against closed forms."""

import dataclasses
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from frontends.dp_slam import ATRV_JR, DpSlamConfig, DpSlamError, MotionModel, dp_slam
from frontends.dp_slam import _beam_kernels as kernels
from frontends.dp_slam._resampling_kernels import resample
from frontends.dp_slam.motion import draw_motions
from frontends.dp_slam.particle_filter import half_extent
from frontends.dp_slam.particle_map import ParticleMaps
from frontends.dp_slam.shared_maps import BeamModel
from frontends.logs import read_log
from frontends.scan import Log, ScanGeometry
from graph.se2 import between, compose
from tests.kernels import from_python
from tests.walls import distances

Cell = tuple[int, int]
Map = dict[Cell, tuple[np.float32, np.float32]]

BEAM = from_python(kernels._beam)
SMALL = DpSlamConfig(
    particles=8, samples=60, resolution=0.1, max_range=6.0, max_beams=31, cull=6.0, seed=3, range_variance=0.01
)


def room_log(
    n_scans: int = 40, n_beams: int = 31, *, noise: float = 0.01, seed: int = 0
) -> tuple[Log, NDArray[np.float64]]:
    """A robot going round a closed room of 8 m by 5 m with two pillars, and its true poses in its first frame."""
    rng = np.random.default_rng(seed)
    walls = np.array(
        [[0, 0, 8, 0], [8, 0, 8, 5], [8, 5, 0, 5], [0, 5, 0, 0], [3, 2, 3.6, 2], [3.6, 2, 3.6, 2.6]], float
    )
    walls = np.concatenate([walls, [[3.6, 2.6, 3, 2.6], [3, 2.6, 3, 2], [5.5, 5, 5.5, 4]]])
    turn = np.linspace(0.0, 1.6 * np.pi, n_scans)
    T_world_robot = np.stack([4 + 2.5 * np.cos(turn), 2.5 + 1.4 * np.sin(turn), turn + np.pi / 2], axis=1)
    bearings = np.linspace(-np.pi / 2, np.pi / 2, n_beams)
    mount = np.array([0.2, 0.0, 0.0])
    ranges = np.array([distances(walls, T_world_laser, bearings) for T_world_laser in compose(T_world_robot, mount)])
    ranges += noise * rng.standard_normal(ranges.shape)
    ranges[rng.random(ranges.shape) < 0.03] = np.nan
    truth = between(T_world_robot[:1], T_world_robot)
    steps = between(T_world_robot[:-1], T_world_robot[1:])
    steps = steps * np.array([1.05, 1.0, 1.08]) + rng.standard_normal(steps.shape) * np.array([0.01, 0.01, 0.01])
    odometry = np.zeros((n_scans, 3))
    for i, step in enumerate(steps):
        odometry[i + 1] = compose(odometry[i], step)
    return Log(
        ranges=ranges.astype(np.float32),
        odometry=odometry,
        stamps=np.arange(n_scans, dtype=np.float64),
        geometry=ScanGeometry(bearings=bearings, range_min=0.05, range_max=20.0, T_robot_laser=mount),
        path=Path("room.log"),
    ), truth


def stretches(
    x: float, y: float, ux: float, uy: float, begin: float, end: float
) -> Iterator[tuple[Cell, float, float]]:
    """Cells a beam crosses with where it enters and leaves them, from sorted crossings of the grid's lines."""
    cuts = [begin, end]
    for origin, slope in ((x, ux), (y, uy)):
        if slope != 0.0:
            first, last = sorted((origin + slope * begin, origin + slope * end))
            cuts += [(line - origin) / slope for line in range(math.floor(first), math.ceil(last) + 1)]
    inside = sorted(t for t in cuts if begin <= t <= end)
    for enter, leave in pairwise(inside):
        if leave - enter > 1e-12:
            middle = 0.5 * (enter + leave)
            yield (math.floor(y + uy * middle), math.floor(x + ux * middle)), enter, leave


def twin_likelihood(
    seen: Map,
    pose: NDArray[np.float64],
    direction: NDArray[np.float64],
    begin: float,
    end: float,
    reading: float,
    through: bool,
    prior: float,
    variance: float,
) -> float:
    reach, total = 1.0, 0.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ux, uy = c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]
    for cell, enter, leave in stretches(pose[0], pose[1], ux, uy, begin, end):
        density = float(seen[cell][0] / seen[cell][1]) if cell in seen else prior
        stop = reach * -math.expm1(-density * (leave - enter))
        error = 0.5 * (enter + leave) - reading
        exponent = 0.5 * error * error / variance
        total += stop * math.exp(-exponent) if exponent < 12.5 else 0.0
        reach -= stop
    if through:
        return total + reach
    return total / (1.0 - reach) if reach < 1.0 else 0.0


def twin_add(
    seen: Map,
    pose: NDArray[np.float64],
    directions: NDArray[np.float64],
    readings: NDArray[np.float64],
    returned: NDArray[np.bool_],
    prior_length: float,
) -> None:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for direction, reading, hit in zip(directions, readings, returned, strict=True):
        ux, uy = c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]
        for cell, enter, leave in stretches(pose[0], pose[1], ux, uy, 0.0, float(reading)):
            stops, path = seen.get(cell, (np.float32(0.0), np.float32(prior_length)))
            seen[cell] = (stops + np.float32(hit and leave >= reading), np.float32(path + (leave - enter)))


def twin_scores(
    maps: list[Map],
    lasers: NDArray[np.float64],
    directions: NDArray[np.float64],
    readings: NDArray[np.float64],
    returned: NDArray[np.bool_],
    config: DpSlamConfig,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Log-likelihood of each sample in its map, and which samples are left when the worst were culled."""
    cell = config.resolution
    alive = np.ones(len(lasers), bool)
    for quick in (True, False):
        scores = np.zeros(len(lasers))
        for first in range(config.passes):
            for k in np.flatnonzero(alive):
                for beam in range(first, len(readings), config.passes):
                    if quick and not returned[beam]:
                        continue
                    reading = float(readings[beam])
                    begin = max(0.0, reading - config.quick_before / cell) if quick else 0.0
                    end = reading + config.quick_beyond / cell
                    if not quick:
                        end = min(reading + config.trace_margin / cell, config.max_range / cell)
                    likelihood = twin_likelihood(
                        maps[k],
                        lasers[k],
                        directions[beam],
                        begin,
                        end,
                        reading,
                        not returned[beam],
                        config.prior_density * cell,
                        config.range_variance / cell**2,
                    )
                    scores[k] += math.log(max(likelihood, config.floor))
            alive &= scores >= scores[alive].max() - config.cull
    return scores, alive


def twin_dp_slam(log: Log, config: DpSlamConfig) -> tuple[NDArray[np.float64], Map, list[int]]:
    """The same filter with a whole map per particle, copied at each birth; and how many samples survive each scan."""
    rng = np.random.default_rng(config.seed)
    cell = config.resolution
    bearings = log.geometry.bearings
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    half = half_extent(log, config)
    origin = -math.ceil(half / cell) * cell

    def lasers(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = compose(poses, log.geometry.T_robot_laser)
        moved[:, :2] = (moved[:, :2] - origin) / cell
        return moved

    def scan(index: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        ranges = log.ranges[index].astype(np.float64)
        returned = np.isfinite(ranges) & (ranges < config.max_range)
        return np.where(returned, ranges, config.max_range) / cell, returned

    poses, paths = np.zeros((1, 3)), [[np.zeros(3)]]
    maps: list[Map] = [{}]
    shares = np.array([config.samples])
    twin_add(maps[0], lasers(poses)[0], directions, *scan(0), config.prior_length / cell)
    weights = np.ones(1)
    survivors = []
    for index in range(1, len(log)):
        readings, returned = scan(index)
        parents = np.repeat(np.arange(len(poses)), shares)
        step = between(log.odometry[index - 1], log.odometry[index])
        samples = compose(poses[parents], draw_motions(step, config.motion, rng.standard_normal((config.samples, 3))))
        seen_by = [maps[parent] for parent in parents]
        scores, alive = twin_scores(seen_by, lasers(samples), directions, readings, returned, config)
        survivors.append(int(alive.sum()))
        weights = np.where(alive, np.exp(scores - scores[alive].max()), 0.0)
        times = np.empty(config.samples, np.int64)
        resample(weights / weights.sum(), rng.random(config.samples), config.particles, times)
        chosen = np.flatnonzero(times)
        maps = [dict(maps[parents[k]]) for k in chosen]
        paths = [[*paths[parents[k]], samples[k]] for k in chosen]
        poses, shares, weights = samples[chosen], times[chosen], weights[chosen]
        for seen, laser in zip(maps, lasers(poses), strict=True):
            twin_add(seen, laser, directions, readings, returned, config.prior_length / cell)
    best = int(np.argmax(weights))
    return np.array(paths[best]), maps[best], survivors


def test_shared_maps_give_what_whole_maps_give() -> None:
    log, _ = room_log(9, 15)
    config = dataclasses.replace(SMALL, samples=30, particles=6, cull=1.5)
    result = dp_slam(log, config)
    trajectory, seen, survivors = twin_dp_slam(log, config)
    assert_allclose(result.trajectory, trajectory, atol=1e-9)
    assert result.summary["samples_after_full_cull"] == pytest.approx(np.mean(survivors), abs=0.01)
    assert min(survivors) < config.samples
    assert result.summary["nodes_died"] > 0
    assert result.summary["nodes_merged"] > 0
    corner = -math.ceil(half_extent(log, config) / config.resolution)
    row, column = np.rint(result.origin[::-1] / config.resolution).astype(int) - corner
    for (r, c), (stops, path) in seen.items():
        own = max(float(path) - config.prior_length / config.resolution, 1e-3)
        expected = 1.0 - math.exp(-math.sqrt(2.0) * float(stops) / own)
        assert result.grid[r - row, c - column] == pytest.approx(expected, abs=2e-3)
    # A beam that ends on a cell's border may leave a stretch of length zero beyond it; nothing else may differ.
    assert abs(int(np.isfinite(result.grid).sum()) - len(seen)) <= 2


def test_the_tree_keeps_its_rules_in_every_generation(monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[int] = []

    def check(maps: ParticleMaps, *arguments: object) -> None:
        add(maps, *arguments)  # type: ignore[arg-type]
        tree, observations = maps._tree, maps._observations
        used = np.flatnonzero(tree.children >= 0)
        kids = np.bincount(tree.parents[used][tree.parents[used] >= 0], minlength=len(tree.parents))
        assert_array_equal(kids[used], tree.children[used])
        assert len(set(tree.leaves.tolist())) == len(tree.leaves)
        assert set(tree.leaves.tolist()) == set(used[tree.children[used] == 0].tolist())
        assert np.count_nonzero(kids[used] == 1) == 0
        assert np.count_nonzero(tree.parents[used] < 0) == 1
        held = []
        for node in used:
            observation = int(observations.firsts[node])
            while observation >= 0:
                assert observations.owners[observation] == node
                held.append((int(observations.places[observation]), int(node), observation))
                observation = int(observations.of_node[observation])
        assert len({(cell, node) for cell, node, _ in held}) == len(held)
        assert len(held) == len(observations.owners) - observations.pool[1]
        listed = 0
        for cell in np.flatnonzero(observations.heads >= 0):
            observation = int(observations.heads[cell])
            while observation >= 0:
                assert observations.places[observation] == cell
                listed += 1
                observation = int(observations.in_cell[observation])
        assert listed == len(held)
        checked.append(len(held))

    add = ParticleMaps.add
    monkeypatch.setattr(ParticleMaps, "add", check)
    log, _ = room_log(6, 9)
    dp_slam(log, dataclasses.replace(SMALL, samples=30, particles=6, resolution=0.2))
    assert len(checked) == 6


def test_finds_the_way_round_a_room_better_than_the_wheels() -> None:
    log, truth = room_log(40, 61)
    config = DpSlamConfig(particles=30, samples=300, resolution=0.04, max_range=7.0)
    result = dp_slam(log, config)
    error = np.hypot(*(result.trajectory - truth)[:, :2].T)
    drift = np.hypot(*(log.odometry - truth)[:, :2].T)
    assert error.max() < 0.2
    assert error.max() < 0.5 * drift.max()
    walls = result.grid > 0.6
    assert 0.002 < walls.mean() < 0.1
    assert_allclose(result.log_odds()[np.isnan(result.grid)], 0.0)
    assert (result.log_odds()[walls] > 0).all()


def test_same_seed_same_bytes_other_seed_other_samples() -> None:
    log, _ = room_log(8)
    first, again = dp_slam(log, SMALL), dp_slam(log, SMALL)
    assert_array_equal(first.trajectory, again.trajectory)
    assert_array_equal(first.grid, again.grid)
    other = dp_slam(log, dataclasses.replace(SMALL, seed=4))
    assert not np.array_equal(first.trajectory, other.trajectory)


def test_reports_progress_and_a_summary() -> None:
    log, _ = room_log(5)
    told: list[tuple[int, int]] = []
    result = dp_slam(log, SMALL, lambda done, total: told.append((done, total)))
    assert told == [(k, 5) for k in range(1, 6)]
    assert result.trajectory.shape == (5, 3)
    assert_array_equal(result.trajectory[0], 0.0)
    assert result.summary["scans"] == 5
    assert 1 <= result.summary["particles_kept"] <= SMALL.particles


def test_one_scan_is_a_map() -> None:
    log, _ = room_log(1)
    result = dp_slam(log, SMALL)
    assert_array_equal(result.trajectory, np.zeros((1, 3)))
    assert (result.grid > 0.6).any()


def test_logs_it_cannot_work_on() -> None:
    log, _ = room_log(3)
    with pytest.raises(DpSlamError, match=r"room.log: found no odometry"):
        dp_slam(dataclasses.replace(log, has_odometry=False))
    with pytest.raises(DpSlamError, match=r"room.log: found no scan"):
        dp_slam(log.select(slice(0)))
    with pytest.raises(DpSlamError, match="at most max_cells = 1000 are allowed"):
        dp_slam(log, DpSlamConfig(max_cells=1000))


@pytest.mark.parametrize(
    "wrong",
    [
        {"particles": 0},
        {"particles": 10, "samples": 9},
        {"resolution": 0.0},
        {"floor": 1.0},
        {"passes": 0},
        {"trace_margin": -1.0},
    ],
)
def test_settings_outside_their_range(wrong: dict[str, float]) -> None:
    with pytest.raises(DpSlamError, match="dp_slam"):
        DpSlamConfig(**wrong)  # type: ignore[arg-type]
    with pytest.raises(DpSlamError, match=r"dp_slam\.motion"):
        MotionModel(d_std_per_metre=-0.1)


def test_motions_follow_the_model() -> None:
    normals = np.random.default_rng(0).standard_normal((40_000, 3))
    step = np.array([0.4, 0.1, 0.3])
    drawn = draw_motions(step, MotionModel(), normals)
    assert_allclose(draw_motions(step, MotionModel(), np.zeros((1, 3)))[0], step, atol=1e-12)
    turned = drawn[:, 2]
    assert turned.std() == pytest.approx(max(0.028 * math.hypot(0.4, 0.1) + 0.1405 * 0.3, 0.1), rel=0.02)
    back = draw_motions(np.array([-0.5, 0.0, 0.0]), ATRV_JR, np.zeros((1, 3)))[0]
    assert_allclose(np.hypot(back[0], back[1]), 0.5 * math.hypot(0.9577, 0.0107), rtol=1e-9)
    assert back[0] < 0


@given(
    weights=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=40).filter(lambda w: sum(w) > 1e-6),
    n_particles=st.integers(1, 10),
    seed=st.integers(0, 1000),
)
def test_resampling_draws_what_has_weight_and_not_too_many_kinds(
    weights: list[float], n_particles: int, seed: int
) -> None:
    times = np.empty(len(weights), np.int64)
    resample(np.array(weights), np.random.default_rng(seed).random(50), n_particles, times)
    assert times.sum() == 50
    assert 1 <= np.count_nonzero(times) <= n_particles
    assert all(times[k] == 0 for k, weight in enumerate(weights) if weight == 0.0)


def test_resampling_is_in_proportion() -> None:
    times = np.empty(3, np.int64)
    resample(np.array([0.5, 0.3, 0.2]), np.random.default_rng(0).random(60_000), 3, times)
    assert_allclose(times / 60_000, [0.5, 0.3, 0.2], atol=0.01)


def beam(
    densities: dict[Cell, float],
    begin: float,
    end: float,
    reading: float,
    *,
    through: bool = False,
    pose: tuple[float, float, float] = (0.5, 2.5, 0.0),
    prior: float = 0.01,
    variance: float = 1.0,
) -> float:
    shape = (5, 20)
    view = np.full(shape[0] * shape[1], -3, np.int32)
    table = np.zeros((max(len(densities), 1), 1), np.float32)
    for slot, ((row, column), density) in enumerate(densities.items()):
        view[row * shape[1] + column] = -2 if density == 0.0 else slot
        table[slot, 0] = density
    x, y, heading = pose
    ray = (x, y, math.cos(heading), math.sin(heading), begin, end)
    return float(BEAM(ray, reading, through, 0, shape, in_cells(prior, variance), view, table))


def in_cells(prior: float, variance: float) -> BeamModel:
    return BeamModel(
        prior_density=prior,
        range_variance=variance,
        floor=0.0,
        quick_before=0.0,
        quick_beyond=0.0,
        trace_margin=0.0,
        max_range=20.0,
        passes=1,
        cull=13.0,
    )


def test_beam_into_a_wall_of_one_cell() -> None:
    free = {(2, column): 0.0 for column in range(20)}
    wall = {**free, (2, 10): 5.0}
    # Only one cell can stop the beam: normalised, what is left is the density of the error to its middle, 10 cells off.
    assert beam(wall, 0.0, 15.0, 10.0) == pytest.approx(1.0, abs=1e-6)
    assert beam(wall, 0.0, 15.0, 8.0) == pytest.approx(math.exp(-2.0), rel=1e-6)
    assert beam(free, 0.0, 15.0, 8.0) == 0.0
    assert beam(free, 0.0, 15.0, 15.0, through=True) == 1.0
    assert beam(wall, 0.0, 15.0, 15.0, through=True) == pytest.approx(math.exp(-5.0))


def test_beam_penetrates_what_is_not_dense() -> None:
    free = {(2, column): 0.0 for column in range(20)}
    hedge = {**free, (2, 6): 0.5, (2, 10): 50.0}
    first = 1 - math.exp(-0.5)
    expected = first * math.exp(-0.5 * 16.0 / 2.0) + (1 - first)
    assert beam(hedge, 0.0, 15.0, 10.0, variance=2.0) == pytest.approx(expected, rel=1e-6)


@settings(max_examples=60)
@given(
    x=st.floats(2.0, 18.0),
    y=st.floats(1.0, 4.0),
    heading=st.floats(-3.2, 3.2),
    reading=st.floats(0.5, 9.0),
    through=st.booleans(),
    seed=st.integers(0, 100),
)
def test_beam_agrees_with_its_twin(
    x: float,
    y: float,
    heading: float,
    reading: float,
    through: bool,
    seed: int,
) -> None:
    # Along a line of the grid either side may be taken for the cell.
    assume(min(abs(v - round(v)) for v in (x, y)) > 1e-3 and min(abs(math.cos(heading)), abs(math.sin(heading))) > 1e-4)
    rng = np.random.default_rng(seed)
    densities = {(int(r), int(c)): float(np.float32(rng.exponential())) for r in range(5) for c in range(20)}
    seen = {cell: (np.float32(density), np.float32(1.0)) for cell, density in densities.items()}
    direction = np.array([1.0, 0.0])
    expected = twin_likelihood(
        seen, np.array([x, y, heading]), direction, 0.0, reading + 3.0, reading, through, 0.01, 1.0
    )
    found = beam(densities, 0.0, reading + 3.0, reading, through=through, pose=(x, y, heading))
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-9)


def test_start_of_the_public_log_is_mapped(data_dir: Path) -> None:
    log = read_log(data_dir / "dpslam-loop5.log.gz")
    start = log.select(slice(60))
    result = dp_slam(start, DpSlamConfig(particles=20, samples=200, resolution=0.05))
    odometry = between(start.odometry[0], start.odometry)
    assert np.hypot(*(result.trajectory - odometry)[:, :2].T).max() < 0.6
    # Corridor walls are thin: few cells stop beams among many that let them pass.
    assert np.nanmean(result.grid > 0.6) < 0.05
    assert (result.grid > 0.6).sum() > 300

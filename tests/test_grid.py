"""The occupancy grid against slow twins and closed-form cases."""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import ScanGeometry
from iceg.maps import _grid_kernels as kernels
from iceg.maps.config import GridConfig, GridError, GridSizeError
from iceg.maps.grid import FREE, OCCUPIED, OccupancyGrid, render_grid, render_grid_that_fits
from tests.kernels import from_python

cast_cells = from_python(kernels._cast_cells)
fill_polygon = from_python(kernels._fill_polygon)

F64 = NDArray[np.float64]
HIT, MISS, LIMIT = math.log(0.7 / 0.3), math.log(0.44 / 0.56), math.log(0.97 / 0.03)
ORIGIN = np.zeros((1, 3))


def laser(
    n_beams: int = 181, field_of_view: float = math.pi, mount: tuple[float, float, float] = (0, 0, 0)
) -> ScanGeometry:
    half = field_of_view / 2
    bearings = np.linspace(-half, half, n_beams)
    return ScanGeometry(bearings=bearings, range_min=0.02, range_max=30.0, T_robot_laser=np.array(mount, dtype=float))


def one_beam(T_map_robot: tuple[float, float, float], reach: float, config: GridConfig) -> OccupancyGrid:
    """Of two beams, the other of which meets nothing."""
    geometry = ScanGeometry(bearings=np.array([0.0, 2.0]), range_min=0.02, range_max=30.0)
    return render_grid(np.array([T_map_robot]), np.array([[reach, np.nan]], np.float32), geometry, config)


def at(grid: OccupancyGrid, x: float, y: float) -> float:
    row, col = (int(index) for index in grid.cell(np.array([x, y])))
    inside = 0 <= row < grid.shape[0] and 0 <= col < grid.shape[1]
    return float(grid.log_odds[row, col]) if inside else 0.0


def room(T_map_laser: F64, bearings: F64, half: tuple[float, float] = (4.02, 3.02)) -> NDArray[np.float32]:
    """Ranges inside a rectangle around the map's origin."""
    angles = bearings + T_map_laser[2] + 1e-9  # never exactly along an axis
    along_x = (np.sign(np.cos(angles)) * half[0] - T_map_laser[0]) / np.cos(angles)
    along_y = (np.sign(np.sin(angles)) * half[1] - T_map_laser[1]) / np.sin(angles)
    return np.asarray(np.minimum(along_x, along_y), dtype=np.float32)


# Rays


def cast(x0: float, y0: float, x1: float, y1: float) -> list[tuple[int, int]]:
    """Cells (column, row) of the kernel."""
    rows, cols = np.zeros(2000, np.int64), np.zeros(2000, np.int64)
    n = cast_cells(x0, y0, x1, y1, rows, cols, 0)
    return list(zip(cols[:n].tolist(), rows[:n].tolist(), strict=True))


def cast_slowly(x0: float, y0: float, x1: float, y1: float) -> tuple[list[tuple[int, int]], float]:
    """Cut the line at every cell border; also how close two cuts come (0: through a cell's corner)."""
    cuts = {0.0, 1.0}
    for a, b in ((x0, x1), (y0, y1)):
        low, high = sorted((a, b))
        cuts |= {(border - a) / (b - a) for border in range(math.ceil(low), math.floor(high) + 1) if a != b}
    ordered = sorted(cut for cut in cuts if 0.0 <= cut <= 1.0)
    middles = [(a + b) / 2 for a, b in itertools.pairwise(ordered)]
    cells = [(math.floor(x0 + t * (x1 - x0)), math.floor(y0 + t * (y1 - y0))) for t in middles]
    corners = [
        abs((u - x0) / (x1 - x0) - (v - y0) / (y1 - y0))
        for u in range(math.ceil(min(x0, x1)), math.floor(max(x0, x1)) + 1)
        for v in range(math.ceil(min(y0, y1)), math.floor(max(y0, y1)) + 1)
        if x0 != x1 and y0 != y1
    ]
    return cells, min(corners, default=1.0)


@pytest.mark.parametrize(
    ("line", "cells"),
    [
        pytest.param((0.2, 0.3, 0.8, 0.6), [(0, 0)], id="single cell"),
        pytest.param((0.5, 0.5, 0.5, 0.5), [(0, 0)], id="point"),
        pytest.param((0.5, 0.5, 3.5, 0.5), [(0, 0), (1, 0), (2, 0), (3, 0)], id="along x"),
        pytest.param((0.5, 3.5, 0.5, 0.5), [(0, 3), (0, 2), (0, 1), (0, 0)], id="along y, backwards"),
        pytest.param((0.4, 0.5, 2.4, 2.5), [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2)], id="diagonal"),
        pytest.param((2.4, 2.5, 0.4, 0.5), [(2, 2), (1, 2), (1, 1), (0, 1), (0, 0)], id="diagonal, backwards"),
        pytest.param((0.5, 0.1, 1.5, 2.5), [(0, 0), (0, 1), (1, 1), (1, 2)], id="steep"),
        pytest.param((0.1, 0.5, 2.5, -0.5), [(0, 0), (1, 0), (1, -1), (2, -1)], id="flat, downwards"),
    ],
)
def test_a_ray_visits_the_cells_it_passes_through(
    line: tuple[float, float, float, float], cells: list[tuple[int, int]]
) -> None:
    assert cast(*line) == cells


coordinate = st.floats(-20, 20, allow_nan=False).map(lambda value: round(value, 3) + 0.000123)


@given(coordinate, coordinate, coordinate, coordinate)
def test_a_ray_equals_its_slow_twin(x0: float, y0: float, x1: float, y1: float) -> None:
    assume((x0, y0) != (x1, y1))
    expected, gap = cast_slowly(x0, y0, x1, y1)
    assume(gap > 1e-9)
    assert cast(x0, y0, x1, y1) == expected
    assert cast(x1, y1, x0, y0) == expected[::-1]


# Areas


def inside_slowly(x: float, y: float, xs: F64, ys: F64) -> bool:
    """Even-odd rule, edge by edge."""
    inside = False
    for k in range(len(xs)):
        xa, ya, xb, yb = xs[k - 1], ys[k - 1], xs[k], ys[k]
        if (ya <= y) != (yb <= y) and x >= xa + (y - ya) * (xb - xa) / (yb - ya):
            inside = not inside
    return inside


@settings(max_examples=40)
@given(st.lists(st.floats(0.0, 9.0).map(lambda value: round(value, 2)), min_size=3, max_size=24), st.floats(0, 6.28))
def test_a_filled_polygon_holds_the_cells_whose_centre_is_inside(radii: list[float], turn: float) -> None:
    angles = turn + np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    xs, ys = 10.03 + np.array(radii) * np.cos(angles), 9.96 + np.array(radii) * np.sin(angles)
    log_odds = np.zeros((20, 20), np.float32)
    counts = np.zeros(20, np.int32)
    fill_polygon(
        log_odds, xs, ys, len(xs), np.float32(-1), np.float32(-9), 0, np.zeros((20, len(xs)), np.int32), counts
    )
    expected = [[-float(inside_slowly(col + 0.5, row + 0.5, xs, ys)) for col in range(20)] for row in range(20)]
    np.testing.assert_array_equal(log_odds, expected)
    assert not counts.any()


def test_cells_outside_the_grid_are_cut_off() -> None:
    log_odds = np.zeros((4, 4), np.float32)
    xs, ys = np.array([-9.0, 9.0, 9.0, -9.0]), np.array([-9.0, -9.0, 2.0, 2.0])
    fill_polygon(
        log_odds, xs, ys, 4, np.float32(-1), np.float32(-9), 0, np.zeros((4, 4), np.int32), np.zeros(4, np.int32)
    )
    np.testing.assert_array_equal(log_odds[:2], -1)
    np.testing.assert_array_equal(log_odds[2:], 0)


# Whole scans


def render_slowly(grid: OccupancyGrid, T_map_laser: F64, ranges: F64, bearings: F64, config: GridConfig) -> F64:
    """The log-odds of touching beams, cell by cell and beam by beam, on the frame of an existing grid."""
    log_odds = np.zeros(grid.shape)
    for (x, y, heading), scan in zip(T_map_laser, ranges, strict=True):
        outline = [(x, y)]
        hits: dict[tuple[int, int], float] = {}
        for i, bearing in enumerate(bearings):
            if np.isnan(scan[i]):
                outline.append((x, y))
                continue
            hit = scan[i] <= config.max_range
            spacing = bearings[1] - bearings[0]
            surface = []
            for side in (-1, 0, 1):
                reach = min(scan[i], config.max_range)
                j = i + side
                if side and 0 <= j < len(bearings) and max(scan[i], scan[j]) <= config.max_range:
                    jump = abs(scan[i] - scan[j]) / (spacing * min(scan[i], scan[j]))
                    if jump <= 1 / math.tan(config.min_incidence):
                        # Half way between two beams their chord lies at the harmonic mean of the ranges.
                        reach = 2 * scan[i] * scan[j] / (scan[i] + scan[j]) * math.cos(spacing / 2)
                surface.append((heading + bearing + side * spacing / 2, reach))
            margin = config.resolution if hit else 0.0
            outline += [(x + (r - margin) * math.cos(a), y + (r - margin) * math.sin(a)) for a, r in surface]
            if hit:
                footprint = set()
                ends = [(x + r * math.cos(a), y + r * math.sin(a)) for a, r in surface]
                for (xa, ya), (xb, yb) in itertools.pairwise(ends):
                    footprint |= set(
                        cast_slowly(*((np.array([xa, ya, xb, yb]) - np.tile(grid.origin, 2)) / grid.resolution))[0]
                    )
                for cell in footprint:
                    hits[cell] = max(hits.get(cell, 0.0), HIT / len(footprint))
        xs, ys = (np.array(outline) - grid.origin).T / grid.resolution
        for row in range(grid.shape[0]):
            for col in range(grid.shape[1]):
                if (col, row) in hits:
                    log_odds[row, col] = min(log_odds[row, col] + hits[col, row], LIMIT)
                elif inside_slowly(col + 0.5, row + 0.5, xs, ys):
                    log_odds[row, col] = max(log_odds[row, col] + MISS, -LIMIT)
    return log_odds


def test_rendering_equals_its_slow_twin() -> None:
    bearings = np.linspace(-2.0, 2.0, 33)
    T_map_robot = np.array([[0.113, 0.071, 0.2], [0.35, -0.12, 1.4]])
    ranges = np.stack([room(pose, bearings, (1.6, 1.1)) for pose in T_map_robot])
    ranges[0, 5], ranges[0, 9:12], ranges[1, 20] = np.nan, 0.6, 9.0
    geometry = ScanGeometry(bearings=bearings, range_min=0.02, range_max=30.0)
    config = GridConfig(resolution=0.1, max_range=5.0)
    grid = render_grid(T_map_robot, ranges, geometry, config)
    expected = render_slowly(grid, T_map_robot, ranges.astype(np.float64), bearings, config)
    np.testing.assert_allclose(grid.log_odds, expected, atol=1e-5)
    assert (grid.log_odds > 0).sum() > 30
    assert (grid.log_odds < 0).sum() > 300


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2, 0.7, 2.9, -2.2])
def test_one_wide_beam_frees_what_lies_before_it_and_hits_its_end(heading: float) -> None:
    config = GridConfig(resolution=0.1, beam_width=math.radians(20))
    grid = one_beam((0.05, 0.05, heading), 2.0, config)
    towards = np.array([math.cos(heading), math.sin(heading)])
    for reach in (0.6, 1.0, 1.5, 1.75):
        assert at(grid, *(0.05 + reach * towards)) == pytest.approx(MISS)
    assert at(grid, *(0.05 + 2.0 * towards)) > 0
    assert grid.log_odds[grid.log_odds > 0].sum() == pytest.approx(HIT, rel=1e-4)


def test_a_beam_much_narrower_than_a_cell_claims_no_free_cells_but_its_hit() -> None:
    grid = one_beam((0.02, 0.01, 0.0), 2.0, GridConfig(resolution=0.1, beam_width=math.radians(0.1)))
    assert (grid.log_odds < 0).sum() == 0
    assert (grid.log_odds > 0).sum() == 1
    assert at(grid, 2.02, 0.01) == pytest.approx(HIT)


def test_the_farther_the_wider_and_the_weaker() -> None:
    config = GridConfig(resolution=0.05, beam_width=math.radians(1))
    near, far = one_beam((0, 0.02, 0), 1.02, config), one_beam((0, 0.02, 0), 18.02, config)
    assert (near.log_odds > 0).sum() == 1
    assert (far.log_odds > 0).sum() in {7, 8}  # 0.31 m
    assert far.log_odds.max() == pytest.approx(HIT / (far.log_odds > 0).sum(), rel=1e-4)
    assert near.classes().max() == OCCUPIED
    assert far.classes().max() <= FREE


def test_each_cell_changes_at_most_once_a_scan_and_hit_cells_are_not_missed() -> None:
    geometry = laser()
    grid = render_grid(ORIGIN, room(ORIGIN[0], geometry.bearings)[None], geometry)
    negative = grid.log_odds[grid.log_odds < 0]
    np.testing.assert_allclose(negative, MISS, rtol=1e-6)
    assert grid.log_odds.max() <= HIT + 1e-6
    points = room(ORIGIN[0], geometry.bearings)[:, None] * geometry.directions_robot
    assert (grid.log_odds[grid.cell(points)] > 0).all()
    # The half room that the laser sees, but for the cells at its walls.
    assert len(negative) * grid.resolution**2 == pytest.approx(4.0 * 6.0, rel=0.04)


def test_a_wall_seen_flat_has_no_holes_and_is_not_shot_through() -> None:
    geometry = laser()
    pose = np.array([-3.5, 2.5, 0.0])
    grid = render_grid(pose[None], room(pose, geometry.bearings)[None], geometry)
    assert all(at(grid, x, 3.02) > 0 for x in np.arange(-3.4, -1.0, 0.05))
    beyond = [at(grid, x, 3.1) for x in np.arange(-3.4, 3.9, 0.05)]
    assert min(beyond) >= 0


def test_surfaces_are_not_joined_across_a_jump_in_depth() -> None:
    geometry = laser()
    ranges = np.where(geometry.bearings < 0.005, 2.0, 4.0).astype(np.float32)
    grid = render_grid(ORIGIN, ranges[None], geometry)
    rows, cols = np.nonzero(grid.log_odds > 0)
    centres = grid.origin + (np.stack([cols, rows], axis=1) + 0.5) * grid.resolution
    distances = np.hypot(*centres.T)
    assert (np.minimum(abs(distances - 2.0), abs(distances - 4.0)) < 0.06).all()
    assert at(grid, 3.0, -0.2) == 0  # in the shadow
    assert at(grid, 3.0, 0.2) < 0


def test_narrow_beams_leave_what_is_between_them_unknown() -> None:
    geometry = laser(9, math.radians(80))
    config = GridConfig(beam_width=math.radians(2))
    grid = render_grid(ORIGIN, np.full((1, 9), 5.0, np.float32), geometry, config)
    on, between = math.radians(10), math.radians(15)
    assert at(grid, 4 * math.cos(on), 4 * math.sin(on)) < 0
    assert at(grid, 4 * math.cos(between), 4 * math.sin(between)) == 0


def test_beams_without_return_say_nothing_unless_asked() -> None:
    geometry = laser()
    ranges = np.full((1, 181), np.nan, np.float32)
    ranges[0, :10] = 3.0
    silent = render_grid(ORIGIN, ranges, geometry)
    assert at(silent, 0.5, 0.1) == 0
    spoken = render_grid(ORIGIN, ranges, geometry, GridConfig(no_return_range=2.0))
    assert at(spoken, 1.5, 0.0) == pytest.approx(MISS)
    assert at(spoken, 2.2, 1.0) == 0
    assert (spoken.log_odds > 0).sum() == (silent.log_odds > 0).sum()


def test_returns_beyond_the_range_limit_free_up_to_it() -> None:
    geometry = laser()
    grid = render_grid(ORIGIN, np.full((1, 181), 9.0, np.float32), geometry, GridConfig(max_range=4.0))
    assert grid.log_odds.max() == 0
    assert at(grid, 3.9, 0.0) < 0
    assert grid.extent[1] < 4.2


def test_evidence_is_clamped_and_the_map_changes_its_mind() -> None:
    geometry = laser()
    wall = np.full(181, 3.0, np.float32)
    poses = np.zeros((40, 3))
    every_scan = GridConfig(min_travel=0.0, min_turn=0.0)
    standing = render_grid(poses, np.tile(wall, (40, 1)), geometry, every_scan)
    assert at(standing, 3.01, 0.0) == pytest.approx(LIMIT, rel=1e-4)
    assert standing.log_odds.min() == pytest.approx(-LIMIT, rel=1e-4)
    gone = np.concatenate([np.tile(wall, (30, 1)), np.full((24, 181), 5.0, np.float32)])
    grid = render_grid(np.zeros((54, 3)), gone, geometry, every_scan)
    assert grid.classes()[grid.cell(np.array([3.01, 0.0]))] == FREE


def test_binary_the_latest_observation_decides() -> None:
    geometry = laser()
    ranges = np.stack([np.full(181, reach, np.float32) for reach in (3.0, 3.0, 3.0, 5.0, 4.0)])
    grid = render_grid(np.zeros((5, 3)), ranges, geometry, GridConfig(mode="binary", min_travel=0.0, min_turn=0.0))
    np.testing.assert_allclose(np.unique(grid.log_odds), [-LIMIT, 0.0, LIMIT], rtol=1e-6)
    classes = {reach: grid.classes()[grid.cell(np.array([reach + 0.01, 0.0]))] for reach in (3.0, 4.0, 4.5, 5.0)}
    assert classes == {3.0: FREE, 4.0: OCCUPIED, 5.0: OCCUPIED, 4.5: FREE}


def test_a_laser_all_around_sees_all_around() -> None:
    n = 360
    bearings = -math.pi + np.arange(n) * 2 * math.pi / n
    geometry = ScanGeometry(bearings=bearings, range_min=0.02, range_max=30.0)
    grid = render_grid(ORIGIN, np.full((1, n), 2.0, np.float32), geometry)
    assert (grid.log_odds < 0).sum() * grid.resolution**2 == pytest.approx(math.pi * 1.95**2, rel=0.01)


def test_the_mount_of_the_laser_counts() -> None:
    mounted = laser(mount=(0.3, -0.1, math.pi / 2))
    T_map_robot = np.array([[1.0, 2.0, 0.4]])
    cos, sin = math.cos(0.4), math.sin(0.4)
    T_map_laser = np.array([[1.0 + 0.3 * cos + 0.1 * sin, 2.0 + 0.3 * sin - 0.1 * cos, 0.4 + math.pi / 2]])
    ranges = room(T_map_laser[0], mounted.bearings)[None]
    expected = render_grid(T_map_laser, ranges, laser())
    grid = render_grid(T_map_robot, ranges, mounted)
    np.testing.assert_array_equal(grid.origin, expected.origin)
    np.testing.assert_allclose(grid.log_odds, expected.log_odds, atol=1e-5)


def test_crowded_scans_can_be_left_out() -> None:
    geometry = laser()
    poses = np.zeros((21, 3))
    poses[10:, 0] = 0.5
    poses[20, 2] = 1.0
    ranges = np.stack([room(pose, geometry.bearings) for pose in poses])
    config = GridConfig(min_travel=0.1, min_turn=0.5)
    used = [0, 10, 20]
    np.testing.assert_array_equal(
        render_grid(poses, ranges, geometry, config).log_odds,
        render_grid(poses[used], ranges[used], geometry).log_odds,
    )


def test_classes_follow_the_thresholds() -> None:
    probabilities = np.array([[0.1, 0.44, 0.46, 0.5, 0.59, 0.61, 0.95]])
    grid = OccupancyGrid(
        log_odds=np.log(probabilities / (1 - probabilities)).astype(np.float32), origin=np.zeros(2), resolution=0.1
    )
    np.testing.assert_allclose(grid.occupancy(), probabilities, rtol=1e-6)
    np.testing.assert_array_equal(grid.classes(), [[0, 0, -1, -1, -1, 100, 100]])


def test_same_input_same_bytes() -> None:
    geometry = laser()
    poses = np.stack([np.linspace(-1, 1, 15), np.zeros(15), np.linspace(0, 3, 15)], axis=1)
    ranges = np.stack([room(pose, geometry.bearings) for pose in poses])
    first, second = (render_grid(poses, ranges, geometry).log_odds.tobytes() for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("poses", "ranges", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 181)), r"\(0, 3\), expected \(n, 3\)"),
        (np.zeros((2, 2)), np.zeros((2, 181)), r"\(2, 2\), expected \(n, 3\)"),
        (np.zeros((2, 3)), np.zeros((2, 180)), r"\(2, 180\), expected \(2, 181\)"),
        (np.array([[0, 0, 0], [0, np.nan, 0]]), np.zeros((2, 181)), r"pose 1 .* expected finite"),
        (np.array([[0, 0, 0], [1e6, 0, 0]]), np.ones((2, 181)), r"1000\d\d\d m x .* max_cells = 150000000"),
    ],
)
def test_what_cannot_be_rendered_says_why(poses: F64, ranges: F64, message: str) -> None:
    with pytest.raises(GridError, match=message):
        render_grid(poses, ranges.astype(np.float32), laser(), GridConfig(resolution=0.005))


def test_a_grid_that_would_be_too_large_gets_wider_cells_and_says_so() -> None:
    geometry = laser()
    poses = np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.2]])
    ranges = np.stack([room(pose, geometry.bearings) for pose in poses])
    asked = render_grid(poses, ranges, geometry)
    grid, told = render_grid_that_fits(poses, ranges, geometry)
    assert told is None
    assert grid.log_odds.tobytes() == asked.log_odds.tobytes()
    for max_cells in (asked.log_odds.size // 3, asked.log_odds.size // 9, 16):
        config = GridConfig(max_cells=max_cells)
        grid, told = render_grid_that_fits(poses, ranges, geometry, config)
        assert grid.log_odds.size <= max_cells
        assert told is not None
        assert f"{grid.resolution:g} m wide instead of 0.05 m" in told
        assert f"max_cells = {max_cells}" in told
        with pytest.raises(GridSizeError):
            render_grid(poses, ranges, geometry, replace(config, resolution=grid.resolution / 2))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("resolution", 0.0),
        ("hit_probability", 0.4),
        ("miss_probability", 0.6),
        ("clamp_probability", 0.6),
        ("free_below", 0.7),
        ("max_range", 0.0),
        ("no_return_range", 30.0),
        ("min_incidence", 0.0),
        ("beam_width", 0.0),
        ("max_cells", 15),
    ],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    settings: dict[str, Any] = {name: value}
    with pytest.raises(GridError, match=name):
        GridConfig(**settings)


def test_a_real_log_on_its_true_trajectory(data_dir: Path) -> None:
    log = read_log(data_dir / "mrpt-simul.clf.gz")
    truth = np.loadtxt(data_dir / "mrpt-simul.truth.csv", delimiter=",", skiprows=1)[:, 1:]
    used = slice(None, None, 10)
    grid = render_grid(truth[used], log.ranges[used], log.geometry)
    classes = grid.classes()
    assert (classes[grid.cell(truth[:, :2])] == FREE).mean() > 0.999
    occupied = classes == OCCUPIED
    thick = (
        occupied
        | np.roll(occupied, 1, 0)
        | np.roll(occupied, -1, 0)
        | np.roll(occupied, 1, 1)
        | np.roll(occupied, -1, 1)
    )
    scan = log.scan(800)
    points = scan.points[np.linalg.norm(scan.points, axis=1) < 10]
    x, y, heading = truth[800]
    rotation = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    assert thick[grid.cell(points @ rotation.T + [x, y])].mean() > 0.9


def test_a_robot_that_stands_gathers_no_evidence() -> None:
    geometry = laser()
    wall = np.full(181, 3.0, np.float32)
    once = render_grid(ORIGIN, wall[None], geometry)
    long = render_grid(np.zeros((40, 3)), np.tile(wall, (40, 1)), geometry)
    np.testing.assert_array_equal(long.log_odds, once.log_odds)

"""Which points tell where a scan lies: ends of what was seen, and normals that disagree."""

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import RelativePose
from iceg.ice import _telling_kernels as kernels
from iceg.ice.config import FeatureConfig, LocalMapConfig, RefinementConfig
from iceg.ice.features import FeatureRows
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.ice.points import ScanPoints
from iceg.ice.refinement import evaluate_points

F64 = NDArray[np.float64]
RANGE, DEVIATION = 4.0, 0.025
"""Of a small laser [m]: how far it sees, and what its ranges scatter."""
GEOMETRY = ScanGeometry(
    bearings=np.linspace(-2.0, 2.0, 521), range_min=0.05, range_max=RANGE, T_robot_laser=np.zeros(3)
)


def map_of(*walls: tuple[float, float]) -> LocalMap:
    """Walls along y = 1, seen from below, from and to these x [m]."""
    x = np.concatenate([np.arange(start, end + 1e-9, 0.05) for start, end in walls])
    points = ScanPoints(
        points=np.c_[x, np.ones_like(x)],
        normals=np.tile([0.0, -1.0], (len(x), 1)),
        beams=np.arange(len(x), dtype=np.int32),
        spreads=np.ones(len(x)),
    )
    local_map = LocalMap(np.array([-1.0, -1.0]), np.array([6.0, 4.0]), LocalMapConfig(), FeatureConfig())
    local_map.add(points, FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10))), np.zeros(3))
    return local_map


def lies_beyond(local_map: LocalMap, x: float) -> bool:
    field = local_map.fine
    column, row = np.floor((np.array([x, 1.0]) - field.origin) / field.cell).astype(int)
    k = int(field.nearest[row, column])
    assert k >= 0
    x0, y0 = field.origin.tolist()
    return bool(kernels.beyond_end(x, 1.0, k, local_map.surfels, field.nearest, x0, y0, 1.0 / field.cell))


@pytest.mark.parametrize("x", [0.0, 0.52, 1.7, 3.0, 3.05])
def test_a_point_on_the_wall_is_not_beyond_its_end(x: float) -> None:
    assert not lies_beyond(map_of((0.0, 3.0)), x)


@pytest.mark.parametrize("x", [-0.3, -0.2, 3.2, 3.35])
def test_a_point_that_the_wall_does_not_reach_is(x: float) -> None:
    assert lies_beyond(map_of((0.0, 3.0)), x)


@pytest.mark.parametrize("x", [1.15, 1.3, 1.42])
def test_a_point_in_a_gap_is_not_for_the_wall_goes_on(x: float) -> None:
    assert not lies_beyond(map_of((0.0, 1.0), (1.6, 3.0)), x)


def seen_in_aisle(x: float, rng: np.random.Generator) -> Scan:
    """What a small laser sees at x of a wall 2 m beside it, and of one just within its range that begins at .2 m."""
    bearings = GEOMETRY.bearings
    with np.errstate(divide="ignore"):
        ranges = np.where(bearings > 0.0, 2.0, -3.93) / np.sin(bearings)
    ranges[(bearings < 0.0) & (x + ranges * np.cos(bearings) < 0.2)] = np.inf
    ranges += rng.normal(0.0, DEVIATION, len(ranges))
    ranges[ranges > RANGE] = np.nan
    return Scan(ranges=ranges.astype(np.float32), geometry=GEOMETRY)


def test_a_wall_that_comes_into_range_neither_moves_a_scan_nor_holds_it() -> None:
    """What is seen of it ends where the range does, and that moves along with the robot."""
    rng, offsets, n_weak = np.random.default_rng(5), [], 0
    guess, covariance = np.array([0.5, 0.0, 0.0]), np.diag([0.1, 0.01, 0.01]) ** 2
    for _ in range(60):
        matcher = IceMatcher()
        reference = matcher.prepare([seen_in_aisle(0.0, rng)], np.zeros((1, 3)))
        found = matcher.match(reference, seen_in_aisle(0.5, rng), guess, covariance)
        assert isinstance(found, RelativePose)
        offsets.append(found.T_ref_cur[0] - 0.5)
        n_weak += not found.is_fully_observed
    assert abs(np.mean(offsets)) < 0.03
    assert n_weak > 50


def test_points_whose_normals_disagree_count_but_tell_nothing() -> None:
    local_map, angle = map_of((0.0, 3.0)), np.deg2rad(60.0)
    x = np.linspace(0.5, 2.5, 40)
    normals = np.tile([np.sin(angle), -np.cos(angle)], (40, 1))
    scan = ScanPoints(
        points=np.c_[x, np.ones_like(x)], normals=normals, beams=np.arange(40, dtype=np.int32), spreads=np.ones(40)
    )
    got = evaluate_points(scan, local_map, np.zeros(3), RefinementConfig())
    assert got.used == got.inliers == 40
    np.testing.assert_array_equal(got.hessian, np.zeros((3, 3)))
    assert evaluate_points(scan, local_map, np.zeros(3), RefinementConfig(alike=0.4)).hessian[1, 1] > 30.0

"""Maps of two parts of a path laid onto each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Scan
from graph.se2 import between, compose, inverse, transform_points
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.trajectory import read_truth_csv
from iceg.slam.agreement import agree
from iceg.slam.broken_path.map_alignment import PartMaps, _histogram, _Overlay
from iceg.slam.closure_config import MapAlignmentConfig

_CONFIG = MapAlignmentConfig()
_FIXED, _MOVING = np.arange(60), np.arange(60, 110)


@pytest.fixture(scope="module")
def scans() -> list[Scan]:
    log = read_log(demo_log_path())
    return [log.scan(index) for index in range(0, 1100, 10)]


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_truth_csv(demo_truth_path())[:1100:10]


def _moved(truth: NDArray[np.float64], correction: NDArray[np.float64]) -> NDArray[np.float64]:
    """The poses if what follows the first part must be corrected so."""
    poses = truth.copy()
    poses[_MOVING] = compose(inverse(correction), truth[_MOVING])
    return poses


@settings(max_examples=4, deadline=None)
@given(
    x=st.floats(-40.0, 40.0),
    y=st.floats(-40.0, 40.0),
    turn=st.floats(-3.1, 3.1),
)
def test_a_part_is_laid_where_it_belongs_from_anywhere(
    scans: list[Scan], truth: NDArray[np.float64], x: float, y: float, turn: float
) -> None:
    maps = PartMaps(scans, _moved(truth, np.array([x, y, turn])), _FIXED, _MOVING, _CONFIG)
    middle = np.array([*maps.middle, 0.0])
    offset = between(compose(np.array([x, y, turn]), middle), compose(maps.alignments()[0], middle))
    assert np.hypot(*offset[:2]) < 0.4
    assert abs(offset[2]) < 0.03


def test_nothing_tells_more_than_the_right_place(scans: list[Scan], truth: NDArray[np.float64]) -> None:
    maps = PartMaps(scans, truth, _FIXED, _MOVING, _CONFIG)
    here = maps.log_odds(np.zeros(3))
    assert here > 0.0
    for correction in ([0.6, 0.0, 0.0], [0.0, -0.6, 0.0], [0.0, 0.0, 0.1], [3.0, 2.0, 1.0]):
        assert maps.log_odds(np.array(correction)) < here
    assert maps.log_odds(np.array([500.0, 0.0, 0.0])) == 0.0, "maps that do not overlap tell nothing"


def test_ways_differ_and_the_best_is_first(scans: list[Scan], truth: NDArray[np.float64]) -> None:
    maps = PartMaps(scans, truth, _FIXED, _MOVING, _CONFIG)
    middle = np.array([*maps.middle, 0.0])
    found = [compose(correction, middle) for correction in maps.alignments()]
    assert 1 < len(found) <= _CONFIG.most
    assert not any(agree(one, other, _CONFIG.one_way) for index, one in enumerate(found) for other in found[:index])
    assert agree(found[0], middle, _CONFIG.one_way)


def test_scans_that_see_nothing_make_no_map(scans: list[Scan], truth: NDArray[np.float64]) -> None:
    blind = [Scan(ranges=np.full_like(scan.ranges, np.nan), geometry=scan.geometry) for scan in scans]
    assert PartMaps(blind, truth, _FIXED, _MOVING, _CONFIG).are_empty


def test_a_map_kilometres_wide_has_no_more_cells(scans: list[Scan], truth: NDArray[np.float64]) -> None:
    far = truth.copy()
    far[30:60, :2] += 5000.0
    maps = PartMaps(scans, far, _FIXED, _MOVING, _CONFIG)
    assert maps._fine._walls.size <= (_CONFIG.most_compared + 4) ** 2
    assert maps._coarse._walls.size <= (_CONFIG.most_cells + 4) ** 2


def test_the_transform_tells_what_sums_over_cells_do() -> None:
    """Every shift of a small map over another, counted cell by cell."""
    rng = np.random.default_rng(0)
    walls = np.asarray(rng.integers(-9, 10, (9, 7)), dtype=np.float64)
    space = np.asarray(rng.integers(-9, 10, (9, 7)), dtype=np.float64)
    overlay = _Overlay.__new__(_Overlay)
    overlay._each_rotation = 3
    overlay.cell, overlay._corner, overlay._walls, overlay._space = 1.0, np.zeros(2), walls, space
    cells = np.asarray(np.argwhere(rng.random((5, 4)) < 0.4) + 0.5, dtype=np.float64)
    overlay._occupied, overlay._free = cells[::2], cells[1::2]
    middle = np.array([2.0, 2.0])
    score, place = max(overlay.best(middle, 1), key=lambda found: found[0])
    best = -np.inf
    for turn in np.unique([found[1][2] for found in overlay.best(middle, 1)]).tolist():
        above = [
            np.floor(transform_points(np.array([0.0, 0.0, turn]), each - middle)) for each in (cells[::2], cells[1::2])
        ]
        for shift in np.stack(np.meshgrid(np.arange(-6, 16), np.arange(-6, 14)), axis=-1).reshape(-1, 2):
            total = 0.0
            for below, points in zip((walls, space), above, strict=True):
                at = (points + shift).astype(np.int64)
                at = at[(at >= 0).all(axis=1) & (at < below.shape).all(axis=1)]
                total += float(below[tuple(at.T)].sum())
            best = max(best, total)
    assert score == best
    assert_allclose(place[:2], np.round(place[:2]), atol=1e-9)


def test_a_histogram_counts_cells() -> None:
    counts = _histogram(np.array([[0, 1], [2, 0], [0, 1]]), np.array([3, 2]))
    assert counts.tolist() == [[0, 2], [0, 0], [1, 0]]

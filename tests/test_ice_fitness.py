"""Fitness: equations (1)-(3) by hand, the probabilistic form and the dense agreement against slow twins."""

import numpy as np
import pytest
from numpy.typing import NDArray

from iceg.ice.config import FeatureConfig, HypothesisConfig, LocalMapConfig
from iceg.ice.features import CORNER, END_OF_WALL, INTERSECTION, FeatureRows
from iceg.ice.fitness import importance, rank_by_features, rank_by_points
from iceg.ice.local_map import LocalMap
from iceg.ice.points import ScanPoints

F64 = NDArray[np.float64]


@pytest.mark.parametrize(
    ("distance", "value", "tolerance"), [(0.0, 0.68, 5e-3), (0.4, 0.65, 5e-3), (1.0, 0.60, 1e-12), (20.0, 0.075, 5e-3)]
)
def test_importance_as_the_paper_gives_it(distance: float, value: float, tolerance: float) -> None:
    assert importance(np.array([distance]))[0] == pytest.approx(value, abs=tolerance)


def test_importance_falls_with_the_distance() -> None:
    assert (np.diff(importance(np.linspace(0, 30, 100))) < 0).all()


def rows_of(*features: tuple[int, float, float, float, float, float]) -> FeatureRows:
    """Features from kind, x, y, clockwise heading, counter-clockwise heading, distance."""
    rows = np.zeros((len(features), 10))
    for row, (_, x, y, a, b, distance) in zip(rows, features, strict=True):
        row[:] = [x, y, a, b, 1e-3, 2e-4, 2e-3, 1e-3, 1.0, distance]
    return FeatureRows(kinds=np.array([f[0] for f in features], np.int8), rows=rows)


NAN = np.nan
NEW = rows_of((CORNER, 1.0, 0.0, 0.0, 1.5, 1.0), (END_OF_WALL, 0.0, 2.0, NAN, 1.0, 2.0))
REF = rows_of(
    (CORNER, 1.05, 0.0, 0.02, 1.5, 4.0),
    (INTERSECTION, 1.01, 0.0, 0.0, 1.5, 1.0),
    (END_OF_WALL, 0.0, 2.0, NAN, 1.0, 20.0),
    (END_OF_WALL, 0.0, 2.01, 1.0, NAN, 20.0),
)


def test_the_papers_fitness_by_hand() -> None:
    hypotheses = np.zeros((1, 3))
    ranking = rank_by_features(NEW, REF, hypotheses, "paper")
    # The corner's nearest is the intersection (a corner may be one), 0.01 m away with equal angles; the end of wall
    # meets itself. P = √(fImp fImp) by equation (2), Σ(dis·P)/(count²·ΣP) by equation (1).
    p = np.sqrt(importance(np.array([1.0, 2.0])) * importance(np.array([1.0, 20.0])))
    expected = np.exp(-(0.01 * p[0] + 0.0 * p[1]) / (4 * p.sum()))
    assert ranking.counts.tolist() == [2]
    assert ranking.correlations[0] == pytest.approx(expected, rel=1e-9)


def test_the_probabilistic_fitness_against_a_twin() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        pose = rng.normal(0, 1, 3) * [0.05, 0.05, 0.05]
        got = rank_by_features(NEW, REF, pose[None], "probabilistic").correlations[0]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        R = np.array([[c, -s], [s, c]])
        total = 0.0
        for kind, row in zip(NEW.kinds, NEW.rows, strict=True):
            best = None
            for ref_kind, ref in zip(REF.kinds, REF.rows, strict=True):
                d = ref[:2] - (pose[:2] + R @ row[:2])
                angles = np.abs(ref[2:4] - row[2:4] - pose[2])
                angles = angles[np.isfinite(angles)]
                if kind != ref_kind and CORNER not in {int(kind), int(ref_kind)}:
                    continue
                if np.hypot(*d) > row[9] / 50 + 0.1 or len(angles) == 0 or angles.max() > 0.35:
                    continue
                if best is None or np.hypot(*d) < best[0]:
                    own, other = (np.array([[r[4], r[5]], [r[5], r[6]]]) for r in (row, ref))
                    covariance = R @ own @ R.T + other + 4e-4 * np.eye(2)
                    far = d @ np.linalg.solve(covariance, d) + angles.max() ** 2 / (row[7] + ref[7] + 1e-3)
                    best = (np.hypot(*d), far)
            total += 0.0 if best is None else float(np.exp(-0.5 * best[1]))
        assert got == pytest.approx(total / 2, rel=1e-9)


def test_the_paper_counts_before_it_correlates() -> None:
    # The second hypothesis has both coincidences a little off, the first only one, but that one exactly.
    lone = rows_of((CORNER, 1.0, 0.0, 0.0, 1.5, 1.0))
    pair = rows_of((CORNER, 1.0, 0.0, 0.0, 1.5, 1.0), (END_OF_WALL, 0.0, 9.1, NAN, 1.0, 9.0))
    new = rows_of((CORNER, 1.0, 0.0, 0.0, 1.5, 1.0), (END_OF_WALL, 0.0, 8.78, NAN, 1.0, 9.0))
    hypotheses = np.array([[0.0, 0.0, 0.0], [0.0, 0.05, 0.0]])
    ranking = rank_by_features(new, pair, hypotheses, "paper")
    assert ranking.counts.tolist() == [1, 2]
    assert ranking.order.tolist() == [1, 0]
    assert rank_by_features(new, lone, hypotheses, "paper").order.tolist() == [0, 1]


def test_no_coincidence_scores_nothing() -> None:
    for fitness in ("paper", "probabilistic"):
        ranking = rank_by_features(NEW, REF, np.array([[9.0, 9.0, 0.0]]), fitness)
        assert ranking.counts[0] == 0
        assert ranking.correlations[0] == 0.0


def wall_map() -> tuple[LocalMap, ScanPoints]:
    """Three walls of a room as local map, and the same points as scan."""
    line = np.linspace(-2.0, 2.0, 60)
    ends = np.full_like(line, 2.0)
    points = np.concatenate([np.c_[line, ends], np.c_[ends, line], np.c_[line, -ends]])
    normals = np.repeat([[0.0, -1.0], [-1.0, 0.0], [0.0, 1.0]], 60, axis=0)
    beams = np.arange(180, dtype=np.int32)
    scan_points = ScanPoints(points=points, normals=normals, beams=beams, spreads=np.ones(180))
    local_map = LocalMap(np.array([-5.0, -5.0]), np.array([5.0, 5.0]), LocalMapConfig(), FeatureConfig())
    nothing = FeatureRows(kinds=np.empty(0, np.int8), rows=np.empty((0, 10)))
    local_map.add(scan_points, nothing, np.zeros(3))
    return local_map, scan_points


def test_dense_agreement_against_a_twin() -> None:
    local_map, scan_points = wall_map()
    hypotheses = np.random.default_rng(1).uniform(-1, 1, (40, 3))
    config = HypothesisConfig(ranking_points=60, field_sigma=0.2)
    got = rank_by_points(scan_points, local_map, hypotheses, config, sift=False)
    field = local_map.coarse
    for pose, score in zip(hypotheses, got.correlations, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        picked = scan_points.points[((np.arange(60) + 0.5) * 3).astype(int)]
        p = pose[:2] + picked @ np.array([[c, s], [-s, c]])
        cells = np.floor((p - field.origin) / field.cell).astype(int)
        d2 = field.distance2[cells[:, 1], cells[:, 0]]
        assert score == pytest.approx(np.exp(-d2 / (2 * 0.2**2)).mean(), rel=1e-5)
    assert (np.diff(got.correlations[got.order]) <= 0).all()


def test_sifting_keeps_the_best() -> None:
    local_map, scan_points = wall_map()
    rng = np.random.default_rng(2)
    hypotheses = np.vstack([rng.uniform(-2, 2, (500, 3)), rng.normal(0, 0.05, (10, 3))])
    whole = rank_by_points(scan_points, local_map, hypotheses, HypothesisConfig(), sift=False)
    sifted = rank_by_points(scan_points, local_map, hypotheses, HypothesisConfig(), sift=True)
    assert sifted.order[:10].tolist() == whole.order[:10].tolist()
    np.testing.assert_array_equal(sifted.correlations[sifted.order[:10]], whole.correlations[whole.order[:10]])
    assert (sifted.correlations >= 0).all()
    assert (sifted.correlations <= 1).all()

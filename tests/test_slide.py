"""A closure that fits as well where it slides to says so."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.measurement import RelativePose
from graph.se2 import between, compose, transform_points
from iceg.ice.verification import Agreement
from iceg.slam.closures.slide import with_open_slide

F64 = NDArray[np.float64]
ON_ARC = np.array([1.0, 0.0, 0.05])
"""A step along a corridor that turns left about a centre 20 m away."""
CENTRE = np.array([0.0, 20.0])


def match_of(deviations: tuple[float, float, float], direction: F64 = ON_ARC) -> RelativePose:
    along = direction / np.linalg.norm(direction)
    across = np.linalg.svd(along[None])[2][1:]
    basis = np.vstack([along, across])
    return RelativePose(
        T_ref_cur=np.zeros(3),
        covariance=basis.T @ np.diag(np.square(deviations)) @ basis,
        score=0.9,
        inliers=100,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )


def agreeing(extra_at: Callable[[F64], int]) -> Callable[[F64], list[Agreement]]:
    """Agreement of 200 points anywhere, and of some more that depend on the pose."""

    def supports(T_ref_news: F64) -> list[Agreement]:
        return [Agreement(points=300, known=250, inliers=200 + extra_at(T), seen=100) for T in T_ref_news]

    return supports


def opened(match: RelativePose, extra_at: Callable[[F64], int]) -> RelativePose:
    supports = agreeing(extra_at)
    return with_open_slide(match, supports(match.T_ref_cur[None])[0], supports)


def nowhere(_: F64) -> int:
    return 0


def test_what_fits_as_well_along_the_arc_is_left_open() -> None:
    got = opened(match_of((0.03, 0.005, 0.002)), nowhere)
    np.testing.assert_allclose(np.abs(got.weak_directions), [ON_ARC / np.linalg.norm(ON_ARC)], atol=1e-9)
    assert got.covariance[0, 0] == pytest.approx(1.0, rel=0.01)
    across = np.linalg.svd(got.weak_directions)[2][1:]
    np.testing.assert_allclose(np.sqrt(np.linalg.eigvalsh(across @ got.covariance @ across.T)), [0.002, 0.005])


def test_it_is_slid_on_the_arc() -> None:
    seen: list[F64] = []

    def note(T: F64) -> int:
        seen.append(transform_points(T, CENTRE))
        return 0

    opened(match_of((0.03, 0.005, 0.002)), note)
    assert len(seen) > 20
    np.testing.assert_allclose(seen, np.broadcast_to(CENTRE, (len(seen), 2)), atol=1e-9)


def test_what_stands_out_is_kept() -> None:
    match = match_of((0.03, 0.005, 0.002))
    assert opened(match, lambda T: 20 if np.hypot(*T[:2]) < 0.2 else 0) is match


def test_a_better_fit_elsewhere_leaves_it_open() -> None:
    there = compose(np.zeros(3), np.array([1.0, 0.025, 0.05]))

    def extra(T: F64) -> int:
        return 20 if np.hypot(*T[:2]) < 0.2 else 30 if np.hypot(*between(there, T)[:2]) < 0.2 else 0

    assert len(opened(match_of((0.03, 0.005, 0.002)), extra).weak_directions) == 1


def test_a_match_that_knows_all_directions_alike_is_not_asked() -> None:
    match = match_of((0.01, 0.005, 0.004))

    def never(T_ref_news: F64) -> list[Agreement]:
        raise AssertionError(f"asked at {T_ref_news}")

    assert with_open_slide(match, Agreement(), never) is match

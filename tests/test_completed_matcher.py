"""Any matcher in the pipeline: what it does not do itself is made of its matches."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.se2 import compose
from iceg.slam.completed_matcher import CompletedMatcher

_GUESS = np.array([0.3, -0.1, 0.2])


class _Sliding:
    """Matches so far from every guess, and is sure of it; or nowhere."""

    def __init__(self, slide: NDArray[np.float64] | None) -> None:
        self._slide = slide

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> None:
        del scans, T_ref_scans

    def match(
        self, reference: Any, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> RelativePose | NoMatch:
        del reference, scan, covariance_guess
        if self._slide is None:
            return NoMatch(reason="nowhere")
        return RelativePose(
            T_ref_cur=compose(T_ref_guess, self._slide),
            covariance=np.eye(3) * 1e-6,
            score=0.9,
            inliers=90,
            overlap=1.0,
            weak_directions=np.empty((0, 3)),
        )


@pytest.fixture(scope="module")
def corner() -> Scan:
    """Two walls, 2 m ahead and 2 m to the left."""
    bearings = np.linspace(-1.5, 1.5, 181)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(2.0 / np.cos(bearings), np.where(bearings > 0, 2.0 / np.sin(bearings), np.inf))
    geometry = ScanGeometry(bearings=bearings, range_min=0.1, range_max=20.0)
    return Scan(ranges=np.where(ranges < 20.0, ranges, np.nan).astype(np.float32), geometry=geometry)


def _near(slide: NDArray[np.float64] | None, scan: Scan) -> RelativePose:
    matcher = CompletedMatcher(_Sliding(slide))
    found = matcher.match_near(matcher.prepare([scan], _GUESS[None]), scan, _GUESS)
    assert isinstance(found, RelativePose)
    return found


def test_a_match_near_the_guess_is_the_matchers_own(corner: Scan) -> None:
    slide = np.array([0.04, 0.0, 0.01])
    found = _near(slide, corner)
    np.testing.assert_allclose(found.T_ref_cur, compose(_GUESS, slide), atol=0.005)
    assert found.covariance[0, 0] == 1e-6


@pytest.mark.parametrize("slide", [np.array([0.8, 0.0, 0.0]), np.array([0.0, 0.0, 0.2]), None])
def test_where_a_match_slides_away_the_judge_keeps_the_scan_near_the_guess(
    corner: Scan, slide: NDArray[np.float64] | None
) -> None:
    found = _near(slide, corner)
    np.testing.assert_allclose(found.T_ref_cur, _GUESS, atol=0.005)  # the reference is the scan itself
    assert (np.sqrt(np.diag(found.covariance)) >= (0.05, 0.05, 0.02)).all()

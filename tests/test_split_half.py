"""Halves of scans that tell how sure matches are: their distances, the factor they ask for, and where it goes."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.matcher import Matcher
from frontends.scan import Scan, ScanGeometry
from frontends.simulator.laser import Laser
from frontends.simulator.simulation import Simulation, simulate
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from iceg.config import Config
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult
from iceg.slam.checked_settings import SlamConfigError
from iceg.slam.config import FrontEndConfig
from iceg.slam.match_errors import closure_covariance
from iceg.slam.stages import Stages
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log
from iceg.slam.tracking.split_half import (
    halves,
    match_covariance_scale,
    split_half_distances,
    with_measured_covariance_scale,
)
from iceg.slam.tracking_config import SplitHalfConfig

Array = NDArray[np.float64]

_USUAL = SplitHalfConfig()
_COARSE = GridConfig(resolution=0.5)
_BOAST = 9.0
"""Factor by which a boasting matcher's variances are too small."""


class _Boasting(IceMatcher):
    """ICE with variances that are too small."""

    def match(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: Array,
        covariance_guess: Array,
    ) -> RelativePose | NoMatch:
        found = super().match(reference, scan, T_ref_guess, covariance_guess)
        return found if isinstance(found, NoMatch) else replace(found, covariance=found.covariance / _BOAST)


class _Other:
    """A matcher that is not ICE, and boasts as well."""

    def __init__(self) -> None:
        self._boasting = _Boasting()

    def prepare(self, scans: list[Scan], T_ref_scans: Array) -> LocalMap:
        return self._boasting.prepare(scans, T_ref_scans)

    def match(
        self, reference: LocalMap, scan: Scan, T_ref_guess: Array, covariance_guess: Array
    ) -> RelativePose | NoMatch:
        return self._boasting.match(reference, scan, T_ref_guess, covariance_guess)


@lru_cache
def _room() -> Simulation:
    return simulate("room", seed=4)


@lru_cache
def _track() -> Track:
    return track_log(_room().log, IceMatcher(), OdometryModel(), FrontEndConfig())


def _covariances(track: Track) -> Array:
    return np.array([key.match.covariance for key in track.keys if isinstance(key.match, RelativePose)])


def test_halves_share_the_returns_of_a_scan() -> None:
    ranges = np.array([np.nan, 1.0, 2.0, np.nan, 3.0, 4.0, 5.0, 6.0, np.nan], np.float32)
    geometry = ScanGeometry(bearings=np.linspace(-1.0, 1.0, 9), range_min=0.1, range_max=20.0)
    first, last = halves(Scan(ranges=ranges, geometry=geometry))
    nan = np.nan
    np.testing.assert_array_equal(first.ranges, np.array([nan, 1.0, 2.0, nan, 3.0, nan, nan, nan, nan], np.float32))
    np.testing.assert_array_equal(last.ranges, np.array([nan, nan, nan, nan, nan, 4.0, 5.0, 6.0, nan], np.float32))
    assert first.geometry is geometry
    assert first.ranges.dtype == np.float32


def test_halves_of_an_empty_scan_are_empty() -> None:
    geometry = ScanGeometry(bearings=np.linspace(-1.0, 1.0, 4), range_min=0.1, range_max=20.0)
    for half in halves(Scan(ranges=np.full(4, np.nan, np.float32), geometry=geometry)):
        assert np.isnan(half.ranges).all()


def test_usual_distances_leave_matches_as_they_are() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        usual = 0.55 * rng.chisquare(3, 400)
        assert match_covariance_scale(usual, _USUAL) == pytest.approx(1.0, abs=0.08)
        assert match_covariance_scale(0.1 * usual, _USUAL) == 1.0  # never surer than calibrated


def test_the_scale_is_the_factor_by_which_halves_lie_too_far_apart() -> None:
    usual = 0.58 * np.random.default_rng(1).chisquare(3, 4000)
    assert match_covariance_scale(5.0 * usual, _USUAL) == pytest.approx(5.0, rel=0.06)
    # It scales with the distances, whatever their spread.
    assert match_covariance_scale(20.0 * usual, _USUAL) == pytest.approx(
        4.0 * match_covariance_scale(5.0 * usual, _USUAL), rel=1e-2
    )


def test_what_few_scans_say_counts_for_less_and_one_says_nothing() -> None:
    assert match_covariance_scale(np.empty(0), _USUAL) == 1.0
    assert match_covariance_scale(np.array([50.0]), _USUAL) == 1.0
    distances2 = np.array([1.0, 4.0, 9.0, 4.0])
    assert 1.0 < match_covariance_scale(distances2, _USUAL) < match_covariance_scale(np.tile(distances2, 20), _USUAL)


def test_a_scan_that_matched_wrong_hardly_counts() -> None:
    usual = 2.0 * np.random.default_rng(2).chisquare(3, 40)
    wrong = np.append(usual, 1e4)
    assert match_covariance_scale(wrong, _USUAL) < 1.25 * match_covariance_scale(usual, _USUAL)


def test_halves_of_simulated_scans_agree_as_usual() -> None:
    distances2 = split_half_distances(_track(), IceMatcher(), SplitHalfConfig(scans=200))
    assert len(distances2) > 50
    assert 0.7 < np.exp(np.log(np.maximum(distances2, 0.05)).mean()) < 1.7
    assert (
        with_measured_covariance_scale(_track(), IceMatcher(), SplitHalfConfig(scans=40)).match_covariance_scale < 1.2
    )


def test_the_distances_are_those_of_the_covariances() -> None:
    distances2 = split_half_distances(_track(), IceMatcher(), SplitHalfConfig(scans=20))
    assert len(distances2) <= 20
    np.testing.assert_allclose(
        split_half_distances(_track(), _Boasting(), SplitHalfConfig(scans=20)), _BOAST * distances2
    )


def test_a_boast_is_taken_back() -> None:
    track = _track()
    inflated = with_measured_covariance_scale(track, _Boasting(), SplitHalfConfig(scans=60))
    assert inflated.match_covariance_scale == pytest.approx(_BOAST, rel=0.4)
    np.testing.assert_allclose(_covariances(inflated), inflated.match_covariance_scale * _covariances(track))
    assert isinstance(inflated.keys[0].match, NoMatch)
    np.testing.assert_array_equal(inflated.T_key_scan, track.T_key_scan)


def test_without_tests_matches_are_believed() -> None:
    assert with_measured_covariance_scale(_track(), _Boasting(), SplitHalfConfig(scans=0)) is _track()
    with pytest.raises(SlamConfigError, match="found scans -1, expected 0 or more"):
        SplitHalfConfig(scans=-1)


def test_a_track_too_short_for_a_local_map_is_believed() -> None:
    short = replace(_track(), keys=_track().keys[:12])
    assert with_measured_covariance_scale(short, _Boasting(), SplitHalfConfig(scans=40)) is short


def test_ranges_that_come_in_steps_inflate_the_covariances() -> None:
    # Neighbouring beams share an error of up to half a step: the match moves with them.
    log = simulate("room", seed=4, laser=Laser(quantisation=0.16)).log
    stepped = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    far, usual = (
        split_half_distances(track, IceMatcher(), SplitHalfConfig(scans=200)) for track in (stepped, _track())
    )
    assert np.log(far).mean() > np.log(usual).mean() + 0.2


def test_closures_are_inflated_as_the_matches_are() -> None:
    match = RelativePose(
        T_ref_cur=np.array([1.0, 0.0, 0.0]),
        covariance=np.diag([1e-4, 2e-4, 3e-5]),
        score=1.0,
        inliers=100,
        overlap=1.0,
        weak_directions=np.zeros((0, 3)),
    )
    placement = np.diag([1e-5, 1e-5, 1e-6])
    twice = closure_covariance(match, placement, 2.0)
    np.testing.assert_allclose(twice - closure_covariance(match, placement), match.covariance)


@lru_cache
def _result(matcher: type[Matcher], scans: int) -> SlamResult:
    config = Config(grid=_COARSE, front_end=FrontEndConfig(split_half=SplitHalfConfig(scans=scans)))
    return run(_room().log, config, stages=Stages(matcher=matcher()))


def _width(matcher: type[Matcher], scans: int) -> float:
    """Median variance of the position of key poses [m²]."""
    covariances = _result(matcher, scans).covariances[1:, :2, :2]
    return float(np.median(np.trace(covariances, axis1=1, axis2=2)))


def test_a_boasting_matcher_ends_with_nearly_honest_factors() -> None:
    honest, taken_back, believed = _result(IceMatcher, 0), _result(_Boasting, 60), _result(_Boasting, 0)
    assert believed.summary["match_covariance_scale"] == 1.0
    assert taken_back.summary["match_covariance_scale"] > 4.0
    for kind in ("ice", "closure"):
        sizes = [
            np.median([np.trace(factor.covariance) for factor in result.graph.factors if factor.kind == kind])
            for result in (honest, taken_back, believed)
        ]
        assert sizes[2] < 0.6 * sizes[0], kind
        assert 0.5 * sizes[0] < sizes[1] < 1.5 * sizes[0], kind


def test_the_scale_of_ice_is_that_of_the_points_on_shared_walls() -> None:
    assert _width(_Boasting, 60) > 2.0 * _width(_Boasting, 0)


def test_the_scale_of_another_matcher_is_not() -> None:
    assert _width(_Other, 60) == pytest.approx(_width(_Other, 0), rel=0.3)
    assert _result(_Other, 60).summary["match_covariance_scale"] > 4.0

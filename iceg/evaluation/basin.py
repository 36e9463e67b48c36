"""How far off a matcher may start: success over the initial error, accuracy, honesty and time on pairs of scans."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from frontends.matchers import make_matcher
from frontends.scan import Scan
from graph.elementary import cos_sin
from graph.measurement import NoMatch
from graph.se2 import wrap_angle
from iceg.config import MatcherName
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.consistency import Consistency, consistency, nees, relative_pose_errors
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.scan_pairs import ScanPair, errors_against, is_success
from iceg.ice.config import HypothesisConfig, IceConfig, Search

_CERTAINLY_OUTSIDE = 16.27
"""99.9 % of the chi-square distribution with three degrees of freedom."""
_LEAST_SIGMA_M, _LEAST_SIGMA_RAD = 0.05, radians(2.0)
"""Least standard deviation of the guess that a matcher is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trials:
    """What a matcher made of n starts.

    Attributes:
        errors: (n, 3) of the matches in the tangent space at them, order x, y, θ; NaN where it refused.
        covariances: (n, 3, 3) that it claimed; NaN where it refused.
        succeeded: (n,) whether the pose lies within 0.15 m and 3° of the truth.
        milliseconds: (n,) CPU time of each match, everything done for the new scan included.
    """

    errors: NDArray[np.float64]
    covariances: NDArray[np.float64]
    succeeded: NDArray[np.bool_]
    milliseconds: NDArray[np.float64]

    @property
    def success(self) -> float:
        """Share that succeeded."""
        return float(self.succeeded.mean())

    @property
    def wrong(self) -> float:
        """Share that it got wrong without knowing: off by more than that, and outside their own 99.9 % region.

        A match that slid along a corridor and says so, by a covariance as long as its error, is not among them.
        """
        off = ~self.succeeded & np.isfinite(self.errors[:, 0])
        return float((nees(self.errors[off], self.covariances[off]) > _CERTAINLY_OUTSIDE).sum()) / len(off)

    @property
    def median_ms(self) -> float:
        """Median CPU time of a match [ms]."""
        return float(np.median(self.milliseconds))

    @property
    def median_error_m(self) -> float:
        """Median distance from the truth of those that succeeded [m]; NaN without any."""
        good = self.errors[self.succeeded]
        return float(np.median(np.hypot(good[:, 0], good[:, 1]))) if len(good) else float("nan")

    @property
    def median_error_rad(self) -> float:
        """Median heading error of those that succeeded [rad]; NaN without any."""
        good = self.errors[self.succeeded]
        return float(np.median(np.abs(good[:, 2]))) if len(good) else float("nan")

    def consistency(self) -> Consistency:
        """NEES of those that succeeded: 3 on average is right, more is over-confident.

        Raises:
            EvaluationError: none succeeded.
        """
        return consistency(nees(self.errors[self.succeeded], self.covariances[self.succeeded]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Basin:
    """Success over the initial error.

    Attributes:
        translations: (t,) distance of the starts from the truth, in any direction [m].
        rotations: (r,) their heading error, to either side [rad].
        success: (t, r) share of the pairs that succeeded.
    """

    translations: NDArray[np.float64]
    rotations: NDArray[np.float64]
    success: NDArray[np.float64]


def named_matcher(name: MatcherName) -> Matcher:
    """A matcher with its defaults, ICE among them."""
    from iceg.ice.matcher import IceMatcher

    return IceMatcher() if name == "ice" else make_matcher(name)


def uniform_starts(
    pairs: Sequence[ScanPair], translation: float, rotation: float, seed: int = 0
) -> NDArray[np.float64]:
    """Starts off by up to so much: uniform in x, y and heading.

    Args:
        pairs: of scans.
        translation: largest error along x and along y [m].
        rotation: largest error of the heading [rad].
        seed: of the draw.

    Returns:
        (n, 3) T_ref_guess.
    """
    off = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(pairs), 3)) * [translation, translation, rotation]
    return _off(pairs, off)


def starts_at(pairs: Sequence[ScanPair], translation: float, rotation: float, seed: int = 0) -> NDArray[np.float64]:
    """Starts off by exactly so much, in a random direction and to a random side.

    Args:
        pairs: of scans.
        translation: distance from the truth [m].
        rotation: error of the heading, to either side [rad].
        seed: of the draw.

    Returns:
        (n, 3) T_ref_guess.
    """
    rng = np.random.default_rng(seed)
    bearings, sides = rng.uniform(-np.pi, np.pi, len(pairs)), rng.choice([-1.0, 1.0], len(pairs))
    return _off(pairs, np.column_stack([*(translation * part for part in cos_sin(bearings)), rotation * sides]))


def run_trials(
    matcher: Matcher, pairs: Sequence[ScanPair], starts: NDArray[np.float64], sigma_m: float, sigma_rad: float
) -> Trials:
    """Match every pair once.

    Args:
        matcher: any.
        pairs: of scans.
        starts: (n, 3) T_ref_guess of each.
        sigma_m: standard deviation of the starts along x and y [m], as the matcher is told …
        sigma_rad: … and of their heading [rad].

    Raises:
        EvaluationError: no pair.
    """
    return _trials(matcher, pairs, _references(matcher, pairs), starts, sigma_m, sigma_rad)


def trials_within(
    matcher: Matcher, pairs: Sequence[ScanPair], translation: float, rotation: float, seed: int = 0
) -> Trials:
    """Match every pair once from a start off by up to so much; arguments as `uniform_starts`."""
    starts = uniform_starts(pairs, translation, rotation, seed)
    return run_trials(matcher, pairs, starts, translation / 3**0.5, rotation / 3**0.5)


def basin(
    matcher: Matcher,
    pairs: Sequence[ScanPair],
    translations: Sequence[float],
    rotations: Sequence[float],
    seed: int = 0,
) -> Basin:
    """Success over distance and turn of the start, each pair once for each of both.

    Args:
        matcher: any.
        pairs: of scans.
        translations: distances of the start from the truth [m].
        rotations: heading errors of the start [rad].
        seed: of directions and sides; the same for every matcher.

    Raises:
        EvaluationError: no pair.
    """
    references = _references(matcher, pairs)
    success = [
        [
            _trials(matcher, pairs, references, starts_at(pairs, distance, turn, seed), distance / 2**0.5, turn).success
            for turn in rotations
        ]
        for distance in translations
    ]
    return Basin(translations=np.array(translations), rotations=np.array(rotations), success=np.array(success))


def summary_row(name: str, near: Trials, far: Trials) -> Row:
    """One matcher's line of a table.

    Args:
        name: of the matcher.
        near: from starts that are nearly right: accuracy, honesty and time are taken from these.
        far: from starts that are far off.
    """
    honest = near.consistency() if near.succeeded.any() else None
    return {
        "matcher": name,
        "success near [%]": 100 * near.success,
        "success far [%]": 100 * far.success,
        "wrong far [%]": 100 * far.wrong,
        "median error [mm]": 1e3 * near.median_error_m,
        "median error [°]": degrees(near.median_error_rad),
        "NEES median": float("nan") if honest is None else honest.median,
        "NEES mean": float("nan") if honest is None else honest.mean,
        "ms near": near.median_ms,
        "ms far": far.median_ms,
    }


def search_row(search: Search, pairs: Sequence[ScanPair], windows: Sequence[tuple[float, float]], seed: int = 0) -> Row:
    """One search over hypotheses as a line of a table: what ICE finds with it, and in what time.

    Args:
        search: the search.
        pairs: of scans.
        windows: largest error of the starts along x and y [m], and of their heading [rad]; one after the other.
        seed: of the starts.
    """
    from iceg.ice.matcher import IceMatcher

    matcher = IceMatcher(IceConfig(hypotheses=HypothesisConfig(search=search)))
    row: Row = {"search": search}
    for translation, rotation in windows:
        trials = trials_within(matcher, pairs, translation, rotation, seed)
        window = f"±{translation:g} m, ±{degrees(rotation):.0f}°"
        row |= {
            f"{window}: success [%]": 100 * trials.success,
            f"{window}: error [mm]": 1e3 * trials.median_error_m,
            f"{window}: time [ms]": trials.median_ms,
        }
    return row


def _off(pairs: Sequence[ScanPair], off: NDArray[np.float64]) -> NDArray[np.float64]:
    starts = np.array([pair.T_ref_cur for pair in pairs]).reshape(-1, 3) + off
    starts[:, 2] = wrap_angle(starts[:, 2])
    return starts


def _references(matcher: Matcher, pairs: Sequence[ScanPair]) -> list[Any]:
    if not pairs:
        raise EvaluationError("found no pair of scans to match, expected at least one")
    return [matcher.prepare([pair.reference], np.zeros((1, 3))) for pair in pairs]


def _trials(
    matcher: Matcher,
    pairs: Sequence[ScanPair],
    references: list[Any],
    starts: NDArray[np.float64],
    sigma_m: float,
    sigma_rad: float,
) -> Trials:
    n = len(pairs)
    sigmas = np.array([max(sigma_m, _LEAST_SIGMA_M)] * 2 + [max(sigma_rad, _LEAST_SIGMA_RAD)])
    errors, covariances = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    succeeded, milliseconds = np.zeros(n, dtype=np.bool_), np.empty(n)
    for k, (pair, reference) in enumerate(zip(pairs, references, strict=True)):
        scan = _unseen(pair.current)
        started = time.process_time()
        match = matcher.match(reference, scan, starts[k], np.diag(sigmas**2))
        milliseconds[k] = 1e3 * (time.process_time() - started)
        if isinstance(match, NoMatch):
            continue
        errors[k], covariances[k] = relative_pose_errors(match.T_ref_cur, pair.T_ref_cur), match.covariance
        succeeded[k] = is_success(*errors_against(match.T_ref_cur, pair.T_ref_cur))
    return Trials(errors=errors, covariances=covariances, succeeded=succeeded, milliseconds=milliseconds)


def _unseen(scan: Scan) -> Scan:
    """The same scan as a new object, so that a matcher cannot remember what it extracted from it."""
    return replace(scan)

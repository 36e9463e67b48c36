"""ICE matching: features give hypotheses, the best is polished, its scores give the covariance."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.measurement import NoMatch, RelativePose
from iceg.ice.config import IceConfig
from iceg.ice.covariance import score_covariance
from iceg.ice.features import FeatureRows, feature_rows
from iceg.ice.fitness import Ranking, rank_by_features, rank_by_points
from iceg.ice.hypotheses import SearchWindow, distinct, pair_hypotheses, search_window, widened
from iceg.ice.local_map import LocalMap, box_around
from iceg.ice.points import ScanPoints, extract_points
from iceg.ice.refinement import Refined, polish_on_features, refine_on_points
from iceg.ice.segments import segment_rows, smoothed_on_segments
from iceg.ice.verification import Agreement, agreement

_CLEAR_LEAD = 0.9
_CLEARLY_MORE = 1.03
_FEWEST_POINTS = 15
_ROOM_TO_GROW = 4.0
"""A local map can be extended by scans that reach this far beyond its first points [m]."""
_TRACKING_PRIOR = 3.0
"""Pull of odometry on a pose between two key scans, in points."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """What ICE extracts from one scan.

    Attributes:
        points: its returns, as measured.
        reference_points: the same with walls straightened, to match others against.
        features: its corners, wall ends and intersections.
    """

    points: ScanPoints
    reference_points: ScanPoints
    features: FeatureRows


class IceMatcher:
    """Matches a scan against a local map by Intersections, Corners and Ends of walls (implements `Matcher`)."""

    def __init__(self, config: IceConfig | None = None) -> None:
        """Remember what was extracted from each scan for as long as the scan lives."""
        self.config = config or IceConfig()
        self._scan_points: WeakKeyDictionary[Scan, ScanPoints] = WeakKeyDictionary()
        self._observations: WeakKeyDictionary[Scan, Observation] = WeakKeyDictionary()

    def observe(self, scan: Scan) -> Observation:
        """Points, normals and features of a scan, extracted once."""
        observation = self._observations.get(scan)
        if observation is None:
            points = self._points(scan)
            lines = segment_rows(scan, self.config.segments, points)
            observation = Observation(
                points=points,
                reference_points=smoothed_on_segments(points, lines, scan.geometry.origin_robot, self.config.segments),
                features=feature_rows(scan, self.config.features, lines, points),
            )
            self._observations[scan] = observation
        return observation

    def _points(self, scan: Scan) -> ScanPoints:
        points = self._scan_points.get(scan)
        if points is None:
            points = extract_points(scan, self.config.local_map.normal_reach)
            self._scan_points[scan] = points
        return points

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> LocalMap:
        """Build a local map from scans placed in one frame, (n, 3) poses; it reaches around the last of them."""
        points = [self.observe(scan).points.points for scan in scans]
        lower, upper = box_around(points, T_ref_scans, self.config.local_map.reach, _ROOM_TO_GROW)
        local_map = LocalMap(lower, upper, self.config.local_map, self.config.features)
        for scan, T_ref_scan in zip(scans, T_ref_scans, strict=True):
            self.extend(local_map, scan, T_ref_scan)
        return local_map

    def extend(self, reference: LocalMap, scan: Scan, T_ref_scan: NDArray[np.float64]) -> None:
        """Add one more scan to a local map."""
        observation = self.observe(scan)
        reference.add(observation.reference_points, observation.features, T_ref_scan)

    def track(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        """As `match`, but only the pose: a tenth of the time. A weak direction is left where the guess puts it."""
        scan_points = self._points(scan)
        if len(scan_points) < _FEWEST_POINTS:
            return NoMatch(reason=f"only {len(scan_points)} beams returned")
        if self.config.refinement.enabled:
            refined = refine_on_points(
                scan_points, reference, T_ref_guess, self.config.refinement, wide=False, prior_weight=_TRACKING_PRIOR
            )
            if refined.inliers >= self.config.refinement.credible * len(scan_points):
                return refined.T_ref_cur
        found = self._find(reference, scan, T_ref_guess, covariance_guess)
        return found if isinstance(found, NoMatch) else found.T_ref_cur

    def match(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the local map, see `frontends.matcher.Matcher`."""
        refined = self._find(reference, scan, T_ref_guess, covariance_guess)
        if isinstance(refined, NoMatch):
            return refined
        scan_points = self._points(scan)
        scores = score_covariance(scan_points, reference, refined, self.config.refinement.scale, self.config.covariance)
        return RelativePose(
            T_ref_cur=refined.T_ref_cur,
            covariance=scores.covariance,
            score=refined.inliers / len(scan_points),
            inliers=refined.inliers,
            overlap=refined.used / len(scan_points),
            weak_directions=scores.weak_directions,
        )

    def agreement(self, reference: LocalMap, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        """Compare a scan with a local map at a given pose, both ways."""
        return agreement(scan, self._points(scan), reference, T_ref_cur, self.config.refinement)

    def _find(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> Refined | NoMatch:
        """The best pose around the guess, or why none is credible."""
        n_points = len(self._points(scan))
        if n_points < _FEWEST_POINTS:
            return NoMatch(reason=f"only {n_points} beams returned")
        window = search_window(T_ref_guess, covariance_guess, self.config.hypotheses)
        refined = self.align(reference, scan, window)
        share = refined.inliers / n_points
        if self.config.refinement.enabled and share < self.config.refinement.min_inliers:
            return NoMatch(reason=f"only {share:.0%} of the beams agree with the local map")
        return refined

    def align(self, reference: LocalMap, scan: Scan, window: SearchWindow) -> Refined:
        """Best pose: the polished guess where it is credible, else the best hypothesis in the window, else in a wide one."""
        scan_points = self._points(scan)
        config = self.config.refinement
        best: Refined | None = None
        if config.enabled:
            best = refine_on_points(scan_points, reference, window.T_ref_guess, config, wide=False)
            trusted = window.translation <= self.config.hypotheses.trusted_window
            if trusted and best.inliers >= config.credible * len(scan_points):
                return best
        best = self._best_hypothesis(reference, scan, window, best)
        if config.enabled and best.inliers < config.doubtful * len(scan_points):
            wide = widened(window, self.config.hypotheses)
            best = self._best_hypothesis(reference, scan, wide, best)
        return best

    def _best_hypothesis(self, reference: LocalMap, scan: Scan, window: SearchWindow, best: Refined | None) -> Refined:
        """Polish the leading hypotheses inside the window; a new one must be clearly better than `best`."""
        observation = self.observe(scan)
        hypotheses, ranking = self.rank(reference, observation, window)
        lead = ranking.correlations[ranking.order[0]]
        for rank, index in enumerate(distinct(hypotheses, ranking.order, self.config.hypotheses.candidates)):
            if rank > 0 and ranking.correlations[index] < _CLEAR_LEAD * lead:
                break
            refined = self.refine(reference, observation, hypotheses[index])
            if best is None or refined.inliers > _CLEARLY_MORE * best.inliers:
                best = refined
        assert best is not None
        return best

    def alternatives(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]:
        """Distinct polished poses inside the window, the best ranked first: more than one means an ambiguous place."""
        window = search_window(T_ref_guess, covariance_guess, self.config.hypotheses)
        observation = self.observe(scan)
        hypotheses, ranking = self.rank(reference, observation, window)
        leading = distinct(hypotheses, ranking.order, self.config.hypotheses.alternatives)
        least = self.config.refinement.min_inliers * len(observation.points)
        polished = [self.refine(reference, observation, hypotheses[index]) for index in leading]
        credible = sorted((r for r in polished if r.inliers >= least), key=lambda r: -r.inliers)
        poses = np.array([r.T_ref_cur for r in credible]).reshape(-1, 3)
        return [poses[index] for index in distinct(poses, np.arange(len(poses)), len(poses))]

    def rank(
        self, reference: LocalMap, observation: Observation, window: SearchWindow
    ) -> tuple[NDArray[np.float64], Ranking]:
        """All hypotheses inside the window, (n, 3), with their ranking; the guess is the first of them."""
        config = self.config.hypotheses
        hypotheses = window.T_ref_guess[None, :]
        if self.config.use_features:
            hypotheses = pair_hypotheses(observation.features, reference.feature_rows, window, config)
        if config.fitness == "points":
            return hypotheses, rank_by_points(
                observation.points, reference, hypotheses, config.ranking_points, config.field_sigma
            )
        return hypotheses, rank_by_features(observation.features, reference.feature_rows, hypotheses, config.fitness)

    def refine(self, reference: LocalMap, observation: Observation, T_ref_start: NDArray[np.float64]) -> Refined:
        """Polish one hypothesis on points, or on features when point refinement is switched off."""
        if self.config.refinement.enabled:
            return refine_on_points(observation.points, reference, T_ref_start, self.config.refinement, wide=True)
        return polish_on_features(observation.features, reference.feature_rows, T_ref_start)

"""ICE matching: features give hypotheses, the best is polished, its scores give the covariance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.ice import _last_seen_kernels as last_seen_kernels
from iceg.ice._noise_kernels import RangeNoise
from iceg.ice.config import IceConfig
from iceg.ice.covariance import score_covariance
from iceg.ice.features import FeatureRows, Features, feature_rows, packed
from iceg.ice.fitness import Ranking, rank_by_features, rank_by_points
from iceg.ice.hypotheses import SearchWindow, distinct, pair_hypotheses, search_window, widened
from iceg.ice.local_map import LocalMap, View, box_around
from iceg.ice.noise import PLAIN
from iceg.ice.points import ScanPoints, extract_points
from iceg.ice.refinement import (
    FACING,
    Refined,
    approach,
    evaluate_points,
    polish_on_features,
    position_information,
    refine_on_points,
)
from iceg.ice.search import breed_hypotheses, evolve_hypotheses, grid_hypotheses
from iceg.ice.segments import segment_rows, smoothed_on_segments
from iceg.ice.tracking import Followed, Limits, Polish, Standing, follow_scans
from iceg.ice.verification import Agreement, JoinedScans, agreement, agreements, contradictions, view

_ROOM_TO_GROW = 4.0
"""A local map is made so much wider than its points reach, lest every scan that extends it widens it anew [m]."""
_HYPOTHESIS_PRIOR = 1.0
"""Pull of the features that made a hypothesis, in points: along a corridor nothing else holds it."""
_SEPARATION_M, _SEPARATION_RAD = 0.15, 0.06
"""Hypotheses nearer than this to a better one are not polished."""
_MET_M, _MET_RAD = 0.05, 0.02
"""Hypotheses this near to each other after the wide stage of their polish lead to the same pose."""
_HOLD = 30.0
"""Pull of a guess that a match must not leave far, in points."""
_STILL = SearchWindow(T_ref_guess=np.zeros(3), translation=0.05, rotation=0.03)
"""A guess that its polish moves by no more than this lay on an optimum already."""
_ASKED_POINTS = 200
"""From so many points on, every second, third or n-th tells enough of which scan saw them last."""
REMEMBERED = 3000
"""Scans whose points and features are kept, so that memory does not grow with the run."""
_Extracted = TypeVar("_Extracted")


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

    def __init__(
        self,
        config: IceConfig | None = None,
        *,
        noise: RangeNoise = PLAIN,
        features: Callable[[Scan], Features] | None = None,
    ) -> None:
        """Remember what was extracted from the latest scans for as long as they live.

        Args:
            config: settings; the defaults when left out.
            noise: of the ranges beyond what the settings allow for.
            features: of a scan in the robot frame; None for those that the settings describe.
        """
        self._extract_features = features
        self.config = config or IceConfig()
        self._noise = noise
        self._scan_points: WeakKeyDictionary[Scan, ScanPoints] = WeakKeyDictionary()
        self._observations: WeakKeyDictionary[Scan, Observation] = WeakKeyDictionary()

    @property
    def judge(self) -> "IceMatcher":
        """Itself, see `iceg.slam.map_matcher`: whether a scan belongs where a match puts it."""
        return self

    def judged(self, reference: LocalMap) -> LocalMap:
        """What it judges by is what it matched to."""
        return reference

    def observe(self, scan: Scan) -> Observation:
        """Points, normals and features of a scan, extracted once unless thousands of others came between."""
        observation = self._observations.get(scan)
        if observation is None:
            points = self._points(scan)
            lines = segment_rows(scan, self.config.segments, points)
            observation = Observation(
                points=points,
                reference_points=smoothed_on_segments(points, lines, scan.geometry.origin_robot, self.config.segments),
                features=(
                    feature_rows(scan, self.config.features, lines, points)
                    if self._extract_features is None
                    else packed(self._extract_features(scan))
                ),
            )
            _remember(self._observations, scan, observation)
        return observation

    def forget(self) -> None:
        """Release what was extracted from scans; it is extracted again when it is asked for."""
        self._scan_points.clear()
        self._observations.clear()

    def _points(self, scan: Scan) -> ScanPoints:
        points = self._scan_points.get(scan)
        if points is None:
            points = extract_points(scan, self.config.local_map.normal_reach, self._noise)
            _remember(self._scan_points, scan, points)
        return points

    def prepare(self, scans: list[Scan], T_ref_scans: NDArray[np.float64]) -> LocalMap:
        """Build a local map from scans placed in one frame, (n, 3) poses; it reaches around the last of them."""
        seen = [self.observe(scan) for scan in scans]
        points = [observation.points.points for observation in seen]
        lower, upper = box_around(points, T_ref_scans, self.config.local_map.reach, _ROOM_TO_GROW)
        local_map = LocalMap(lower, upper, self.config.local_map, self.config.features)
        local_map.add_all([one.reference_points for one in seen], [one.features for one in seen], T_ref_scans)
        local_map.views += [View(scan=scan, T_ref_robot=T) for scan, T in zip(scans, T_ref_scans, strict=True)]
        return local_map

    def extend(self, reference: LocalMap, scan: Scan, T_ref_scan: NDArray[np.float64]) -> None:
        """Add one more scan, taken at `T_ref_scan`, (3,), to a local map."""
        observation = self.observe(scan)
        reference.make_room(observation.points, T_ref_scan, _ROOM_TO_GROW)
        reference.add(observation.reference_points, observation.features, T_ref_scan)
        reference.views.append(View(scan=scan, T_ref_robot=T_ref_scan))

    def track(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> NDArray[np.float64] | NoMatch:
        """As `match`, but only the (3,) pose: a tenth of the time. A weak direction stays where the guess puts it."""
        scan_points = self._points(scan)
        config = self.config.refinement
        if config.enabled and len(scan_points) >= self.config.refinement.min_points:
            refined = refine_on_points(
                scan_points, reference, T_ref_guess, config, wide=False, prior_weight=config.tracking_prior
            )
            if refined.inliers >= config.credible * len(scan_points) and self._is_near(
                refined.T_ref_cur, T_ref_guess, covariance_guess
            ):
                return refined.T_ref_cur
        found = self._find(reference, scan, T_ref_guess, covariance_guess)
        return found if isinstance(found, NoMatch) else found.T_ref_cur

    def follow(
        self,
        reference: LocalMap,
        ranges: NDArray[np.float32],
        steps: NDArray[np.float64],
        geometry: ScanGeometry,
        standing: Standing,
        odometry: OdometryModel,
        limits: Limits,
    ) -> Followed:
        """As `track` for scan after scan, see `iceg.ice.tracking.follow_scans`."""
        refinement, hypotheses = self.config.refinement, self.config.hypotheses
        polish = Polish(
            scale=refinement.scale,
            iterations=refinement.iterations,
            prior_weight=refinement.tracking_prior,
            facing=FACING,
            alike=refinement.alike,
            fewest=self.config.refinement.min_points,
            credible=refinement.credible,
            window=hypotheses.min_window,
            turn=hypotheses.min_turn,
        )
        n = len(steps) if refinement.enabled else 0
        followed = follow_scans(
            ranges[:n],
            steps[:n],
            geometry,
            reference,
            standing,
            odometry,
            self.config.local_map.normal_reach,
            self._noise,
            polish,
            limits,
        )
        if followed.key_scan is not None:
            _remember(self._scan_points, *followed.key_scan)
        return followed

    def _is_near(
        self,
        T_ref_cur: NDArray[np.float64],
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> bool:
        """Whether a pose lies in the search window; the smallest window answers for nearly all scans."""
        config = self.config.hypotheses
        (x, y, heading), (x0, y0, heading0) = T_ref_cur.tolist(), T_ref_guess.tolist()
        if (x - x0) ** 2 + (y - y0) ** 2 < config.min_window**2 and abs(heading - heading0) < config.min_turn:
            return True
        return search_window(T_ref_guess, covariance_guess, config).contains(T_ref_cur)

    def match(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> RelativePose | NoMatch:
        """Find the robot pose of `scan` in the frame of the local map, see `frontends.matcher.Matcher`."""
        refined = self._find(reference, scan, T_ref_guess, covariance_guess)
        return refined if isinstance(refined, NoMatch) else self._measured(reference, scan, refined)

    def match_near(self, reference: LocalMap, scan: Scan, T_ref_guess: NDArray[np.float64]) -> RelativePose | NoMatch:
        """The match nearest to a (3,) guess that is right but for centimetres: along what is weak it stays there."""
        scan_points = self._points(scan)
        if len(scan_points) < self.config.refinement.min_points:
            return self._too_few(len(scan_points))
        refined = refine_on_points(
            scan_points, reference, T_ref_guess, self.config.refinement, wide=False, prior_weight=_HOLD
        )
        return self._measured(reference, scan, refined)

    def _too_few(self, n_points: int) -> NoMatch:
        return NoMatch(reason=f"only {n_points} beams returned, a match needs {self.config.refinement.min_points}")

    def _measured(self, reference: LocalMap, scan: Scan, refined: Refined) -> RelativePose:
        """A pose with its covariance and what speaks for it."""
        scan_points = self._points(scan)
        scores = score_covariance(scan_points, reference, refined, self.config.refinement, self.config.covariance)
        return RelativePose(
            T_ref_cur=refined.T_ref_cur,
            covariance=scores.covariance,
            score=refined.inliers / len(scan_points),
            inliers=refined.inliers,
            overlap=refined.used / len(scan_points),
            weak_directions=scores.weak_directions,
            held=scores.held,
        )

    def agreement(self, reference: LocalMap, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        """Compare a scan with a local map at a given (3,) pose, in both directions."""
        return self.agreement_of_all(reference, [scan], T_ref_cur[None])

    def agreement_of_all(
        self, reference: LocalMap, scans: Sequence[Scan], T_ref_scans: NDArray[np.float64]
    ) -> Agreement:
        """Compare scans with a local map at given poses, (n, 3), in both directions, all counts together."""
        points = [self._points(scan) for scan in scans]
        return agreement(scans, points, reference, T_ref_scans, self.config.refinement)

    def position_information(
        self, reference: LocalMap, scan: Scan, T_ref_cur: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(2, 2) how well a scan measures its position at a (3,) pose, in the robot's frame [1/m²], not its heading."""
        refined = evaluate_points(self._points(scan), reference, T_ref_cur, self.config.refinement)
        return position_information(refined, self.config.covariance.min_sigma)

    def last_seen(self, reference: LocalMap, scan: Scan, T_ref_cur: NDArray[np.float64]) -> NDArray[np.float64]:
        """What a scan tells of its pose, by the scan of a local map that was the last to see it.

        Args:
            reference: the local map, of m scans.
            scan: the scan.
            T_ref_cur: (3,) its pose.

        Returns:
            (m, 3, 3) information in the tangent space of the robot, in that of a typical point.
        """
        points, refinement = self._points(scan), self.config.refinement
        told = np.empty((len(reference.views), 3, 3))
        last_seen_kernels.last_seen(
            points.points,
            points.normals,
            points.spreads,
            1 + len(points) // _ASKED_POINTS,
            T_ref_cur,
            reference.sweeps,
            refinement.agreeing * refinement.scale,
            told,
        )
        return told

    def join(self, scans: Sequence[Scan]) -> JoinedScans:
        """One scan or more, prepared for `agreements`."""
        return JoinedScans.of(scans, [self._points(scan) for scan in scans])

    def agreements(
        self,
        reference: LocalMap,
        scans: JoinedScans,
        placements: NDArray[np.float64],
        least_overlap: float = 0.0,
        least_fit: float = 0.0,
    ) -> list[Agreement]:
        """The same of scans placed in several ways, (p, n, 3), for each; the view only of those that fit at all."""
        return agreements(scans, reference, placements, self.config.refinement, least_overlap, least_fit)

    def _find(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> Refined | NoMatch:
        """The best pose around the guess, or why none is credible."""
        n_points = len(self._points(scan))
        if n_points < self.config.refinement.min_points:
            return self._too_few(n_points)
        window = search_window(T_ref_guess, covariance_guess, self.config.hypotheses)
        refined = self.align(reference, scan, window)
        share = refined.inliers / n_points
        if share >= self.config.refinement.min_inliers:
            return refined
        support = self.agreement(reference, scan, refined.T_ref_cur)
        config = self.config.refinement
        if support.overlap >= config.new_overlap and min(support.fit, support.view) >= config.new_agreement:
            return refined
        return NoMatch(reason=f"only {share:.0%} of the beams agree with the local map")

    def align(self, reference: LocalMap, scan: Scan, window: SearchWindow) -> Refined:
        """Best pose of a scan: the polished guess where it is credible, else the best hypothesis.

        Args:
            reference: the local map.
            scan: the new scan.
            window: the feasible area; a wider one is searched when nothing in it explains the scan.

        Returns:
            The pose, credible or not.
        """
        n_points = len(self._points(scan))
        best = self._polished_guess(reference, scan, window) if self.config.refinement.enabled else None
        if best is not None:
            is_still = _STILL.contains(between(window.T_ref_guess, best.T_ref_cur))
            trusted = is_still or window.translation <= self.config.hypotheses.trusted_window
            if trusted and best.inliers >= self.config.refinement.credible * n_points:
                return best
            if is_still and self._explains(reference, scan, best):
                return best
            best = best if trusted else None
        best = self._best_hypothesis(reference, scan, window, best)
        is_weak = best is None or best.inliers < self.config.refinement.wide_below * n_points
        if best is None or (is_weak and not self._explains(reference, scan, best)):
            wide = widened(window, self.config.hypotheses)
            best = self._best_hypothesis(reference, scan, wide, best)
        return best or self._judge(reference, scan, window.T_ref_guess)

    def _explains(self, reference: LocalMap, scan: Scan, refined: Refined) -> bool:
        """Whether beams and map agree in both directions, though the scan sees much that is new."""
        if (
            refined.used < self.config.refinement.new_overlap * len(self._points(scan))
            or refined.inliers < self.config.refinement.credible * refined.used
        ):
            return False
        seen, contradicted = view(scan, reference, refined.T_ref_cur, self.config.refinement)
        return seen >= self.config.refinement.new_agreement * (seen + contradicted)

    def _polished_guess(self, reference: LocalMap, scan: Scan, window: SearchWindow) -> Refined | None:
        """The guess polished on points, None if that leaves the window.

        Where the scan slides along a weak direction until something fits by chance, the guess constrains it.
        """
        points, config = self._points(scan), self.config.refinement
        refined = refine_on_points(points, reference, window.T_ref_guess, config, wide=False)
        if not window.contains(refined.T_ref_cur):
            refined = refine_on_points(
                points, reference, window.T_ref_guess, config, wide=False, prior_weight=config.tracking_prior
            )
        return refined if window.contains(refined.T_ref_cur) else None

    def _best_hypothesis(
        self, reference: LocalMap, scan: Scan, window: SearchWindow, best: Refined | None
    ) -> Refined | None:
        """Polish the leading hypotheses inside the window; a new one must be clearly better than `best`."""
        observation = self.observe(scan)
        config = self.config.hypotheses
        hypotheses, ranking = self.rank(reference, observation, window)
        leading = ranking.at_least(config.lead * float(ranking.correlations[ranking.best]))
        chosen = distinct(hypotheses, leading, config.candidates, _SEPARATION_M, _SEPARATION_RAD)
        polished = self._polish(reference, scan, hypotheses[chosen])
        inside = [refined for refined in polished if window.contains(refined.T_ref_cur)]
        if not inside:
            return best
        found = self._choose(reference, scan, inside)
        return found if best is None or found.support > self.config.refinement.lead * best.support else best

    def _polish(
        self, reference: LocalMap, scan: Scan, T_ref_starts: NDArray[np.float64], least: float = 0.0
    ) -> list[Refined]:
        """Polish hypotheses; those that meet on the way are polished once.

        Args:
            reference: the local map.
            scan: the new scan.
            T_ref_starts: (n, 3) the hypotheses.
            least: those are given up of whose points a smaller share lies near the reference after the wide stage.

        Returns:
            The others, polished.
        """
        config = self.config.refinement
        if not config.enabled:
            return [self.refine(reference, scan, T_ref_start) for T_ref_start in T_ref_starts]
        points = self._points(scan)
        ways = [approach(points, reference, start, config, _HYPOTHESIS_PRIOR) for start in T_ref_starts]
        near = np.array([pose for pose, share in ways if share >= least]).reshape(-1, 3)
        return [
            refine_on_points(points, reference, near[k], config, wide=False, prior_weight=_HYPOTHESIS_PRIOR)
            for k in distinct(near, np.arange(len(near)), len(near), _MET_M, _MET_RAD)
        ]

    def _choose(self, reference: LocalMap, scan: Scan, polished: list[Refined]) -> Refined:
        """The pose that explains most: points on the reference, less the beams that contradict it."""
        if len(polished) == 1:
            return polished[0]
        points, cell = self._points(scan), self.config.local_map.cell
        best, most = polished[0], -np.inf
        for refined in sorted(polished, key=lambda refined: -refined.support):
            if refined.support <= most:
                break
            denied = contradictions(scan, points, reference, refined.T_ref_cur, cell, self.config.refinement)
            score = refined.support - self.config.refinement.contradiction * denied
            if score > most:
                best, most = refined, score
        return best

    def alternatives(
        self,
        reference: LocalMap,
        scan: Scan,
        T_ref_guess: NDArray[np.float64],
        covariance_guess: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]:
        """Distinct polished (3,) poses in the window, the best first: where several fit, the place is ambiguous."""
        if len(self._points(scan)) < self.config.refinement.min_points:
            return []
        window = search_window(T_ref_guess, covariance_guess, self.config.hypotheses)
        hypotheses, ranking = self.rank(reference, self.observe(scan), window)
        min_inliers = self.config.refinement.min_inliers
        least_hopeful = (
            self.config.refinement.hopeful * min_inliers if self.config.hypotheses.fitness == "points" else 0.0
        )
        hopeful = ranking.at_least(least_hopeful)
        leading = distinct(hypotheses, hopeful, self.config.hypotheses.alternatives)
        polished = self._polish(reference, scan, hypotheses[leading], min_inliers)
        least = min_inliers * len(self._points(scan))
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
            if config.search == "exhaustive":
                hypotheses = grid_hypotheses(window, config)
            elif config.search == "genetic":
                hypotheses = breed_hypotheses(window, partial(self._fitness, reference, observation), config)
            elif config.search == "evolutionary":
                hypotheses = evolve_hypotheses(window, partial(self._fitness, reference, observation), config)
            else:
                hypotheses = pair_hypotheses(observation.features, reference.feature_rows, window, config)
        return hypotheses, self._ranking(reference, observation, hypotheses, sift=True)

    def _ranking(
        self, reference: LocalMap, observation: Observation, hypotheses: NDArray[np.float64], *, sift: bool
    ) -> Ranking:
        config = self.config.hypotheses
        if config.fitness == "points":
            return rank_by_points(observation.points, reference, hypotheses, config, sift=sift)
        return rank_by_features(observation.features, reference.feature_rows, hypotheses, config.fitness)

    def _fitness(
        self, reference: LocalMap, observation: Observation, hypotheses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """One number per hypothesis that orders them as the ranking does."""
        ranking = self._ranking(reference, observation, hypotheses, sift=False)
        counts = ranking.counts if self.config.hypotheses.fitness == "paper" else 0
        return np.asarray(counts + ranking.correlations, dtype=np.float64)

    def refine(self, reference: LocalMap, scan: Scan, T_ref_start: NDArray[np.float64]) -> Refined:
        """Polish one hypothesis, (3,), on points, or on features when point refinement is switched off."""
        if self.config.refinement.enabled:
            return refine_on_points(
                self._points(scan),
                reference,
                T_ref_start,
                self.config.refinement,
                wide=True,
                prior_weight=_HYPOTHESIS_PRIOR,
            )
        pose, _ = polish_on_features(self.observe(scan).features, reference.feature_rows, T_ref_start)
        return self._judge(reference, scan, pose)

    def _judge(self, reference: LocalMap, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Refined:
        return evaluate_points(self._points(scan), reference, T_ref_cur, self.config.refinement)


def _remember(kept: WeakKeyDictionary[Scan, _Extracted], scan: Scan, extracted: _Extracted) -> None:
    if len(kept) >= REMEMBERED:
        del kept[next(iter(kept))]
    kept[scan] = extracted

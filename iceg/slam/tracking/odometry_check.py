"""Whether a match is believed that odometry does not expect: another, near odometry, may explain as much."""

import math
from dataclasses import dataclass

from frontends.scan import Scan
from graph.arrays import Floats
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate, squared_norm
from graph.odometry import OdometryMotion
from graph.se2 import between, compose, logmap
from iceg.slam.agreement import agree, apart
from iceg.slam.config import FrontEndConfig
from iceg.slam.map_matcher import MapMatcher, Prepared
from iceg.slam.track import FEW_SEE, SEES_TOO_LITTLE
from iceg.slam.tracking.reach import Reach
from iceg.slam.tracking.sight import sees_little

_IMPLAUSIBLE = NoMatch(reason="far from where odometry puts it, and contradicted by what is seen there")


@dataclass(frozen=True, slots=True, kw_only=True)
class Expectation:
    """Where odometry since the newest key scan puts the robot.

    Attributes:
        T_track_key: (3,) the newest key pose.
        motion: since then.
        is_known: whether odometry told all of the way.
        reach: where the robot may have got to since the newest match.
    """

    T_track_key: Floats
    motion: OdometryMotion
    is_known: bool
    reach: Reach

    @property
    def T_track_robot(self) -> Floats:
        """(3,) the pose expected."""
        return compose(self.T_track_key, self.motion.T_key_robot)

    def distance2(self, found: Floats, covariance: Floats) -> float:
        """Squared Mahalanobis distance of a pose, (3,), known with a (3, 3) covariance, from the one expected."""
        return squared_norm(logmap(between(found, self.T_track_robot)), self.motion.covariance + covariance)


class OdometryCheck:
    """Judges matched poses by what odometry expects, and by what else explains the scan."""

    def __init__(self, matcher: MapMatcher, config: FrontEndConfig) -> None:
        """Take what says what a pose explains, and what contradicts odometry and is believed all the same."""
        self._matcher = matcher
        self._config = config.odometry_check
        self._sight = config.sight
        self._one_optimum = config.one_optimum
        self._gate = chi2_gate(self._config.false_alarm)
        self._log_jump_odds = math.log(self._config.jump_odds)
        self._log_refused_odds = math.log(self._config.refused_odds)
        self._jump_sigmas = math.sqrt(chi2_gate(self._config.jump_false_alarm, freedom=1))

    def judge(
        self,
        reference: Prepared,
        scan: Scan,
        guess: Floats,
        found: Floats,
        covariance: Floats,
        expected: Expectation,
        *,
        is_degenerate: bool = False,
    ) -> RelativePose | NoMatch | None:
        """What to believe instead of a match.

        Args:
            reference: what the scan was matched to.
            scan: it.
            guess: (3,) where the search began.
            found: (3,) where it ended …
            covariance: (3, 3) … and how well that is known.
            expected: by odometry.
            is_degenerate: whether the match leaves more than one direction open.

        Returns:
            Another match, why there is none, or None where the match is believed.
        """
        instead = self._nearer(reference, scan, found, covariance, expected) or self._sees_too_little(
            scan, found, covariance, expected, is_degenerate=is_degenerate
        )
        if instead is None and not self._is_plausible(reference, scan, guess, found, expected):
            return _IMPLAUSIBLE
        return instead

    def _sees_too_little(
        self, scan: Scan, found: Floats, covariance: Floats, expected: Expectation, *, is_degenerate: bool
    ) -> NoMatch | None:
        """Why not to believe a match that contradicts odometry on the word of a few beams, or of one direction alone.

        Where hardly anything else is in reach, people close by pass for walls, and take the robot with them.
        """
        few_see = sees_little(scan, self._sight)
        is_weak = expected.is_known and (few_see or is_degenerate)
        if is_weak and expected.distance2(found, covariance) >= self._gate:
            return FEW_SEE if few_see else SEES_TOO_LITTLE
        return None

    def _nearer(
        self, reference: Prepared, scan: Scan, found: Floats, covariance: Floats, expected: Expectation
    ) -> RelativePose | None:
        """A match nearer to odometry than one that contradicts it, if it explains the scan nearly as well.

        What moves, and what is similar a little farther on, draws a match along where walls do not hold it.
        """
        pose = expected.T_track_robot
        if agree(found, pose, self._one_optimum):
            return None
        distance2 = expected.distance2(found, covariance)
        if distance2 < self._gate:
            return None
        nearer = self._matcher.match_near(reference, scan, pose)
        if isinstance(nearer, NoMatch) or agree(found, nearer.T_ref_cur, self._one_optimum):
            return None
        share = max(self._config.min_evidence, 1.0 - distance2 * self._config.evidence_slope)
        free, near = (self._matcher.agreement(reference, scan, T).evidence for T in (found, nearer.T_ref_cur))
        return nearer if near >= share * free else None

    def _is_plausible(
        self, reference: Prepared, scan: Scan, guess: Floats, found: Floats, expected: Expectation
    ) -> bool:
        """A pose far from the guess (odometry jumped, or the robot was carried) must explain what the guess does not.

        What matches elsewhere may be similar: a wall, a corner, trunks. Where odometry has the robot, the scan must
        contradict the map; it does not where it sees new ground. And the robot must have got there: wheels that slip
        hide no more of its way than it goes in that time.
        """
        config, sigmas = self._config, self._jump_sigmas
        if agree(guess, found, config.jump):
            return True
        distance, turn = apart(guess, found)
        (xx, _, _), (_, yy, _), (_, _, hh) = expected.motion.covariance.tolist()
        is_near = distance < max(config.jump_distance, sigmas * math.sqrt(max(xx, yy)))
        if is_near and turn < max(config.jump_turn, sigmas * math.sqrt(hh)):
            return True
        if not expected.is_known:
            return self.explains_better(reference, scan, found, guess)
        there, here = (expected.reach.log_probability(pose, config.carried) for pose in (found, guess))
        return self.explains_more(reference, scan, found, guess, there - here)

    def explains_better(self, reference: Prepared, scan: Scan, one: Floats, other: Floats) -> bool:
        """Whether a (3,) pose explains what is seen better than another, nothing else known."""
        return self._log_odds(reference, scan, one) > self._log_odds(reference, scan, other)

    def explains_more(
        self, reference: Prepared, scan: Scan, found: Floats, expected: Floats, log_prior: float = 0.0
    ) -> bool:
        """Whether a (3,) pose explains what is seen so much better than where odometry has the robot that it jumped.

        Args:
            reference: what the scan was matched to.
            scan: it.
            found: (3,) where it may be …
            expected: (3,) … and where odometry has it.
            log_prior: how much more probable the first is than the second before anything is seen, the logarithm,
                besides that odometry is seldom so wrong.
        """
        there, here = (self._log_odds(reference, scan, pose) for pose in (found, expected))
        return there > -self._log_refused_odds and log_prior + there - here > self._log_jump_odds

    def _log_odds(self, reference: Prepared, scan: Scan, pose: Floats) -> float:
        """How much more probable it is that a scan was taken at a pose than that it was not, the logarithm.

        Three kinds of counts tell: how much of the scan lies on known ground, how much of that agrees, unless people
        stand around, and how much of what is in view the scan sees, not looks through.
        """
        counted, config = self._matcher.agreement(reference, scan, pose), self._config
        ground = config.ground.log_odds(counted.known, counted.points - counted.known)
        ends = config.contradiction.log_odds(counted.inliers, counted.known - counted.inliers, config.crowded)
        return ground + ends + config.contradiction.log_odds(counted.seen, counted.contradicted)

"""The front end: every scan matched against the local reference of recent key scans."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from frontends.scan import Scan, ScanGeometry
from graph import dense
from graph.arrays import Float32s, Floats, Ints
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate, squared_norm, summed_ratios
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose, expmap, logmap
from iceg.ice.false_matches import allowing_for_chance
from iceg.ice.tracking import Limits, Standing
from iceg.slam.agreement import apart
from iceg.slam.config import FrontEndConfig
from iceg.slam.map_matcher import MapMatcher, Prepared
from iceg.slam.odometry.heading_odometry import HeadingOdometry
from iceg.slam.track import FEW_SEE, SEES_TOO_LITTLE, KeyScan, Track
from iceg.slam.tracking.odometry_check import Expectation, OdometryCheck
from iceg.slam.tracking.reach import Reach, UsualReach
from iceg.slam.tracking.sight import sees_next_to_nothing, sees_nothing
from iceg.slam.tracking.submap_drift import SubmapDrift
from iceg.slam.tracking.velocity_filter import VelocityFilter

COVERED = NoMatch(reason="the laser is covered")
"""What becomes of a scan that sees nothing."""


@dataclass(slots=True, kw_only=True)
class _LocalMap:
    """What scans are matched against.

    Attributes:
        members: indices of the key scans in it, the newest last: that one stands for the map.
        reference: the matcher's own, in the track frame.
    """

    members: list[int]
    reference: Prepared


class FrontEnd:
    """Tracks a robot scan by scan and decides which scans become key scans."""

    def __init__(
        self,
        matcher: MapMatcher,
        odometry: OdometryModel | None,
        config: FrontEndConfig,
        heading: HeadingOdometry | None = None,
    ) -> None:
        """Start with no scan yet; `odometry` is None for a log without, whose turns `heading` may tell."""
        self._matcher = matcher
        self._has_odometry = odometry is not None
        unknown = config.tracking.unknown_odometry
        self._unknown = unknown if heading is None else heading.noise.within(unknown)
        self._odometry = odometry or self._unknown
        self._config = config
        self._limits = _limits(config)
        self._check = OdometryCheck(matcher, config)
        self.keys: list[KeyScan] = []
        self._local = self._matched = _LocalMap(members=[], reference=None)
        self._tentative: _LocalMap | None = None
        self.is_blind = False
        self.motion = self._odometry.start()
        self._knows_motion = self._has_odometry
        self._unknown_scans = 0
        self._drift = SubmapDrift()
        self._T_track_robot = np.zeros(3)
        self._newest_step, self._newest_intervals = (np.zeros(3), np.zeros(3)), 1
        self._reach = Reach(T_track_before=np.zeros(3), most=np.zeros(2))
        self._is_matched = True
        self._usual_reach = UsualReach(config.odometry_check)
        self._velocity: VelocityFilter | None = None
        self.failures = 0
        self.lost: list[int] = []
        self.breaks: list[int] = []
        self.unknown_motion: list[int] = []

    def track(self, key_of_scan: Ints, T_track_scans: Floats, dead: Sequence[tuple[int, int]] = ()) -> Track:
        """What was found so far.

        Args:
            key_of_scan: (n,) the newest of `keys` when each scan had been tracked …
            T_track_scans: (n, 3) … and its pose.
            dead: first and last scans of the intervals over which the odometry is dead.
        """
        T_track_keys = np.array([key.T_track_robot for key in self.keys])
        return Track(
            keys=list(self.keys),
            key_of_scan=key_of_scan,
            T_key_scan=between(T_track_keys[key_of_scan], T_track_scans),
            failures=self.failures,
            lost=list(self.lost),
            breaks=list(self.breaks),
            unknown_motion=list(self.unknown_motion),
            dead=list(dead),
        )

    def trust(self, odometry: OdometryModel) -> None:
        """Believe the odometry so much from the next step on."""
        if self._has_odometry:
            self._odometry = odometry

    def expect(self, reach: Floats) -> None:
        """From the next scan on odometry says how far it gets from scan to scan: (2,) distance [m] and turn [rad]."""
        self._usual_reach.expect(reach)

    def add(
        self,
        index: int,
        scan: Scan,
        T_prev_cur: Floats | None,
        *,
        is_sudden: bool = False,
        is_late: bool = False,
        wait: float = 1.0,
        foretold: Floats | None = None,
    ) -> Floats:
        """Track one more scan.

        Args:
            index: which scan of the log it is.
            scan: the scan.
            T_prev_cur: (3,) odometry since the scan before; None where there is none.
            is_sudden: the step is much longer than others: perhaps the odometry jumped, and the robot did not.
            is_late: it is so after a pause, which the scan before may have shown already.
            wait: time since the scan before, in usual intervals.
            foretold: (3,) the step, where there is no odometry and an earlier pass tells of it; None where none does,
                and the velocity is taken as constant.

        Returns:
            (3,) its pose in the front end's own frame. The scan is tied to the newest of `keys`, which may be itself.
        """
        self.is_blind = sees_nothing(scan, self._config.sight)
        if not self.keys:
            self._start(index, scan)
            return self._T_track_robot
        self._leave(self._T_track_robot, wait)
        step, before, noise, intervals = T_prev_cur, self._T_track_robot, self._odometry, 1
        if step is not None and is_sudden and self._goes_on(scan, step):
            self.breaks.append(index)
            step = None
        if step is not None and is_late and self._stands(scan, step):
            self.breaks.append(index)
            step, foretold = None, np.zeros(3)
        is_told = step is not None or foretold is not None
        if step is None:
            self._forget_motion()
            step, noise = foretold, self._unknown
            if step is None:
                step, intervals = self._constant_velocity(scan, round(wait))
        if is_told:
            self._velocity = None
        self.motion = noise.extend(self.motion, step)
        self._follow(scan, compose(before, step))
        self._newest_intervals = intervals
        if self._is_key():
            self._add_key(index, scan)
        return self._T_track_robot

    def follow(self, index: int, ranges: Float32s, steps: Floats, geometry: ScanGeometry) -> Floats:
        """Track scans as `add` does, up to the next key scan, and at a fraction of the cost.

        Args:
            index: which scan of the log the first one is.
            ranges: (n, n_beams) [m] of the scans, NaN without return.
            steps: (n, 3) odometry from the scan before to each.
            geometry: the laser.

        Returns:
            (m, 3) the poses of those tracked; the next one, the first perhaps, may be no plain step and is for `add`.
        """
        if not self.keys or not len(steps):
            return np.empty((0, 3))
        standing = Standing(T_ref_robot=self._T_track_robot, T_ref_key=self.keys[-1].T_track_robot, motion=self.motion)
        reference = self._local.reference
        found = self._matcher.follow(reference, ranges, steps, geometry, standing, self._odometry, self._limits)
        poses = found.T_ref_robots
        if not len(poses):
            return poses
        before = poses[-2] if len(poses) > 1 else self._T_track_robot
        self._is_matched = self._is_matched or len(poses) > 1  # the one before the last is the newest match then
        self._leave(before)
        self._is_matched = True
        self._usual_reach.add(np.concatenate([self._T_track_robot[None], poses]))
        self.is_blind, self._matched, self.motion, self._velocity = False, self._local, found.motion, None
        self._T_track_robot, self._newest_step = poses[-1].copy(), (before, poses[-1].copy())
        self._newest_intervals = 1
        if found.key_scan is not None:
            scan, _ = found.key_scan
            self._add_key(index + len(poses) - 1, scan)
            poses[-1] = self._T_track_robot
        return poses

    def _leave(self, T_track_before: Floats, wait: float = 1.0) -> None:
        """Go on from the pose of the scan before, (3,): what the robot's way is measured from, if a match told it."""
        since = Reach(T_track_before=T_track_before, most=np.zeros(2)) if self._is_matched else self._reach
        self._reach = since.after(wait * self._usual_reach.most)

    def _goes_on(self, scan: Scan, step: Floats) -> bool:
        """Whether a scan does not say that the robot made the step odometry claims, rather than going on as before.

        It says so by where it matches best, from either guess; if it matches nowhere it says nothing. A turn that
        explains the scan is believed though going on explains more: where corridors cross, all of them are similar.
        """
        usual = self._usual_step()
        guesses = [compose(self._T_track_robot, T) for T in (usual, step)]
        found = [self._found_after(scan, T, guess) for T, guess in zip((usual, step), guesses, strict=True)]
        if self._is_turn(step, usual) and not isinstance(found[1], NoMatch) and self._explains(scan, found[1]):
            return _is_nearer(found[1], *guesses)
        best = max(found, key=lambda pose: self._evidence(scan, pose))
        return isinstance(best, NoMatch) or _is_nearer(best, *guesses)

    def _stands(self, scan: Scan, step: Floats) -> bool:
        """Whether a scan matches where the robot was, and nothing where the step that odometry claims leads."""
        guess, none = compose(self._T_track_robot, step), np.zeros(3)
        if not isinstance(self._found_after(scan, step, guess), NoMatch):
            return False
        found = self._found_after(scan, none, self._T_track_robot)
        return not isinstance(found, NoMatch) and self._check.explains_more(self._local.reference, scan, found, guess)

    def _is_turn(self, step: Floats, usual: Floats) -> bool:
        """Whether a step that stands out does so by its turn: a robot may turn on the spot between two scans."""
        longest = self._config.tracking.turning_step * math.hypot(*usual[:2])
        return math.hypot(*step[:2]) <= max(self._config.odometry_check.jump_distance, longest)

    def _usual_step(self) -> Floats:
        """(3,) the newest step, or a usual interval's share of it."""
        newest, intervals = between(*self._newest_step), self._newest_intervals
        return newest if intervals == 1 else expmap(logmap(newest) / intervals)

    def _constant_velocity(self, scan: Scan, intervals: int) -> tuple[Floats, int]:
        """The step to a scan of a robot that goes on as the matches say; who was just found far off stands.

        Where scans are missing before it the robot went on meanwhile, or the recorder stamped it late: the scan tells.

        Args:
            scan: it.
            intervals: usual ones since the scan before.

        Returns:
            (3,) the step, and how many intervals it took.
        """
        newest = self._usual_step()
        turn = float(newest[2])
        is_step = math.hypot(newest[0], newest[1]) <= self._config.tracking.max_step
        if self._velocity is None or not is_step:
            self._velocity = VelocityFilter(newest[:2] if is_step else np.zeros(2), self._config.tracking.velocity)
        patient = self._velocity.copy() if intervals > 1 else None
        step = self._velocity.step(turn)
        if patient is not None:
            way = patient.way(turn, intervals)
            if self._went(scan, way, step):
                self._velocity = patient
                return way, intervals
        return step, 1

    def _went(self, scan: Scan, way: Floats, step: Floats) -> bool:
        """Whether a scan matches better after one (3,) way than after another, shorter one."""
        far, near = (self._found_after(scan, T, compose(self._T_track_robot, T)) for T in (way, step))
        if isinstance(far, NoMatch):
            return False
        near = compose(self._T_track_robot, step) if isinstance(near, NoMatch) else near
        return self._check.explains_better(self._local.reference, scan, far, near)

    def _found_after(self, scan: Scan, step: Floats, guess: Floats) -> Floats | NoMatch:
        """Pose of a scan if the robot made a step that leads to `guess`."""
        return self._find(self._local, scan, guess, self._expected(self._odometry.extend(self.motion, step)))

    def _expected(self, motion: OdometryMotion | None = None) -> Expectation:
        """Where odometry puts the robot, or would if it had moved so since the newest key scan."""
        return Expectation(
            T_track_key=self.keys[-1].T_track_robot,
            motion=motion or self.motion,
            is_known=self._knows_motion,
            reach=self._reach,
        )

    def _explains(self, scan: Scan, found: Floats) -> bool:
        """Whether scan and reference agree in both directions at a pose, though much may be new."""
        support = self._matcher.agreement(self._local.reference, scan, found)
        config = self._config.tracking
        return support.overlap >= config.known_overlap and min(support.fit, support.view) >= config.known_agreement

    def _evidence(self, scan: Scan, found: Floats | NoMatch) -> float:
        """How much of a scan the reference explains at a pose."""
        if isinstance(found, NoMatch):
            return -1.0
        return self._matcher.agreement(self._local.reference, scan, found).evidence

    def _forget_motion(self) -> None:
        """From here on the odometry since the last key scan says nothing about where the robot is."""
        if not self._knows_motion:
            return
        self._knows_motion = False
        T_key_robot = between(self.keys[-1].T_track_robot, self._T_track_robot)
        unknown = self._config.tracking.unknown_odometry.start().covariance + self.motion.covariance
        self.motion = replace(self.motion, T_key_robot=T_key_robot, covariance=unknown)

    def _start(self, index: int, scan: Scan) -> None:
        first = NoMatch(reason="first scan")
        self.keys.append(
            KeyScan(index=index, scan=scan, motion=self.motion, match=first, anchor=0, T_track_robot=np.zeros(3))
        )
        self._local = self._map_of([0])

    def _follow(self, scan: Scan, guess: Floats) -> None:
        """Pose of a scan in the track frame; odometry carries it where nothing credible is found."""
        self._matched = self._local
        found = self._find(self._local, scan, guess, self._expected())
        if self._tentative is not None and isinstance(found, NoMatch):
            self._matched = self._tentative
            found = self._find(self._tentative, scan, guess, self._expected())
        before, self._is_matched = self._T_track_robot, not isinstance(found, NoMatch)
        if isinstance(found, NoMatch):
            self.failures += 1
            self._unknown_scans += not self._knows_motion
            straight_on = np.array([before[0], before[1], guess[2]])  # a robot drives on, it does not spin on
            self._T_track_robot, self._newest_step = guess, (straight_on, guess)
        else:
            self._T_track_robot, self._newest_step = found, (before, found)
            self._usual_reach.add(np.array([before, found]))
            if self._velocity is not None:
                information = self._matcher.position_information(self._matched.reference, scan, found)
                self._velocity.correct(between(guess, found)[:2], information)

    def _find(self, local_map: _LocalMap, scan: Scan, guess: Floats, expected: Expectation) -> Floats | NoMatch:
        """Pose of a scan on a local map, in the track frame."""
        if self.is_blind:
            return COVERED
        reference, covariance = local_map.reference, self._config.tracked.covariance
        found = self._matcher.track(reference, scan, guess, expected.motion.covariance)
        if isinstance(found, NoMatch):
            return found
        instead = self._check.judge(reference, scan, guess, found, covariance, expected)
        if instead is None:
            return found
        return instead if isinstance(instead, NoMatch) else instead.T_ref_cur

    def _match(self, scan: Scan) -> RelativePose | NoMatch:
        """Match with covariance from the tracked pose, expressed in the track frame."""
        if self.is_blind:
            return COVERED
        reference = self._matched.reference
        match = self._matcher.match(reference, scan, self._T_track_robot, self.motion.covariance)
        if isinstance(match, NoMatch):
            return match
        expected = self._expected()
        if not expected.is_known:
            match = self._allowing_for_chance(match, expected)
        instead = self._check.judge(
            reference,
            scan,
            self._T_track_robot,
            match.T_ref_cur,
            match.covariance,
            expected,
            is_degenerate=len(match.weak_directions) > 1,
        )
        believed = match if instead is None else instead
        if isinstance(believed, NoMatch) or not expected.is_known:
            return believed
        # What odometry says of a match comes after the verdict, which asks odometry, too.
        return self._allowing_for_chance(believed, expected)

    def _allowing_for_chance(self, match: RelativePose, expected: Expectation) -> RelativePose:
        """A match that something else may hold is less sure."""
        odometry, config = expected.motion.covariance, self._matcher.judge.config.false_match
        return allowing_for_chance(match, expected.T_track_robot, odometry, config, is_measured=expected.is_known)

    def _odometry_share(self, match: RelativePose) -> Floats | None:
        """How much of what odometry says otherwise is believed: where it knows more than the match, and only there.

        Elsewhere it would pull every match a little towards its own bias, and the local map with it. Odometry that the
        match refutes, as where it jumped or lagged behind, says nothing. Where there is none the velocity takes its
        place: else a match slides along what it does not observe.

        Args:
            match: in the track frame.

        Returns:
            (3, 3) what to multiply the difference by, tangent space at the match; None for nothing.
        """
        odometry, config = self.motion.covariance, self._config.tracking
        # The sum of the ratios bounds the largest: most matches need no more.
        if summed_ratios(match.covariance, odometry) <= config.odometry_ratio:
            return None
        whiten = dense.inv(dense.cholesky(odometry))
        ratios, axes = dense.eigh(dense.congruence(whiten, match.covariance))
        share = np.where(ratios > config.odometry_ratio, ratios / (1.0 + ratios), 0.0)
        if not share.any():
            return None
        if squared_norm(self._offset(match), odometry + match.covariance) >= config.refuted_distance2:
            return None
        directions = dense.matmul(whiten.T, axes)
        return dense.matmul(odometry, directions * share, directions.T)

    def _offset(self, match: RelativePose) -> Floats:
        """(3,) where odometry since the newest key scan has the robot, seen from where a match has it."""
        return logmap(between(match.T_ref_cur, compose(self.keys[-1].T_track_robot, self.motion.T_key_robot)))

    def _is_key(self) -> bool:
        """Whether the robot has gone far enough, or may have: nothing has seen its motion for several scans."""
        if self._unknown_scans >= self._config.tracking.unknown_scans and not self.is_blind:
            return True
        distance, turn = apart(self.keys[-1].T_track_robot, self._T_track_robot)
        limits = self._config.key_scans
        spacing = limits.blind_spacing if self.is_blind and self._knows_motion else 1.0
        return distance > spacing * limits.distance or turn > spacing * limits.angle

    def _add_key(self, index: int, scan: Scan) -> None:
        match = self._match(scan)
        anchor = self._matched.members[-1]
        if match is SEES_TOO_LITTLE or match is FEW_SEE:
            self._T_track_robot = compose(self.keys[-1].T_track_robot, self.motion.T_key_robot)
        if isinstance(match, NoMatch):
            self._drift.add_unmatched(self.motion.covariance)
        else:
            share = self._odometry_share(match)
            self._drift.add(self.motion.covariance, share)
            self._T_track_robot = match.T_ref_cur
            if share is not None:
                self._T_track_robot = compose(match.T_ref_cur, expmap(dense.matvec(share, self._offset(match))))
            match = self._tied(match, scan)
        self.keys.append(
            KeyScan(
                index=index,
                scan=scan,
                motion=self.motion,
                match=match,
                anchor=anchor,
                T_track_robot=self._T_track_robot,
            )
        )
        if self._unknown_scans >= self._config.tracking.unknown_scans:
            self.unknown_motion.append(index)
        self.motion, self._knows_motion, self._unknown_scans = self._odometry.start(), self._has_odometry, 0
        # A scan of few returns lies where odometry has it, and not on new ground.
        self._extend_reference(isinstance(match, NoMatch) and match is not FEW_SEE)

    def _tied(self, match: RelativePose, scan: Scan) -> RelativePose:
        """A match in the frame of the newest key scan of its map, no surer than how that lies to what holds it."""
        members = self._matched.members
        T_anchor_match = between(self.keys[members[-1]].T_track_robot, match.T_ref_cur)
        if not self._drift.may_matter(match, members):
            return replace(match, T_ref_cur=T_anchor_match)
        told = self._matcher.last_seen(self._matched.reference, scan, match.T_ref_cur)
        drift = self._drift.of(told, members[-len(told) :], self.keys, match.T_ref_cur)
        return replace(match, T_ref_cur=T_anchor_match, covariance=match.covariance + drift)

    def _extend_reference(self, is_unmatched: bool) -> None:
        """Let the newest key scan join the reference it matched; an unmatched one begins a tentative map.

        The tentative map takes over once nothing but it has matched for a while: the robot came upon new ground, or was
        carried away. A scan that sees next to nothing does not tell.
        """
        newest, is_new = len(self.keys) - 1, is_unmatched or self._matched is self._tentative
        if self.is_blind or (is_new and sees_next_to_nothing(self.keys[-1].scan, self._config.sight)):
            return
        if is_new:
            self._tentative = self._map_of([*(self._tentative.members if self._tentative else ()), newest])
            if len(self._tentative.members) >= self._config.tracking.loss_keys:
                self.lost.append(self.keys[self._tentative.members[0]].index)
                self._local, self._tentative = self._tentative, None
            return
        self._tentative = None
        self._local.members.append(newest)
        if newest % self._config.key_scans.rebuild == 0:
            self._local = self._map_of(self._local.members[-self._config.key_scans.window :])
        else:
            self._matcher.extend(self._local.reference, self.keys[-1].scan, self.keys[-1].T_track_robot)

    def _map_of(self, members: list[int]) -> _LocalMap:
        keys = [self.keys[member] for member in members]
        T_track_keys = np.array([key.T_track_robot for key in keys])
        return _LocalMap(members=members, reference=self._matcher.prepare([key.scan for key in keys], T_track_keys))


def _limits(config: FrontEndConfig) -> Limits:
    key_scans, one_optimum = config.key_scans, config.one_optimum
    return Limits(
        blind_range=config.sight.blind_range,
        blind_share=config.sight.blind_share,
        moved=config.odometry_check.jump_distance,
        turned=config.odometry_check.jump_turn,
        apart=one_optimum.distance,
        twisted=one_optimum.turn,
        contradicted=chi2_gate(config.odometry_check.false_alarm),
        variances=tuple((config.tracked.deviations**2).tolist()),
        key_distance=key_scans.distance,
        key_turn=key_scans.angle,
    )


def _is_nearer(pose: Floats, one: Floats, other: Floats) -> bool:
    """Whether a pose is no farther from one than from another."""
    return sum(apart(pose, one)) <= sum(apart(pose, other))

"""The front end: every scan matched against the local reference of recent key scans."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from frontends.matcher import Matcher
from frontends.scan import Log, Scan
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose
from iceg.ice.verification import Agreement
from iceg.slam.config import FrontEndConfig
from iceg.slam.track import KeyScan, Track

_ODOMETRY_SPEAKS = 4.0
"""Ratio of variances (match over odometry) from which on a direction is shared with odometry."""


_BLIND_RANGE = 0.5
"""A scan most of whose beams end within this sees nothing: the laser is covered [m]."""
_BLIND_SHARE = 0.8
_FEWEST_RETURNS = 0.1
"""A scan with a smaller share of returns sees nothing either."""
_JUMP_DISTANCE, _JUMP_TURN, _JUMP_SIGMAS = 0.3, 0.26, 4.0
"""A match farther from odometry than this [m, rad] and than so many standard deviations is a jump …"""
_JUMP_FIT, _JUMP_VIEW = 0.75, 0.75
"""… and needs this share of beams on the reference, and of the reference in view seen."""
_LOST_AFTER = 3
"""So many key scans that match only each other take over as the local reference."""
_UNKNOWN_ODOMETRY = OdometryModel(
    along_per_metre=0.3, across_per_metre=0.3, heading_per_metre=0.3, position_floor=0.1, heading_floor=0.1
)
"""What a constant velocity says in a log without odometry."""


class FrontEnd:
    """Tracks a robot scan by scan and decides which scans become key scans."""

    def __init__(self, matcher: Matcher, odometry: OdometryModel | None, config: FrontEndConfig) -> None:
        """Start with no scan yet; `odometry` is None for a log without."""
        self._matcher = matcher
        self._has_odometry = odometry is not None
        self._odometry = odometry or _UNKNOWN_ODOMETRY
        self._config = config
        self._track = _tracking_of(matcher)
        self.keys: list[KeyScan] = []
        self._reference: Any = None
        self._in_reference: list[int] = []
        self._trial: Any = None
        self._trial_keys: list[int] = []
        self._on_trial = False
        self._motion = self._odometry.start()
        self._T_key_robot = np.zeros(3)
        self._last_odometry: NDArray[np.float64] | None = None
        self._last_step = np.zeros(3)
        self.failures = 0
        self.lost: list[int] = []

    def add(self, index: int, scan: Scan, T_odom_robot: NDArray[np.float64] | None) -> tuple[int, NDArray[np.float64]]:
        """Track one more scan.

        Args:
            index: which scan of the log it is.
            scan: the scan.
            T_odom_robot: (3,) odometry at the scan; None in a log without, where the velocity is taken as constant.

        Returns:
            The key scan it is tied to and its pose in that key scan's frame.
        """
        if not self.keys:
            self._last_odometry = T_odom_robot
            self._start(index, scan)
            return 0, np.zeros(3)
        step = self._step(T_odom_robot)
        self._motion = self._odometry.extend(self._motion, step)
        T_key_before = self._T_key_robot
        self._follow(scan, compose(self._T_key_robot, step))
        self._last_step = between(T_key_before, self._T_key_robot)
        if self._is_key():
            self._add_key(index, scan)
            return len(self.keys) - 1, np.zeros(3)
        return len(self.keys) - 1, self._T_key_robot

    def _step(self, T_odom_robot: NDArray[np.float64] | None) -> NDArray[np.float64]:
        if T_odom_robot is None or self._last_odometry is None:
            return self._last_step
        step = between(self._last_odometry, T_odom_robot)
        self._last_odometry = T_odom_robot
        return step

    def _start(self, index: int, scan: Scan) -> None:
        first = NoMatch(reason="first scan")
        self.keys.append(
            KeyScan(index=index, scan=scan, motion=self._motion, match=first, anchor=0, T_track_robot=np.zeros(3))
        )
        self._in_reference = [0]
        self._reference = self._prepared([0])

    def _follow(self, scan: Scan, T_key_guess: NDArray[np.float64]) -> None:
        """Pose of a scan in the last key scan's frame; odometry carries it where nothing credible is found."""
        T_track_key = self.keys[-1].T_track_robot
        guess = compose(T_track_key, T_key_guess)
        found = self._find(self._reference, scan, guess)
        self._on_trial = isinstance(found, NoMatch) and self._trial is not None
        if self._on_trial:
            found = self._find(self._trial, scan, guess)
        if isinstance(found, NoMatch):
            self.failures += 1
            self._T_key_robot = T_key_guess
        else:
            self._T_key_robot = between(T_track_key, found)

    def _find(self, reference: Any, scan: Scan, guess: NDArray[np.float64]) -> NDArray[np.float64] | NoMatch:  # noqa: ANN401
        """Pose of a scan against one reference, in the track frame."""
        if _is_blind(scan):
            return NoMatch(reason="the laser is covered")
        found = self._track(reference, scan, guess, self._motion.covariance)
        if isinstance(found, NoMatch) or self._is_plausible(reference, scan, guess, found):
            return found
        return NoMatch(reason="far from where odometry puts it, and contradicted by what is seen there")

    def _is_plausible(
        self,
        reference: Any,  # noqa: ANN401
        scan: Scan,
        guess: NDArray[np.float64],
        found: NDArray[np.float64],
    ) -> bool:
        """A pose far from the guess (odometry jumped, or the robot was carried) must explain all that is seen."""
        x, y, turn = between(guess, found).tolist()
        (xx, _, _), (_, yy, _), (_, _, hh) = self._motion.covariance.tolist()
        is_near = math.hypot(x, y) < max(_JUMP_DISTANCE, _JUMP_SIGMAS * math.sqrt(max(xx, yy)))
        if is_near and abs(turn) < max(_JUMP_TURN, _JUMP_SIGMAS * math.sqrt(hh)):
            return True
        agreement = getattr(self._matcher, "agreement", None)
        if agreement is None:
            return True
        support: Agreement = agreement(reference, scan, found)
        return support.fit >= _JUMP_FIT and support.view >= _JUMP_VIEW

    def _match(self, scan: Scan) -> RelativePose | NoMatch:
        """Match with covariance from the tracked pose, expressed in the track frame."""
        if _is_blind(scan):
            return NoMatch(reason="the laser is covered")
        guess = compose(self.keys[-1].T_track_robot, self._T_key_robot)
        reference = self._trial if self._on_trial else self._reference
        match: RelativePose | NoMatch = self._matcher.match(reference, scan, guess, self._motion.covariance)
        return match

    def _anchor(self) -> int:
        """The key scan that stands for the reference: the newest in it."""
        return (self._trial_keys if self._on_trial else self._in_reference)[-1]

    def _fuse(self, match: RelativePose) -> NDArray[np.float64]:
        """Where the match is weaker than odometry since the key scan, odometry speaks, and only there.

        Elsewhere it would pull every match a little towards its own bias, and the local map with it.
        """
        if not self._has_odometry:
            return match.T_ref_cur
        odometry = self._motion.covariance
        # The sum of the ratios bounds the largest: most matches need no more.
        if float(np.sum(np.linalg.inv(odometry) * match.covariance)) <= _ODOMETRY_SPEAKS:
            return match.T_ref_cur
        ratios, directions = eigh(match.covariance, odometry)
        share = np.where(ratios > _ODOMETRY_SPEAKS, ratios / (1.0 + ratios), 0.0)
        if not share.any():
            return match.T_ref_cur
        offset = between(match.T_ref_cur, self._motion.T_key_robot)
        return compose(match.T_ref_cur, odometry @ directions @ (share * (directions.T @ offset)))

    def _is_key(self) -> bool:
        x, y, heading = self._T_key_robot.tolist()
        limits = self._config.key_scans
        return x * x + y * y > limits.distance**2 or abs(heading) > limits.angle

    def _add_key(self, index: int, scan: Scan) -> None:
        match = self._match(scan)
        anchor = self._anchor()
        T_track_key = self.keys[-1].T_track_robot
        if not isinstance(match, NoMatch):
            T_track_match = match.T_ref_cur
            self._T_key_robot = self._fuse(replace(match, T_ref_cur=between(T_track_key, T_track_match)))
            match = replace(match, T_ref_cur=between(self.keys[anchor].T_track_robot, T_track_match))
        self.keys.append(
            KeyScan(
                index=index,
                scan=scan,
                motion=self._motion,
                match=match,
                anchor=anchor,
                T_track_robot=compose(T_track_key, self._T_key_robot),
            )
        )
        self._motion = self._odometry.start()
        self._T_key_robot = np.zeros(3)
        self._extend_reference(isinstance(match, NoMatch))

    def _extend_reference(self, is_unmatched: bool) -> None:
        """Let the newest key scan join the reference it matched; an unmatched one begins a reference on trial.

        The one on trial takes over once nothing but it has matched for a while: the robot came upon new ground, or was
        carried away.
        """
        newest = len(self.keys) - 1
        if _is_blind(self.keys[-1].scan):
            return
        if is_unmatched or self._on_trial:
            self._trial_keys.append(newest)
            self._trial = self._prepared(self._trial_keys)
            if len(self._trial_keys) >= _LOST_AFTER:
                self.lost.append(self.keys[self._trial_keys[0]].index)
                self._reference, self._in_reference = self._trial, self._trial_keys
                self._trial, self._trial_keys = None, []
            return
        self._trial, self._trial_keys = None, []
        extend = getattr(self._matcher, "extend", None)
        self._in_reference.append(newest)
        if extend is None or newest % self._config.key_scans.rebuild == 0:
            self._in_reference = self._in_reference[-self._config.key_scans.window :]
            self._reference = self._prepared(self._in_reference)
        else:
            extend(self._reference, self.keys[-1].scan, self.keys[-1].T_track_robot)

    def _prepared(self, members: list[int]) -> Any:  # noqa: ANN401
        keys = [self.keys[member] for member in members]
        return self._matcher.prepare([key.scan for key in keys], np.array([key.T_track_robot for key in keys]))


def _is_blind(scan: Scan) -> bool:
    """Whether nearly all beams end at once, or none returns: something covers the laser."""
    # Comparisons with NaN are false.
    returns = np.count_nonzero(scan.ranges >= 0.0)
    close = np.count_nonzero(scan.ranges < _BLIND_RANGE)
    return bool(returns < _FEWEST_RETURNS * len(scan.ranges) or close > _BLIND_SHARE * returns)


def track_log(
    log: Log,
    matcher: Matcher,
    noise: OdometryModel,
    config: FrontEndConfig,
    progress: Callable[[int, int], None] | None = None,
    corrected_odometry: NDArray[np.float64] | None = None,
    n_scans: int | None = None,
) -> Track:
    """Run the front end over a whole log.

    Args:
        log: the log.
        matcher: ICE or any other.
        noise: of the odometry.
        config: key scans and local reference.
        progress: called with the number of scans done and of failures so far.
        corrected_odometry: (n_scans, 3) to predict with; the log's own when left out.
        n_scans: stop after so many.

    Returns:
        The track.
    """
    front_end = FrontEnd(matcher, noise if log.has_odometry else None, config)
    odometry = log.odometry if corrected_odometry is None else corrected_odometry
    n = len(log) if n_scans is None else min(n_scans, len(log))
    key_of_scan, T_key_scan = np.empty(n, np.int64), np.empty((n, 3))
    for index in range(n):
        T_odom_robot = odometry[index] if log.has_odometry else None
        key_of_scan[index], T_key_scan[index] = front_end.add(index, log.scan(index), T_odom_robot)
        if progress is not None:
            progress(index + 1, front_end.failures)
    return Track(
        keys=front_end.keys,
        key_of_scan=key_of_scan,
        T_key_scan=T_key_scan,
        failures=front_end.failures,
        lost=front_end.lost,
    )


def _tracking_of(matcher: Matcher) -> Callable[..., NDArray[np.float64] | NoMatch]:
    """The matcher's own quick tracking, or its full matching where it has none."""
    track: Callable[..., NDArray[np.float64] | NoMatch] | None = getattr(matcher, "track", None)
    if track is not None:
        return track

    def pose_of_match(*arguments: Any) -> NDArray[np.float64] | NoMatch:  # noqa: ANN401
        match = matcher.match(*arguments)
        return match if isinstance(match, NoMatch) else match.T_ref_cur

    return pose_of_match

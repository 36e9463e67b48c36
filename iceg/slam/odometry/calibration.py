"""What this robot's odometry does wrong, learnt from the log's own matches: bias, time shift, laser mount, noise."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from operator import attrgetter

import numpy as np

from graph import dense
from graph.arrays import Bools, Floats, Ints
from graph.elementary import cos_sin
from graph.measurement import RelativePose
from graph.noise import chi2_gate
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose, inverse, wrap_angle
from iceg.slam.calibration_config import CalibrationConfig, SuddenStepConfig
from iceg.slam.odometry.delay import whole_delay
from iceg.slam.odometry.noise import Differences, lasting_noise, odometry_noise, robust_deviation
from iceg.slam.recording.steps import chained, sudden_steps
from iceg.slam.track import KeyScan, Track

_ROBUST_ROUNDS = 15
"""Rounds of iteratively reweighted least squares."""

_Equations = tuple[Floats, Floats]
"""(n, k) rows of a regression, the scale's first, and (n,) matches minus odometry."""
_Tells = Callable[[KeyScan], bool]
"""Whether the match of a key scan tells what is asked."""
_SEES_ALL: _Tells = attrgetter("is_fully_observed")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryCalibration:
    """How raw odometry becomes the best prediction of the scans' motion.

    Attributes:
        translation_scale: driven metres per metre claimed, minus 1.
        heading_scale: turned radians per radian claimed, minus 1.
        heading_per_metre: heading drift [rad/m].
        heading_shift: odometry is read this many scan periods later (earlier if negative) for its heading …
        translation_shift: … and for its translation: the two clocks differ in both, but not always by the same.
        T_odometry_laser: (3,) where the laser really sits relative to where the log puts it: x, y [m], heading [rad].
        laser_deviations: (2,) standard deviations of x and y of that [m]; a metre where nothing tells it.
        noise: what is left, from one key scan to the next.
        lasting_noise: the same for a graph, which takes the errors of successive motions for independent: widened by
            what persists of them from motion to motion, and by scales and drift where nothing else measures them.
    """

    translation_scale: float = 0.0
    heading_scale: float = 0.0
    heading_per_metre: float = 0.0
    heading_shift: float = 0.0
    translation_shift: float = 0.0
    T_odometry_laser: tuple[float, float, float] = (0.0, 0.0, 0.0)
    laser_deviations: tuple[float, float] = (1.0, 1.0)
    noise: OdometryModel
    lasting_noise: OdometryModel = field(default_factory=OdometryModel)

    def is_late(self, config: CalibrationConfig) -> bool:
        """Whether odometry is so late, or early, that what it predicted may have misled matches."""
        return abs(self.heading_shift) > config.max_linear_delay

    def apply(self, odometry: Floats, config: SuddenStepConfig) -> Floats:
        """Correct a log's odometry.

        Args:
            odometry: (n, 3) raw T_odom_robot, one per scan.
            config: which of its steps no robot made: they stay where they are.

        Returns:
            (n, 3) corrected, starting at the same pose.
        """
        if len(odometry) < 2:
            return odometry.copy()
        steps = between(odometry[:-1], odometry[1:])
        sudden = sudden_steps(odometry, config)
        distance = np.hypot(steps[:, 0], steps[:, 1])
        turns = (1.0 + self.heading_scale) * steps[:, 2] + self.heading_per_metre * np.where(sudden, 0.0, distance)
        moves = (1.0 + self.translation_scale) * steps[:, :2]
        corrected = np.column_stack(
            [
                _shifted(moves[:, 0], self.translation_shift, sudden),
                _shifted(moves[:, 1], self.translation_shift, sudden),
                _shifted(turns, self.heading_shift, sudden),
            ]
        )
        mount = np.array(self.T_odometry_laser)
        corrected = compose(compose(inverse(mount), corrected), mount)
        return chained(odometry[0], corrected)


def calibrate_odometry(track: Track, odometry: Floats, config: CalibrationConfig) -> OdometryCalibration:
    """Fit bias, time shift, mount and noise to the motions between key scans that were matched.

    A robust linear regression (Cauchy weights, priors of what is usual): the match minus the odometry between two
    key scans is linear in the scales and the drift, in the shift (times the change of speed) and in the mount.

    Args:
        track: the front end's matches, made with any odometry.
        odometry: (n, 3) raw odometry of the same log.
        config: what is usual, and what it takes to believe otherwise.

    Returns:
        The calibration; with few matches it stays near "nothing is wrong".
    """
    steps = _MatchedSteps.collect(track, config, _SEES_ALL)
    if steps is None:
        return OdometryCalibration(noise=OdometryModel())
    delay = whole_delay(steps.matched[:, 2], steps.starts, steps.ends, odometry, config)
    if not delay:
        return _calibrated(track, steps, odometry, config)
    in_time = OdometryCalibration(heading_shift=delay, translation_shift=delay, noise=OdometryModel())
    found = _calibrated(track, steps, in_time.apply(odometry, config.sudden), config)
    return replace(found, heading_shift=found.heading_shift + delay, translation_shift=found.translation_shift + delay)


def _calibrated(
    track: Track, steps: "_MatchedSteps", odometry: Floats, config: CalibrationConfig
) -> OdometryCalibration:
    """Fit to odometry that is off by a scan or so."""

    def knows_turn(key: KeyScan) -> bool:
        return isinstance(key.match, RelativePose) and key.match.knows_turn(config.turn_told)

    turned_steps = _MatchedSteps.collect(track, config, knows_turn) or steps
    windows = _MatchedSteps.collect(track, config, knows_turn, config.window) or turned_steps
    prior = np.array([config.scale_sigma, config.drift_sigma, config.delay_sigma])
    rows, errors = _turn_equations(windows, odometry)
    seen = rows[:, 0] + errors
    rows[:, 0] = np.where(np.abs(seen) > config.min_turn, seen, 0.0)
    turning, turning_sigmas = _fitted((rows, errors), _turn_equations(turned_steps, odometry), prior, config)
    turns = OdometryCalibration(
        heading_scale=float(turning[0]),
        heading_per_metre=float(turning[1]),
        heading_shift=float(np.clip(turning[2], -2, 2)),
        noise=OdometryModel(),
    )
    # A heading that drifts leads aside, too, and that must not pass for a laser that looks askew.
    turned = turns.apply(odometry, config.sudden)
    windows = _MatchedSteps.collect(track, config, _SEES_ALL, config.window) or steps
    mount = (config.mount_heading_sigma, config.delay_sigma, config.mount_ahead_sigma, config.mount_aside_sigma)
    prior = np.array([config.scale_sigma, *mount])
    rows, errors = _move_equations(windows, turned, odometry)
    rows[:, 0] = windows.matched[:, :2].T.ravel()
    equations = _move_equations(steps, turned, odometry)
    moving, moving_sigmas = _fitted((rows, errors), equations, prior, config)
    left = equations[1] - dense.matvec(equations[0], moving)
    of_turns = turned_steps.differences(np.zeros(2 * len(turned_steps.starts)), turned)
    noise, persistence = odometry_noise(steps.differences(left, turned), of_turns, turned, config)
    without_heading = list(_parts_without(track, _tells_heading))
    return replace(
        turns,
        translation_scale=float(moving[0]),
        translation_shift=float(np.clip(moving[2], -2, 2)),
        T_odometry_laser=(float(moving[3]), float(moving[4]), float(-moving[1])),
        laser_deviations=(float(moving_sigmas[3]), float(moving_sigmas[4])),
        noise=noise,
        lasting_noise=lasting_noise(
            noise,
            persistence,
            along=float(moving_sigmas[0]) * math.sqrt(_longest(_parts_without(track, _SEES_ALL))),
            drift=float(turning_sigmas[1]) * math.sqrt(_longest(without_heading)),
            turn=float(turning_sigmas[0]) * math.sqrt(_widest(without_heading)),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _MatchedSteps:
    """Steps between key scans that matches see, all key scans on the way matched.

    Attributes:
        starts: (n,) scan at which each starts …
        ends: … and at which it ends.
        matched: (n, 3) the steps by matches.
        variances: (n, 3) the last match of each claims.
    """

    starts: Ints
    ends: Ints
    matched: Floats
    variances: Floats

    @classmethod
    def collect(cls, track: Track, config: CalibrationConfig, tells: _Tells, window: int = 1) -> "_MatchedSteps | None":
        """Steps over so many key scans whose matches all tell what is asked; None where there are too few."""
        unknown = track.keys_without_odometry()
        told = [k not in unknown and tells(key) for k, key in enumerate(track.keys)]
        later = [k for k in range(window, len(told)) if all(told[k - window + 1 : k + 1])]
        if len(later) < config.min_keys:
            return None
        matches = [match for match in (track.keys[k].match for k in later) if isinstance(match, RelativePose)]
        earlier, anchors = [k - window for k in later], [track.keys[k].anchor for k in later]
        T_track_keys, T_anchor_later = track.T_track_keys, np.array([match.T_ref_cur for match in matches])
        return cls(
            starts=track.key_scans[earlier],
            ends=track.key_scans[later],
            matched=between(T_track_keys[earlier], compose(T_track_keys[anchors], T_anchor_later)),
            variances=np.array([np.diag(match.informed_covariance) for match in matches]),
        )

    def by(self, odometry: Floats) -> Floats:
        """(n, 3) the steps that odometry claims."""
        return between(odometry[self.starts], odometry[self.ends])

    def differences(self, left: Floats, turned: Floats) -> Differences:
        """What moves, (2n,) x before y, and turns leave of the matches minus odometry, seen from the end of each."""
        c, s = cos_sin(self.matched[:, 2])
        x, y = left.reshape(2, -1)
        turns = wrap_angle(self.matched[:, 2] - self.by(turned)[:, 2])
        return Differences(
            errors=np.column_stack([c * x + s * y, c * y - s * x, turns]),
            claimed=self.variances,
            turns=self.matched[:, 2],
            starts=self.starts,
            ends=self.ends,
        )


def _turn_equations(steps: _MatchedSteps, odometry: Floats) -> _Equations:
    """Scale, drift and shift of the heading."""
    turns, change = steps.by(odometry)[:, 2], _speed_change(steps, odometry)
    along = between(odometry[:-1], odometry[1:])
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(along[:, 0], along[:, 1]))])
    rows = np.column_stack([turns, travelled[steps.ends] - travelled[steps.starts], change[:, 2]])
    return rows, wrap_angle(steps.matched[:, 2] - turns)


def _move_equations(steps: _MatchedSteps, turned: Floats, odometry: Floats) -> _Equations:
    """Scale, heading of the laser, shift and mount by odometry whose turns are right, and the speed by the raw one."""
    moves, change = steps.by(turned), _speed_change(steps, odometry)
    c, s = cos_sin(steps.matched[:, 2])
    rows_x = np.column_stack([moves[:, 0], np.zeros(len(moves)), change[:, 0], c - 1.0, -s])
    rows_y = np.column_stack([moves[:, 1], moves[:, 0], change[:, 1], s, c - 1.0])
    return np.vstack([rows_x, rows_y]), (steps.matched - moves)[:, :2].T.ravel()


def _speed_change(steps: _MatchedSteps, odometry: Floats) -> Floats:
    """(n, 3) by how much the motion from scan to scan differs between both ends of each step."""
    along = between(odometry[:-1], odometry[1:])
    padded = np.vstack([along[:1], along, along[-1:]])
    speed = 0.5 * (padded[:-1] + padded[1:])
    return speed[steps.ends] - speed[steps.starts]


def _fitted(windows: _Equations, steps: _Equations, prior: Floats, config: CalibrationConfig) -> tuple[Floats, Floats]:
    """What is wrong with odometry, its scale from windows and the rest from single steps; with standard deviations.

    Odometry's noise passes for motions that the robot did not make: fitted to what odometry says, the scale would be
    too small, and where there is hardly anything but noise, as of turns in a long corridor, next to nothing. So in the
    windows the first column is what the matches say (e = s′m for m = o + so, hence s = s′ / (1 − s′)); where o is
    nothing but noise the scale is what is usual.
    """
    inverse, sigmas = _robust_fit(*windows, prior)
    share, sigma = 1.0 - float(inverse[0]), float(sigmas[0]) * math.sqrt(config.window)  # the windows overlap
    if share**2 <= chi2_gate(config.scale_false_alarm, freedom=1) * sigma**2:
        scale, sigma = 0.0, config.scale_sigma
    else:
        scale = float(inverse[0]) / share
    rows, errors = steps
    others, other_sigmas = _robust_fit(rows[:, 1:], errors - scale * rows[:, 0], prior[1:])
    return np.append(scale, others), np.append(sigma, other_sigmas)


def _robust_fit(rows: Floats, values: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """Iteratively reweighted least squares with Cauchy weights; the parameters and their standard deviations."""
    x: Floats = np.zeros(rows.shape[1])
    scale, information = 1.0, np.diag(prior**-2.0)
    for _ in range(_ROBUST_ROUNDS):
        residual = values - dense.matvec(rows, x)
        scale = robust_deviation(residual)
        weights = 1.0 / (1.0 + (residual / (2.0 * scale)) ** 2)
        weighted = (rows * weights[:, None]).T
        information = dense.matmul(weighted, rows) + np.diag((scale / prior) ** 2)
        x = dense.solve_vector(information, dense.matvec(weighted, values))
    return x, scale * np.sqrt(np.diag(dense.inv(information)))


def _parts_without(track: Track, tells: _Tells) -> Iterator[list[OdometryMotion]]:
    """The parts of the path between matches that tell what is asked: their motions, one a key scan."""
    for is_told, keys in groupby(track.keys[1:], tells):
        if not is_told:
            yield [key.motion for key in keys]


def _tells_heading(key: KeyScan) -> bool:
    """Whether a match leaves no direction open in which the robot would turn, if only by an arc of two metres."""
    return isinstance(key.match, RelativePose) and not (np.abs(key.match.weak_directions[:, 2]) > 0.5).any()


def _longest(parts: Iterable[Sequence[OdometryMotion]]) -> float:
    """The longest part [m of odometry]."""
    return max((sum(motion.distance for motion in part) for part in parts), default=0.0)


def _widest(parts: Iterable[Sequence[OdometryMotion]]) -> float:
    """The range of headings in a part, squared, for each radian turned through [rad], at most.

    A scale of turns is off by what lies between the headings, however often the robot turns to and fro.
    """
    widest = 0.0
    for part in parts:
        headings = np.cumsum([0.0, *(float(motion.T_key_robot[2]) for motion in part)])
        turned = sum(motion.turn for motion in part)
        widest = max(widest, float(np.ptp(headings)) ** 2 / turned if turned else 0.0)
    return widest


def _shifted(values: Floats, shift: float, fixed: Bools) -> Floats:
    """A sequence read `shift` places later, interpolated, constant beyond its ends; fixed values stay in place."""
    places = np.arange(len(values), dtype=np.float64)
    moving = places[~fixed]
    shifted = np.interp(places + shift, moving, values[~fixed]) if len(moving) else values
    return np.where(fixed, values, shifted)

"""What this robot's odometry does wrong, learnt from the log's own matches: bias, time shift, laser mount, noise."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from graph import dense
from graph.elementary import cos_sin
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import between, compose, inverse, wrap_angle
from iceg.slam.calibration_config import CalibrationConfig, SuddenStepConfig
from iceg.slam.odometry.delay import whole_delay
from iceg.slam.odometry.noise import Differences, LastingErrors, lasting_noise, odometry_noise, robust_deviation
from iceg.slam.recording.steps import chained, sudden_steps
from iceg.slam.track import KeyScan, Track

_ROBUST_ROUNDS = 15
"""Rounds of iteratively reweighted least squares."""


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
    noise: OdometryModel
    lasting_noise: OdometryModel = field(default_factory=OdometryModel)

    def is_late(self, config: CalibrationConfig) -> bool:
        """Whether odometry is so late, or early, that what it predicted may have misled matches."""
        return abs(self.heading_shift) > config.max_linear_delay

    def apply(self, odometry: NDArray[np.float64], config: SuddenStepConfig) -> NDArray[np.float64]:
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


def calibrate_odometry(track: Track, odometry: NDArray[np.float64], config: CalibrationConfig) -> OdometryCalibration:
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
    samples = _Samples.collect(track, odometry, config)
    if samples is None:
        return OdometryCalibration(noise=OdometryModel())
    delay = whole_delay(samples.matched[:, 2], samples.starts, samples.ends, odometry, config)
    if delay:
        in_time = OdometryCalibration(heading_shift=delay, translation_shift=delay, noise=OdometryModel())
        found = _calibrated(track, in_time.apply(odometry, config.sudden), config)
        return replace(
            found, heading_shift=found.heading_shift + delay, translation_shift=found.translation_shift + delay
        )
    return _calibrated(track, odometry, config, samples)


def _calibrated(
    track: Track, odometry: NDArray[np.float64], config: CalibrationConfig, samples: "_Samples | None" = None
) -> OdometryCalibration:
    """Fit to the motions between matched key scans, of which there are enough; odometry is off by a scan or so."""
    samples = samples or _Samples.collect(track, odometry, config)
    assert samples is not None
    windows = _Samples.collect(track, odometry, config, config.window) or samples
    turns, drift, turn_scale = _fit_turns(samples, windows, config)
    # A heading that drifts leads aside, too, and that must not pass for a laser that looks askew.
    turned = turns.apply(odometry, config.sudden)
    samples, windows = samples.claimed_by(turned), windows.claimed_by(turned)
    translation, deviation = _fit_moves(samples, windows, config)
    error, _, rows_x, rows_y = _equations(samples)
    x, y = (error[:, k] - dense.matvec(rows, translation) for k, rows in enumerate((rows_x, rows_y)))
    left = np.column_stack([x, y, error[:, 2]])
    noise, persistence = odometry_noise(samples.differences(left), turned, config)
    without_heading = list(_parts_without(track, _tells_heading))
    lasting = LastingErrors(
        along=deviation * math.sqrt(_longest(_parts_without(track, _is_seen))),
        drift=drift * math.sqrt(_longest(without_heading)),
        turn=turn_scale * math.sqrt(_widest(without_heading)),
    )
    return replace(
        turns,
        translation_scale=float(translation[0]),
        translation_shift=float(np.clip(translation[2], -2, 2)),
        T_odometry_laser=(float(translation[3]), float(translation[4]), float(-translation[1])),
        noise=noise,
        lasting_noise=lasting_noise(noise, persistence, lasting),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Samples:
    """Per matched key scan: match, odometry, path, and change of speed from one key scan to the next."""

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    matched: NDArray[np.float64]
    motions: NDArray[np.float64]
    variances: NDArray[np.float64]
    distance: NDArray[np.float64]
    turn: NDArray[np.float64]
    speed_change: NDArray[np.float64]

    @classmethod
    def collect(
        cls, track: Track, odometry: NDArray[np.float64], config: CalibrationConfig, window: int = 1
    ) -> "_Samples | None":
        """Motions over so many key scans, all of them matched."""
        unknown = track.keys_without_odometry()
        pairs = [
            (track.keys[k - window], track.keys[k], match)
            for k, match in ((k, track.keys[k].match) for k in range(window, len(track.keys)))
            if not isinstance(match, NoMatch)
            and all(map(_is_seen, track.keys[k - window + 1 : k + 1]))
            and unknown.isdisjoint(range(k - window + 1, k + 1))
        ]
        if len(pairs) < config.min_keys:
            return None
        starts = np.array([previous.index for previous, _, _ in pairs])
        ends = np.array([key.index for _, key, _ in pairs])
        steps = between(odometry[:-1], odometry[1:])
        padded = np.vstack([steps[:1], steps, steps[-1:]])
        speed = 0.5 * (padded[:-1] + padded[1:])
        travelled = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        turned = np.concatenate([[0.0], np.cumsum(np.abs(steps[:, 2]))])
        return cls(
            starts=starts,
            ends=ends,
            matched=_steps(track, pairs),
            motions=between(odometry[starts], odometry[ends]),
            variances=np.array([match.covariance for _, _, match in pairs])[:, range(3), range(3)],
            distance=travelled[ends] - travelled[starts],
            turn=turned[ends] - turned[starts],
            speed_change=speed[ends] - speed[starts],
        )

    def differences(self, left: NDArray[np.float64]) -> Differences:
        """What is left of the matches minus odometry, (n, 3), seen from the end of each motion."""
        c, s = cos_sin(self.matched[:, 2])
        return Differences(
            errors=np.column_stack([c * left[:, 0] + s * left[:, 1], c * left[:, 1] - s * left[:, 0], left[:, 2]]),
            claimed=self.variances,
            turns=self.matched[:, 2],
            starts=self.starts,
            ends=self.ends,
        )

    def claimed_by(self, odometry: NDArray[np.float64]) -> "_Samples":
        """The same with the motions of another odometry."""
        return replace(self, motions=between(odometry[self.starts], odometry[self.ends]))


def _equations(
    samples: _Samples,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(n, 3) match minus odometry, and the rows of its regression: heading (n, 3), x and y (n, 5)."""
    m, o, change = samples.matched, samples.motions, samples.speed_change
    c, s = cos_sin(m[:, 2])
    error = m - o
    error[:, 2] = wrap_angle(error[:, 2])
    turning = np.column_stack([o[:, 2], samples.distance, change[:, 2]])
    rows_x = np.column_stack([o[:, 0], np.zeros(len(m)), change[:, 0], c - 1.0, -s])
    rows_y = np.column_stack([o[:, 1], o[:, 0], change[:, 1], s, c - 1.0])
    return error, turning, rows_x, rows_y


def _fit_turns(
    samples: _Samples, windows: _Samples, config: CalibrationConfig
) -> tuple[OdometryCalibration, float, float]:
    """What is wrong with the heading; the scale of its turns from windows of several motions.

    Returns:
        That, and the standard deviations of the drift [rad/m] and of the scale.
    """
    error, rows, _, _ = _equations(samples)
    long_error, long_rows, _, _ = _equations(windows)
    prior = np.array([config.scale_sigma, config.drift_sigma, config.delay_sigma])
    scale, deviation = _turn_scale(long_rows, long_error[:, 2], prior, config)
    others, deviations = _robust_fit(rows[:, 1:], error[:, 2] - scale * rows[:, 0], prior[1:])
    found = OdometryCalibration(
        heading_scale=scale,
        heading_per_metre=float(others[0]),
        heading_shift=float(np.clip(others[1], -2, 2)),
        noise=OdometryModel(),
    )
    return found, float(deviations[0]), deviation


def _turn_scale(
    rows: NDArray[np.float64], error: NDArray[np.float64], prior: NDArray[np.float64], config: CalibrationConfig
) -> tuple[float, float]:
    """Scale of turns and its standard deviation, from the heading's regression: rows (n, 3), match minus odometry (n,).

    Odometry's noise passes for turns that the robot did not make: fitted to what odometry says, the scale would be too
    small, and where there is hardly anything but noise, as in a long corridor, next to nothing. So it is fitted to what
    the matches say (e = s′m for m = o + so, hence s = s′ / (1 − s′)), and to turns that stand out of the noise.
    """
    matched = rows[:, 0] + error
    turns = np.where(np.abs(matched) > config.min_turn, matched, 0.0)
    inverse, deviations = _robust_fit(np.column_stack([turns, rows[:, 1:]]), error, prior)
    return _scale(float(inverse[0]), float(deviations[0]), config)


def _scale(inverse: float, deviation: float, config: CalibrationConfig) -> tuple[float, float]:
    """Scale s of odometry o, and its standard deviation, from the s′ of m - o = s′m in windows and its deviation.

    Where o is nothing but noise that is what is usual.
    """
    share, deviation = 1.0 - inverse, deviation * math.sqrt(config.window)  # the windows overlap
    if share**2 <= chi2_gate(config.scale_false_alarm, freedom=1) * deviation**2:
        return 0.0, config.scale_sigma
    return inverse / share, deviation


def _fit_moves(samples: _Samples, windows: _Samples, config: CalibrationConfig) -> tuple[NDArray[np.float64], float]:
    """(5,) what is wrong with the translation; its scale, from windows, with its standard deviation."""
    prior = np.array(
        [
            config.scale_sigma,
            config.mount_heading_sigma,
            config.delay_sigma,
            config.mount_ahead_sigma,
            config.mount_aside_sigma,
        ]
    )
    long_error, _, long_x, long_y = _equations(windows)
    # Fitted to what the matches say, as the scale of turns is, and for the same reason.
    long_x[:, 0], long_y[:, 0] = windows.matched[:, 0], windows.matched[:, 1]
    inverse, deviations = _robust_fit(
        np.vstack([long_x, long_y]), np.concatenate([long_error[:, 0], long_error[:, 1]]), prior
    )
    scale, deviation = _scale(float(inverse[0]), float(deviations[0]), config)
    error, _, rows_x, rows_y = _equations(samples)
    rows = np.vstack([rows_x, rows_y])
    unscaled = np.concatenate([error[:, 0], error[:, 1]]) - scale * rows[:, 0]
    others, _ = _robust_fit(rows[:, 1:], unscaled, prior[1:])
    return np.append(scale, others), deviation


def _steps(track: Track, pairs: Sequence[tuple[KeyScan, KeyScan, RelativePose]]) -> NDArray[np.float64]:
    """(n, 3) matches of later key scans as steps from earlier ones."""
    T_track_earlier = np.array([earlier.T_track_robot for earlier, _, _ in pairs])
    T_track_anchor = np.array([track.keys[later.anchor].T_track_robot for _, later, _ in pairs])
    T_anchor_later = np.array([match.T_ref_cur for _, _, match in pairs])
    return between(T_track_earlier, compose(T_track_anchor, T_anchor_later))


def _is_seen(key: KeyScan) -> bool:
    return not isinstance(key.match, NoMatch) and key.match.is_fully_observed


def _robust_fit(
    rows: NDArray[np.float64], values: NDArray[np.float64], prior: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Iteratively reweighted least squares with Cauchy weights; the parameters and their standard deviations."""
    x: NDArray[np.float64] = np.zeros(rows.shape[1])
    scale, information = 1.0, np.diag(prior**-2.0)
    for _ in range(_ROBUST_ROUNDS):
        residual = values - dense.matvec(rows, x)
        scale = robust_deviation(residual)
        weights = 1.0 / (1.0 + (residual / (2.0 * scale)) ** 2)
        weighted = (rows * weights[:, None]).T
        information = dense.matmul(weighted, rows) + np.diag((scale / prior) ** 2)
        x = dense.solve_vector(information, dense.matvec(weighted, values))
    return x, scale * np.sqrt(np.diag(dense.inv(information)))


def _parts_without(track: Track, is_seen: Callable[[KeyScan], bool]) -> Iterator[list[OdometryMotion]]:
    """The parts of the path between matches that tell enough: their motions, one a key scan."""
    for tells, keys in groupby(track.keys[1:], is_seen):
        if not tells:
            yield [key.motion for key in keys]


def _tells_heading(key: KeyScan) -> bool:
    """Whether a match leaves no direction open in which the robot would turn, if only by an arc of two metres."""
    return not isinstance(key.match, NoMatch) and not (np.abs(key.match.weak_directions[:, 2]) > 0.5).any()


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


def _shifted(values: NDArray[np.float64], shift: float, fixed: NDArray[np.bool_]) -> NDArray[np.float64]:
    """A sequence read `shift` places later, interpolated, constant beyond its ends; fixed values stay in place."""
    places = np.arange(len(values), dtype=np.float64)
    moving = places[~fixed]
    shifted = np.interp(places + shift, moving, values[~fixed]) if len(moving) else values
    return np.where(fixed, values, shifted)

"""What takes odometry's place in a log without: a robot goes about as fast as just before and just after.

Where a match does not see a direction, as in front of a single wall, nothing but the robot's velocity tells how far it
went. The velocity from key scan to key scan, in the robot's frame and in the time that usually passes between scans, is
taken for an Ornstein-Uhlenbeck process: it varies about what is usual at such turns (`usual_velocity`) and forgets
itself exponentially, as the steps show whose matches see all directions (Rasmussen and Williams, *Gaussian Processes
for Machine Learning*, 2006, appendix B). The process is Markov: of the steps that were seen, only the last before and
the first after tell of another. A step's own match does not: it enters the graph by itself, and would count twice.

Steps in a row that nothing sees err together, but the factors of a graph are independent. So each gets the covariance
of its error with that of the whole row, which lets the row end as uncertain as it is. What is usual is known as the
mean over the time that was seen, and by how much it is wrong all rows are: each step gets its covariance with the sum
of these errors, too, so that corridor after corridor the path ends as uncertain as it is.

A recording begins and ends with a robot that may stand, for as long as nobody knows: of the first step and the last, if
no match sees them, any share may be missing.
"""

from dataclasses import dataclass, replace

import numpy as np

from graph import dense
from graph.arrays import Bools, Floats, Ints
from graph.elementary import cos_sin, exp, log
from graph.measurement import NoMatch
from graph.odometry import OdometryModel, OdometryMotion
from graph.se2 import adjoint, between, expmap, logmap, wrap_angle
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.heading_odometry import HeadingOdometry, with_headings
from iceg.slam.odometry.motions import motions_of
from iceg.slam.odometry.usual_velocity import usual_velocities
from iceg.slam.recording.intervals import confirmed_intervals
from iceg.slam.track import Track

_LEAST_CHANGE = 1e-3
"""Share of its variance by which a velocity changes at least from one step to the next; at most by 1 less this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySteps:
    """The way from each key scan to the next: along, across, or its turn.

    Time is counted in usual intervals from scan to scan.

    Attributes:
        durations: (n,) of the steps.
        times: (n,) the middle of each.
        velocities: (n,) mean velocities, per interval [m or rad].
        variances: (n,) of these, as the matches claim; 0 where nothing matched.
        are_observed: (n,) whether the matches see all directions.
        are_asked: (n,) whether no odometry tells of them, so that the path rests on what the velocity does.
        usual: (n,) velocities that are usual, per interval [m or rad].
    """

    durations: Floats
    times: Floats
    velocities: Floats
    variances: Floats
    are_observed: Bools
    are_asked: Bools
    usual: Floats

    @property
    def deviations(self) -> Floats:
        """(n,) of the velocities from what is usual."""
        return self.velocities - self.usual

    @property
    def are_in_a_row(self) -> Bools:
        """(n - 1,) whether two steps that follow one another are both observed."""
        return np.asarray(self.are_observed[1:] & self.are_observed[:-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityModel:
    """How far a robot's velocity is from what is usual, and for how long.

    Attributes:
        variance: about what is usual [m² or rad², per interval²].
        memory: intervals after which the correlation has fallen to 1/e.
    """

    variance: float
    memory: float

    @classmethod
    def learned(cls, steps: KeySteps, least: float) -> "VelocityModel":
        """From the steps that matches see.

        Args:
            steps: at least two of them in a row observed.
            least: standard deviation of the velocity over a step of usual length [m or rad].
        """
        changes = np.diff(steps.deviations)[steps.are_in_a_row]
        lag = float(np.diff(steps.times)[steps.are_in_a_row].mean())
        variance = max(float((steps.deviations[steps.are_observed] ** 2).mean()), (least / lag) ** 2)
        changed = float((changes**2).mean()) / (2.0 * variance)
        remembered = 1.0 - min(max(changed, _LEAST_CHANGE), 1.0 - _LEAST_CHANGE)
        return cls(variance=variance, memory=-lag / float(log(remembered)))

    def of_mean(self, time: float) -> float:
        """Variance of the mean velocity over so many intervals in a row about what is usual."""
        memories = time / self.memory
        return self.variance * 2.0 / memories * (1.0 - (1.0 - float(exp(-memories))) / memories)

    def correlation(self, times: Floats) -> Floats:
        """(n,) of velocities so many intervals apart; those that are infinitely far apart have none."""
        return exp(-np.abs(times) / self.memory)

    def change(self, times: Floats) -> Floats:
        """(n,) variances of the change of the velocity over so many intervals."""
        return 2.0 * self.variance * (1.0 - self.correlation(times))


def motions_without_odometry(
    track: Track, stamps: Floats, config: CalibrationConfig, heading: HeadingOdometry | None = None
) -> list[OdometryMotion | None]:
    """What the velocity tells of the way to every key scan but the first, odometry left aside.

    Args:
        track: what the front end found.
        stamps: (n_scans,) of the scans [s]; they tell where scans are missing.
        config: when the matches tell enough of the velocity.
        heading: what is known of the turns; None for nothing.

    Returns:
        None where the robot may have been carried; everywhere, where the matches hardly tell of its velocity.
    """
    left = track.keys_left_to_velocity()
    are_asked = np.array([key in left for key in range(1, len(track.keys))], dtype=np.bool_)
    track = replace(track, dead=[])
    if heading is None:
        poses, turns = track.T_track_scans, OdometryModel()
    else:
        poses, turns = with_headings(track, heading.headings), heading.lasting_noise.within(OdometryModel())
    pauses = pauses_along(stamps, poses)
    known, axes = motions_of(track, poses, turns), _steps(track, poses, pauses, are_asked)
    if np.count_nonzero(axes[0].are_in_a_row) < config.velocity_min_steps:
        return [None] * len(known)
    twists, variances = np.stack([foretold(steps, config) for steps in axes], axis=-1)
    ends = [end for end in (0, -1) if not axes[0].are_observed[end]]
    variances[ends] += twists[ends] ** 2 / 3.0  # the mean square of a share between nothing and all
    if heading is not None:
        variances[:, 2] = [0.0 if motion is None else motion.covariance[2, 2] for motion in known]
    ways, covariances = expmap(twists), _at_their_ends(twists, variances)
    # The way to the end depends on the turns: where something else knows them better, it follows the headings.
    by_matches = axes[2].variances * axes[2].durations ** 2
    knows_turn = (heading is not None) | ((by_matches > 0.0) & (by_matches <= variances[:, 2]))
    along, covariances_along = along_headings(poses[:, 2], track.key_scans, pauses, twists, variances)
    ways = np.where(knows_turn[:, None], along, ways)
    covariances = np.where(knows_turn[:, None, None], covariances_along, covariances)
    return [
        None if motion is None else replace(motion, T_key_robot=way, covariance=covariance)
        for motion, way, covariance in zip(known, ways, covariances, strict=True)
    ]


def steps_along(track: Track, stamps: Floats) -> KeySteps:
    """How far the robot went ahead from key scan to key scan, all of it asked of the velocity.

    Args:
        track: what the front end found.
        stamps: (n_scans,) of the scans [s]; they tell where scans are missing.
    """
    poses = track.T_track_scans
    return _steps(track, poses, pauses_along(stamps, poses), np.ones(len(track.keys) - 1, dtype=np.bool_))[0]


def pauses_along(stamps: Floats, poses: Floats) -> Floats:
    """(n_scans - 1,) usual intervals between (n_scans, 3) poses, as far as these confirm (n_scans,) stamps [s]."""
    steps = between(poses[:-1], poses[1:])
    return confirmed_intervals(stamps, np.sqrt(steps[:, 0] ** 2 + steps[:, 1] ** 2))


def foretold(steps: KeySteps, config: CalibrationConfig) -> tuple[Floats, Floats]:
    """What the velocity before and after tells of each step.

    Args:
        steps: enough of them observed.
        config: when a match tells of the velocity.

    Returns:
        (n,) how far each goes [m or rad], and (n,) the variances of that, each with its share of the errors that it has
        in common with the row of steps that it belongs to, and with all rows.
    """
    model = VelocityModel.learned(steps, config.velocity_min_sigma)
    tells = steps.are_observed & (steps.variances <= config.velocity_told * model.change(steps.durations))
    before, after = _neighbours(tells)
    to_before, to_after = (_time_to(end, steps.times) for end in (before, after))
    by_before, by_after, between_ends = (model.correlation(t) for t in (to_before, to_after, to_before + to_after))
    # The conditional distribution of a Gaussian process, given two noisy values; all relative to its variance.
    of_before, of_after = (1.0 + steps.variances[end] / model.variance for end in (before, after))
    determinant = of_before * of_after - between_ends**2
    weight_before = (of_after * by_before - between_ends * by_after) / determinant
    weight_after = (of_before * by_after - between_ends * by_before) / determinant
    velocities = steps.usual + weight_before * steps.deviations[before] + weight_after * steps.deviations[after]
    row_starts = np.flatnonzero(tells | np.append(True, tells[:-1]))
    common = _correlated_time(steps, model, row_starts)
    for by, weight in ((by_before, weight_before), (by_after, weight_after)):
        common -= by * _sums(weight * steps.durations, row_starts)
    by_usual = np.where(tells | ~steps.are_asked, 0.0, (1.0 - weight_before - weight_after) * steps.durations)
    of_usual = model.of_mean(float(steps.durations[steps.are_observed].sum()))
    variances = model.variance * steps.durations * common + of_usual * by_usual * by_usual.sum()
    return velocities * steps.durations, np.maximum(variances, config.velocity_min_sigma**2)


def _steps(track: Track, poses: Floats, pauses: Floats, are_asked: Bools) -> list[KeySteps]:
    """The steps of a track along (n_scans, 3) poses, (n_scans - 1,) intervals apart: along, across, and the turns."""
    index, later = track.key_scans, track.keys[1:]
    clock = np.append(0.0, np.cumsum(pauses))[index]
    durations = np.diff(clock)
    claimed = np.zeros((len(later), 3))
    for variances, key in zip(claimed, later, strict=True):
        if not isinstance(key.match, NoMatch):
            variances[:] = np.diag(key.match.covariance)
    twists = logmap(between(poses[index[:-1]], poses[index[1:]]))
    are_observed = np.array([key.is_fully_observed for key in later], dtype=np.bool_)
    turns = wrap_angle(np.diff(poses[: index[-1] + 1, 2]))
    usual = usual_velocities(twists / durations[:, None], turns, pauses[: index[-1]], index[:-1], are_observed)
    return [
        KeySteps(
            durations=durations,
            times=0.5 * (clock[1:] + clock[:-1]),
            velocities=twists[:, axis] / durations,
            variances=claimed[:, axis] / durations**2,
            are_observed=are_observed,
            are_asked=are_asked,
            usual=usual[:, axis],
        )
        for axis in range(3)
    ]


def _neighbours(tells: Bools) -> tuple[Ints, Ints]:
    """(n,) the last step before each that tells of the velocity, and the first after it; -1 where there is none."""
    known, steps = np.flatnonzero(tells), np.arange(len(tells))
    padded = np.concatenate([[-1], known, [-1]])
    return padded[np.searchsorted(known, steps, "left")], padded[np.searchsorted(known, steps, "right") + 1]


def _time_to(ends: Ints, times: Floats) -> Floats:
    """(n,) intervals between each step and another one; infinitely many to one that is not there."""
    return np.where(ends < 0, np.inf, np.abs(times - times[ends]))


def _correlated_time(steps: KeySteps, model: VelocityModel, row_starts: Ints) -> Floats:
    """(n,) the durations of all steps of its row, each times its correlation with the step."""
    kept = np.append(0.0, model.correlation(np.diff(steps.times)))
    kept[row_starts] = 0.0
    since, until = steps.durations.copy(), steps.durations.copy()
    for step in range(1, len(kept)):
        since[step] += kept[step] * since[step - 1]
    for step in range(len(kept) - 1, 0, -1):
        until[step - 1] += kept[step] * until[step]
    return since + until - steps.durations


def _sums(values: Floats, row_starts: Ints) -> Floats:
    """(n,) the sum of the values of each one's row."""
    return np.repeat(np.add.reduceat(values, row_starts), np.diff(np.append(row_starts, len(values))))


def along_headings(
    headings: Floats, index: Ints, pauses: Floats, twists: Floats, variances: Floats
) -> tuple[Floats, Floats]:
    """Steps whose headings are known from scan to scan, where the velocity alone tells how far they go.

    A robot may have gone faster or slower anywhere on the way: what is not known of its length lies along all of the
    headings on it, and not along the chord.

    Args:
        headings: (n_scans,) of the robot [rad].
        index: (n + 1,) the scans at which steps begin and end, the first one 0.
        pauses: (n_scans - 1,) intervals from scan to scan.
        twists: (n, 3) how far each goes along and across [m]; its turn is not asked.
        variances: (n, 3) of these; that of the turn is what the velocity knows of it.

    Returns:
        (n, 3) the steps, and their (n, 3, 3) covariances in the tangent spaces at them.
    """
    starts, scans, pauses = index[:-1], np.diff(index), pauses[: index[-1]]
    durations = np.add.reduceat(pauses, starts)
    unwrapped = np.unwrap(headings)
    begins, ends = unwrapped[starts], unwrapped[index[1:]]
    between_scans = 0.5 * (unwrapped[1:] + unwrapped[:-1])[: index[-1]]
    seen_from_start = cos_sin(between_scans - np.repeat(begins, scans))
    c, s = (np.add.reduceat(pauses * each, starts) / durations for each in seen_from_start)
    along, across, _ = twists.T
    ways = np.column_stack([c * along - s * across, s * along + c * across, wrap_angle(ends - begins)])
    twice = cos_sin(2.0 * (between_scans - np.repeat(ends, scans)))
    c, s = (np.add.reduceat(pauses * each, starts) / durations for each in twice)
    mean, half = 0.5 * (variances[:, 0] + variances[:, 1]), 0.5 * (variances[:, 0] - variances[:, 1])
    covariances = np.zeros((len(twists), 3, 3))
    covariances[:, 0, 0], covariances[:, 1, 1] = mean + half * c, mean - half * c
    covariances[:, 0, 1] = covariances[:, 1, 0] = half * s
    covariances[:, 2, 2] = variances[:, 2]
    return ways, covariances


def _at_their_ends(twists: Floats, variances: Floats) -> Floats:
    """(n, 3, 3) covariances of poses on arcs in the tangent spaces at them.

    The right Jacobian of the exponential map, ∫ Ad(exp(-s ξ)) ds over [0, 1], by Simpson's rule; and to second order
    what a way whose length and turn are both uncertain leads aside.

    Args:
        twists: (n, 3).
        variances: (n, 3) of them.
    """
    jacobians = (np.eye(3) + 4.0 * adjoint(expmap(-0.5 * twists)) + adjoint(expmap(-twists))) / 6.0
    found = dense.congruence(jacobians, variances[:, :, None] * np.eye(3))
    found[:, 0, 0] += 0.25 * variances[:, 2] * variances[:, 1]
    found[:, 1, 1] += 0.25 * variances[:, 2] * variances[:, 0]
    return found

"""Whether the robot was carried at a step of its path: then the laser sees something else at once.

A robot that drives sees from one scan to the next almost the same, whatever its odometry or a match says of the step.
One that is carried, or whose recording was cut, does not; only where places look alike does it go unnoticed. How
probable a change of view is by chance, all other steps of the same log tell: beyond the rarest of them the Pareto tail
that fits these (Hill 1975), for people and doors that appear at once make that tail heavy. How probable it is for one
that is carried, scans of different parts of the log tell. The ratio of the two is a Bayes factor; how often tracking
fails in that log says what it is up against.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats, Ints
from graph.elementary import arctan2
from graph.measurement import NoMatch
from graph.noise import chi2_gate
from graph.se2 import between, compose, transform_points
from iceg.ice.matcher import IceMatcher
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.closure_config import TrackingFailureConfig, ViewChangeConfig
from iceg.slam.track import Track

_TOGETHER = 100
"""Pairs of scans that are compared at once, for memory."""
_NOT_YET = -1.0
_LEAST_CHANGE = 1e-3
"""No smaller share of the beams is a change."""
_LIGHTEST_TAIL = 1.01
"""Half of what lies beyond the tail's start lies beyond so many times its start, at least."""
_LEAST_DENSITY = 1e-12
"""A change may be so rare by chance, and no rarer: logs are short."""
_ROUNDS = 5
"""In which the odds of one failure follow those of the others."""


@dataclass(frozen=True, eq=False)
class ViewChanges:
    """How much the view changes at the steps of a path.

    Attributes:
        log: the scans.
        track: where the front end saw them from.
        judge: matches two scans where tracking may be wrong about the step between them.
        config: what is compared.
    """

    log: Log
    track: Track
    judge: IceMatcher
    config: ViewChangeConfig

    def bayes_factor(self, steps: Ints) -> float | None:
        """How many times as probable the changes of view at some steps are if the robot was carried at one of them.

        Args:
            steps: (n,) see `steps`.

        Returns:
            The ratio; None where too few scans of the log see enough to tell.
        """
        changes = self._changes(steps)
        if not len(self._usual(1)) or not len(changes):
            return None
        usual = [self._usual(self._usual_steps(step)) for step in steps.tolist()]
        ratios = np.array([self._ratio(*each) for each in zip(changes.tolist(), usual, strict=True)])
        for row in np.argsort(-np.nan_to_num(changes), kind="stable").tolist():
            if ratios[row] <= 1.0:
                continue
            step, T_track_robot = steps[row : row + 1], self._T_track_robot
            tracked = between(T_track_robot[step], T_track_robot[step + 1])
            change = np.fmin(changes[row], self._changes_where_matched(step, step + 1, tracked)[0])
            ratios[row] = self._ratio(float(change), usual[row])
        return float(np.mean(ratios))

    def is_mostly_new(self, steps: Ints) -> bool:
        """Whether at one of (n,) steps more of the beams do not agree than do."""
        return bool((self._changes(steps) > 0.5).any())

    def after_largest(self, steps: Ints) -> tuple[int, int]:
        """The first key pose, and the first scan, after the step at which the view changes most, of (n,) steps.

        A match that leads back from where tracking went astray changes the view as well, but not as odometry has it.
        """
        changes = self._changes(steps)
        if self.log.has_odometry:
            changes = np.fmin(changes, self._changes_along(steps, self.log.odometry))  # along it fewer may compare
        scan = int(steps[np.nan_to_num(changes).argmax()]) + 1
        return int(np.searchsorted(self.track.key_scans, scan)), scan

    def steps(self, key: int, keys: int) -> Ints:
        """(n,) the scans, each with its step to the next, from so many key scans before one up to it."""
        scans = self.track.keys
        return np.arange(scans[max(key - keys, 0)].index, scans[key].index)

    def _ratio(self, change: float, usual: Floats) -> float:
        """How many times as probable a change is from one scan to another place's as by chance.

        One too few beams tell of says nothing, nor does one of which too few are like it.

        Args:
            change: of a step.
            usual: (m,) those of steps as long, sorted.
        """
        if not math.isfinite(change) or not len(usual):
            return 1.0
        share = self.config.tail
        start = max(float(usual[math.ceil((1.0 - share) * (len(usual) - 1))]), _LEAST_CHANGE)
        if change <= start:
            return self._share_elsewhere(0.0, start) / (1.0 - share)
        beyond = usual[usual > start]
        half_beyond = float(np.median(beyond / start)) if len(beyond) else 1.0  # half of the tail lies below
        shape = math.log(2.0) / math.log(max(half_beyond, _LIGHTEST_TAIL))
        by_chance = share * math.exp(-shape * math.log(change / start)) * shape / change
        low, high = max(start, change - self.config.window), min(1.0, change + self.config.window)
        return self._share_elsewhere(low, high) / max(high - low, _LEAST_CHANGE) / max(by_chance, _LEAST_DENSITY)

    def _usual_steps(self, step: int) -> int:
        """How many steps of the log usually lead as far as one, 1, 2, 4, …: the recorder may have paused meanwhile.

        Where match and odometry differ it is as long as the shorter: either may be wrong.
        """
        poses = [self._T_track_robot, self.log.odometry] if self.log.has_odometry else []
        far = min((math.hypot(*(each[step + 1] - each[step])[:2]) for each in poses), default=0.0)
        return 1 << int(np.searchsorted(self._usual_lengths, far))

    @cached_property
    def _usual_lengths(self) -> Floats:
        """(k,) how far 1, 2, 4, … steps lead, but for few [m]; ascending, up to half of the log."""
        lengths: list[float] = []
        n_steps = 1
        while 2 * n_steps <= len(self.log) // 2:
            moved = self._T_track_robot[n_steps:] - self._T_track_robot[:-n_steps]
            lengths.append(float(np.quantile(np.hypot(moved[:, 0], moved[:, 1]), 1.0 - self.config.tail)))
            n_steps *= 2
        return np.maximum.accumulate(np.array(lengths))

    def _usual(self, n_steps: int) -> Floats:
        """(m,) the changes over so many steps, of the whole log, sorted; none where too few can be compared."""
        if n_steps not in self._usual_changes:
            every = max(1, -(-(len(self.log) - n_steps) // self.config.most_steps))
            first = np.arange(0, len(self.log) - n_steps, every)
            changes = self._changes(first) if n_steps == 1 else self._changes_along(first, self._T_track_robot, n_steps)
            changes = np.sort(changes[np.isfinite(changes)])
            self._usual_changes[n_steps] = changes if len(changes) >= self.config.min_steps else changes[:0]
        return self._usual_changes[n_steps]

    def _changes(self, steps: Ints) -> Floats:
        """(n,) share of the beams of two scans that do not agree; NaN where too few can be compared.

        Args:
            steps: (n,) the earlier scan of each.
        """
        unknown = np.unique(steps[self._found[steps] == _NOT_YET])
        self._found[unknown] = self._changes_along(unknown, self._T_track_robot)
        return np.asarray(self._found[steps])

    @cached_property
    def _found(self) -> Floats:
        """(n_scans - 1,) changes of the steps that were asked for."""
        return np.full(len(self.log) - 1, _NOT_YET)

    @cached_property
    def _usual_changes(self) -> dict[int, Floats]:
        """By number of steps, see `_usual`."""
        return {}

    def _share_elsewhere(self, low: float, high: float) -> float:
        """How many scans of other places would differ by so much, had the robot been carried there."""
        elsewhere = self._elsewhere
        found = np.count_nonzero((elsewhere >= low) & (elsewhere <= high))
        return float((found + self.config.any_change * (high - low)) / (len(elsewhere) + self.config.any_change))

    @cached_property
    def _elsewhere(self) -> Floats:
        """Changes from scans of the log to scans of another part of it, as the matcher would have them lie."""
        before = np.linspace(0, len(self.log) - 1, self.config.most_elsewhere + 1).astype(np.int64)[:-1]
        after = (before + len(self.log) // 2) % len(self.log)
        changes = self._changes_where_matched(before, after, np.zeros((len(before), 3)))
        return changes[np.isfinite(changes)]

    def _changes_where_matched(self, before: Ints, after: Ints, guesses: Floats) -> Floats:
        """Share of the beams of (n,) scans and others that do not agree as they match each other; NaN as `_changes`.

        Tracking may have taken the robot to the wrong place, and somebody who is carried matches as well as he can.

        Args:
            before: (n,) scans.
            after: (n,) the others.
            guesses: (n, 3) how these lie to the first; they stay so where two do not match.
        """
        T_before_after = guesses.copy()
        for row, (first, second) in enumerate(zip(before.tolist(), after.tolist(), strict=True)):
            reference = self.judge.prepare([self.log.scan(first)], np.zeros((1, 3)))
            found = self.judge.match(reference, self.log.scan(second), guesses[row], self.config.step.covariance)
            if not isinstance(found, NoMatch):
                T_before_after[row] = found.T_ref_cur
        return self._changes_by(before, after, T_before_after)

    def _changes_along(self, first: Ints, poses: Floats, n_steps: int = 1) -> Floats:
        """The same along (n_scans, 3) poses of the robot, from (n,) scans over so many steps."""
        after = first + n_steps
        return self._changes_by(first, after, between(poses[first], poses[after]))

    def _changes_by(self, before: Ints, after: Ints, T_before_after: Floats) -> Floats:
        """The same from (n,) scans to others that lie to them so, (n, 3)."""
        mount = self.log.geometry.T_robot_laser
        T_laser = compose(T_before_after, mount)
        changes = np.empty(len(before))
        for some in (slice(start, start + _TOGETHER) for start in range(0, len(before), _TOGETHER)):
            forth = self._compared(after[some], before[some], between(mount, T_laser[some]))
            back = self._compared(before[some], after[some], between(T_laser[some], mount))
            agreeing, compared = forth[0] + back[0], forth[1] + back[1]
            is_enough = np.maximum(forth[1], back[1]) >= self.config.min_compared
            is_blind = np.minimum(forth[1], back[1]) == 0
            changes[some] = np.where(is_enough & ~is_blind, 1.0 - agreeing / np.maximum(compared, 1), np.nan)
        return changes

    def _compared(self, seen: Ints, by: Ints, T_by_seen: Floats) -> tuple[Ints, Ints]:
        """How many ends of beams of scans lie where other scans see something, and how many of all these do.

        Args:
            seen: (n,) scans whose ends of beams are looked at …
            by: (n,) … by others.
            T_by_seen: (n, 3) pose of the laser then, seen from the laser of the others.

        Returns:
            (n,) agreeing, (n,) compared. A beam without return sees nothing where another ends.
        """
        geometry = self.log.geometry
        bearings, ranges = geometry.bearings, self.log.ranges[by].astype(np.float64)
        far = self.log.ranges[seen, :: self._every].astype(np.float64)[..., None]
        ends = np.moveaxis(transform_points(T_by_seen[:, None], far * self._directions), -1, 0)
        distance = np.sqrt(ends[0] ** 2 + ends[1] ** 2)
        angle = (arctan2(ends[1], ends[0]) - bearings[0]) % (2.0 * np.pi)
        beam = np.searchsorted(bearings - bearings[0], angle)  # the first beam past it; past the last, in the gap
        neighbours = (beam[..., None] + np.arange(-2, 2)) % len(bearings)
        is_gap = (beam == len(bearings)) & (2.0 * np.pi - geometry.field_of_view > 2.0 * geometry.resolution)
        known = np.take_along_axis(ranges[:, None, :], neighbours, axis=-1)
        is_known = np.isfinite(known)
        allowed = self.config.distance + self.config.share * distance
        nearest = np.where(is_known, known, np.inf).min(axis=-1) - allowed
        farthest = np.where(is_known, known, -np.inf).max(axis=-1) + allowed
        is_compared = np.isfinite(distance) & ~is_gap
        agrees = is_compared & (distance >= nearest) & (distance <= farthest)
        return np.count_nonzero(agrees, axis=-1), np.count_nonzero(is_compared, axis=-1)

    @cached_property
    def _directions(self) -> Floats:
        """(n, 2) of the beams that are looked at, in the laser's frame."""
        return replace(self.log.geometry, T_robot_laser=np.zeros(3)).directions_robot[:: self._every]

    @property
    def _every(self) -> int:
        """From one beam that is looked at to the next."""
        return -(-self.log.geometry.n_beams // self.config.most_beams)

    @cached_property
    def _T_track_robot(self) -> Floats:
        """(n_scans, 3) where tracking has the robot."""
        return self.track.trajectory(self.track.T_track_keys)


def judged_by_view(
    failures: Mapping[int, TrackingFailure], settled: Collection[int], views: ViewChanges, config: TrackingFailureConfig
) -> dict[int, TrackingFailure]:
    """The failures with how probable it is that the robot was carried at each; where it is, all is lost.

    New ground matches nothing that is known either: who comes upon it by odometry is not lost, unless the view changed
    at once. A failure at which it did is put there: key scans that still match something, if not well, may lie between.

    Args:
        failures: by key pose.
        settled: the key poses of those that closures have settled. They are asked only where most of the view is new:
            who is carried into one of many aisles closes loops with the wrong one. The others tell how often tracking
            fails for other causes.
        views: of the path.
        config: what contradicts odometry.
    """
    told = {key: failure for key, failure in failures.items() if key > 0}
    gate, factors = chi2_gate(config.false_alarm), dict[int, float]()
    for key, failure in told.items():
        steps = views.steps(key, views.config.keys)
        if key in settled and not views.is_mostly_new(steps):
            continue
        seen = views.bayes_factor(steps)
        if seen is not None:
            factors[key] = seen * failure.contradiction(gate, views.config)
    log_odds = _log_odds_carried(told, factors, views.config)
    unseen = views.track.keys_without_odometry() if views.log.has_odometry else told.keys()
    judged = {
        key: _judged(replace(failure, log_odds_carried=log_odds.get(key)), has_odometry=key not in unseen)
        for key, failure in told.items()
    }
    found: dict[int, TrackingFailure] = {}
    for key, failure in judged.items():
        at, scan = key, None
        if failure.is_carried:
            at, scan = views.after_largest(views.steps(key, views.config.keys))
        if at not in found or failure.rank > found[at].rank:
            found[at] = replace(failure, scan=scan)
    return found


def _log_odds_carried(
    failures: Mapping[int, TrackingFailure], factors: Mapping[int, float], config: ViewChangeConfig
) -> dict[int, float]:
    """How many times as probable it is that the robot was carried as that it was not, the logarithm.

    That it was carried where tracking fails is as probable as the settings say. Failures of other causes come at a rate
    of which the log itself tells (gamma distributed beforehand): where there are many, one more says little. Those at
    which it was carried, too, are none of them.

    Args:
        failures: by key pose.
        factors: Bayes factors of what was seen at them, where that is known.
        config: how probable it is before anything is seen.
    """
    counted = {key: float(failure.kind > FailureKind.LOW_INLIER_RATIO) for key, failure in failures.items()}
    weights, odds = dict(counted), dict[int, float]()
    for _ in range(_ROUNDS):
        total = sum(weights.values())
        odds = {
            key: config.carried_prior * factor / (total - weights[key] + config.usual_failures)
            for key, factor in factors.items()
        }
        weights |= {key: counted[key] / (1.0 + ratio) for key, ratio in odds.items()}
    return {key: math.log(ratio) for key, ratio in odds.items()}


def _judged(failure: TrackingFailure, *, has_odometry: bool) -> TrackingFailure:
    """A failure at which the robot was carried is a loss, whatever matched; by odometry nothing else is."""
    if failure.is_carried and failure.kind > FailureKind.LOW_INLIER_RATIO and not failure.is_lost:
        reason = f"what the laser sees changed at once, and {failure.reason}"
        return replace(failure, kind=FailureKind.TRACKING_LOSS, reason=reason)
    return failure.by_odometry() if has_odometry else failure

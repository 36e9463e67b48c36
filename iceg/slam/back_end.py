"""The back end: key poses, odometry, matches and loop closures in one graph, solved as it grows."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats
from graph.config import PoseGraphConfig
from graph.consistency import maximum_clique
from graph.growing_rows import GrowingRows
from graph.measurement import NoMatch, RelativePose
from graph.noise import chi2_gate, largest_squared_norm, squared_norm
from graph.odometry import OdometryMotion
from graph.pose_graph import PoseGraph
from graph.se2 import between, compose, logmap, wrap_angle
from iceg.slam.agreement import is_small
from iceg.slam.broken_path.bridge_edges import closures_across, settled
from iceg.slam.broken_path.conflicts import with_conflicts
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.broken_path.place_votes import PlaceVotes, Vote, unsettled
from iceg.slam.broken_path.relocalisation import relocalise
from iceg.slam.broken_path.view_change import ViewChanges, judged_by_view
from iceg.slam.closures.attempt import Attempt, are_consistent, closure_factor
from iceg.slam.drift import Drift
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution
from iceg.slam.track import Track


class BackEnd:
    """Adds one key scan after the other to the graph and looks for places seen before.

    The graph is solved when a closure enters: until then the path from the last one is the chain of its steps.
    """

    def __init__(self, closer: LoopCloser, graph_config: PoseGraphConfig) -> None:
        self._track = closer.track
        self._closer = closer
        self._config = closer.config
        self.graph = PoseGraph(graph_config)
        self.graph.add_first_pose(np.zeros(3))
        self._poses: GrowingRows[np.float64] = GrowingRows((3,), np.float64)
        self._poses.append(np.zeros(3))
        self.attempts: list[Attempt] = []
        self.n_closed = 0
        self.failures = _front_end_failures(closer.track)
        self._jumps: list[int] = []  # key poses whose match contradicts odometry
        self._pending: list[int] = []  # accepted by the matcher, far from the estimate: indices into attempts
        self._votes = PlaceVotes(closer.config)
        self._unclear: list[Vote] = []
        self._since_search = np.zeros(2)
        self._searched_to = 0
        self._is_confirmed = False
        self._closures_waiting = 0
        self._drift = Drift()

    def add(self, key: int, motion: OdometryMotion | None) -> None:
        """Add one key pose with its odometry and its match, then look for loops.

        Args:
            key: index of the key scan, the next one.
            motion: calibrated odometry since the previous one, None in a log without odometry.
        """
        self.extend(key, motion)
        for _ in self.search(key):
            pass

    def extend(self, key: int, motion: OdometryMotion | None) -> None:
        """As `add`, but look for no loops."""
        previous, current = self._track.keys[key - 1], self._track.keys[key]
        step = between(previous.T_track_robot, current.T_track_robot)
        self._poses.append(compose(self.poses[-1], step))
        self.graph.add_pose(self.poses[-1])
        known, searched = [], []
        match = None if isinstance(current.match, NoMatch) else current.match
        if motion is not None:
            covariance = motion.covariance if match is None else self._believed(motion, match, key)
            self.graph.add_odometry(key - 1, key, motion.T_key_robot, covariance)
            known.append(covariance)
            searched.append(covariance * self._config.odometry_inflation**2)
        if match is not None:
            self.graph.add_match(current.anchor, key, match)
            known.append(match.covariance)
            searched.append(match.covariance)
        if not known:
            unknown = self._config.failures.unknown.covariance
            self.graph.add_odometry(key - 1, key, step, unknown)
            known, searched = [unknown], [unknown]
        self._drift.add(tuple(known), tuple(searched))

    @property
    def poses(self) -> Floats:
        """(n, 3) T_map_robot of all key poses so far."""
        return self._poses.rows

    def _believed(self, motion: OdometryMotion, match: RelativePose, key: int) -> Floats:
        """Covariance of odometry; widened to what chance explains where the match contradicts it, as after a slip.

        The match has been found the better explanation, and two that claim to be known so well would meet halfway,
        where neither is.
        """
        keys = self._track.keys
        T_track_match = compose(keys[keys[key].anchor].T_track_robot, match.T_ref_cur)
        offset = between(between(keys[key - 1].T_track_robot, T_track_match), motion.T_key_robot)
        distance2 = squared_norm(logmap(offset), match.covariance + motion.covariance)
        far = math.hypot(offset[0], offset[1])
        config = self._config.failures
        gate = chi2_gate(config.false_alarm)
        if distance2 > gate or far > config.carried * max(1.0, motion.distance):
            turned = np.degrees(abs(offset[2]))
            reason = f"the match lies {far:.2f} m and {turned:.0f}° from where the robot was expected"
            self.failures.setdefault(
                key, TrackingFailure(kind=FailureKind.INCONSISTENT, reason=reason, distance2=distance2)
            )
        if distance2 > gate:
            self._jumps.append(key)
        return motion.covariance * max(1.0, distance2 / gate)

    def solution(self) -> Solution:
        """The graph as it stands, a copy; closures that still wait for others to say the same are no part of it."""
        attempts = self.attempts.copy()
        for index in self._pending:
            attempts[index] = attempts[index].judged(self._why_pending(attempts[index]))
        return Solution(
            factors=list(self.graph.factors),
            poses=self.graph.all_poses(),
            attempts=attempts,
            searchable=self._closer.passes.searchable.copy(),
            odometry_jumps=tuple(self._jumps),
            ambiguous=unsettled(self._unclear, attempts),
        )

    def _why_pending(self, attempt: Attempt) -> str:
        """Why an attempt that matched is not in the graph."""
        unclear = [vote for vote in self._unclear if vote.first <= attempt.key_new <= vote.last]
        if not unclear:
            return "alone and far off"
        return f"perceptual aliasing, {unclear[0].count} key scans fit one place and {unclear[0].rival} another"

    def search(self, key: int) -> Iterator[None]:
        """Look for loops at the key pose next to the last one asked for, if that is due; pauses after each match.

        Later key poses may be in the graph already: they move along.
        """
        motion, config = self._track.keys[key].motion, self._config
        self._since_search += (motion.distance, motion.turn)
        seldom = config.confirmed.spacing if self._is_confirmed else 1.0
        if (self._since_search / seldom > (config.spacing, config.spacing_angle)).any():
            yield from self._search(key)

    def _search(self, key: int) -> Iterator[None]:
        self._since_search[:] = 0.0
        poses = self.poses[: key + 1]
        first = len(self.attempts)
        for candidate in self._closer.candidates(key, poses, self._drift):
            attempt = self._closer.match(candidate, poses)
            if candidate.deviations[0] > self._config.verification.uncertain_distance:
                self._votes.add(attempt)
            self.attempts.append(self._judge(attempt, poses) if attempt.accepted else attempt)
            yield
        found = [k for k, a in enumerate(self.attempts[first:], first) if a.accepted or a.is_ambiguous]
        closed = [self.attempts[index] for index in found if self._insert(index, poses)]
        offsets = [_offset(attempt, poses) for attempt in closed]
        confirmed = self._config.confirmed
        self._is_confirmed = sum(is_small(offset, confirmed.confirming) for offset in offsets) >= confirmed.passes
        if self._is_confirmed:
            self._closer.passes.searchable[self._searched_to + 1 : key + 1] = False
        if closed:
            self._correct(key, np.mean(offsets, axis=0))
            if any(attempt.match is not None and attempt.match.is_fully_observed for attempt in closed):
                self._drift.close(key)  # along what no closure holds the path goes on drifting
        self._searched_to = key

    def _correct(self, key: int, offset: Floats) -> None:
        """Bend the path since the last search by what closures say; where that is much, move all poses.

        In a confirmed area the others need not move: later searches look at the earlier passes. So the cost of a
        closure does not grow with the run.
        """
        if not self._is_confirmed:
            self._closures_waiting += 1
            confirmed = self._config.confirmed
            if not is_small(offset, confirmed.small) or self._closures_waiting >= confirmed.max_waiting:
                self.poses[:] = self.graph.all_poses()
                self._closures_waiting = 0
                return
        self._bend(key, offset)

    def _bend(self, key: int, offset: Floats) -> None:
        """Move a pose, those since the last search in proportion to the steps, and later ones along with it."""
        first, poses = self._searched_to, self.poses
        share = (np.arange(first + 1, key + 1) - first) / (key - first)
        T_key_later = between(poses[key], poses[key + 1 :])
        move = compose(poses[key], offset) - poses[key]
        move[2] = offset[2]
        bent = poses[first + 1 : key + 1] + share[:, None] * move
        bent[:, 2] = wrap_angle(bent[:, 2])
        poses[first + 1 : key + 1] = bent
        poses[key + 1 :] = compose(poses[key], T_key_later)

    def _judge(self, attempt: Attempt, poses: Floats) -> Attempt:
        """Refuse a closure that the path cannot explain: most likely it is a similar place (perceptual aliasing).

        The steps since the last closure bound the path's covariance from below; only what they do not explain asks the
        graph for all of it.
        """
        assert attempt.match is not None
        i, j, most = attempt.key_old, attempt.key_new, largest_squared_norm(self._config.path_probability)
        offset = logmap(_offset(attempt, poses))
        squared = squared_norm(offset, self._drift.covariance(i, j, poses) + attempt.match.covariance)
        if squared > most:
            squared = squared_norm(offset, self.graph.relative_covariance(i, j) + attempt.match.covariance)
        attempt = replace(attempt, off_path=math.sqrt(squared))
        return attempt if squared <= most else attempt.judged(f"{attempt.off_path:.1f} sigma off the path")

    def _insert(self, index: int, poses: Floats) -> bool:
        """Insert a closure near the estimate at once; one far off waits for others that say the same.

        After much drift neither enters while another place fits as well.
        """
        attempt = self.attempts[index]
        vote = self._votes.of(attempt, poses) if attempt.places else None
        is_strong = vote is not None and vote.is_strong(self._config.votes)
        is_clear = vote is None or (is_strong if attempt.is_ambiguous else vote.is_clear)
        if attempt.is_near(poses, self._config.verification.near) and is_clear:
            self._close(index)
            return True
        waiting = [other for other in self._pending if self._agree(self.attempts[other], attempt, poses)]
        partners = [other for other in self._consistent(waiting, poses) if self.attempts[other].accepted or is_strong]
        if len(partners) + 1 < self._config.confirmations or not is_clear:
            self._pending.append(index)
            if vote is not None and not vote.is_clear and vote.count >= self._config.confirmations:
                self._note_unclear(vote)
            return False
        for other in partners:
            self._close(other)
            self._pending.remove(other)
        self._close(index)
        return True

    def _note_unclear(self, vote: Vote) -> None:
        """Keep the strongest of the votes that are not clear along one part of the path."""
        if self._unclear and vote.first <= self._unclear[-1].last + self._config.verification.partner_keys:
            last = self._unclear.pop()
            vote = replace(max(last, vote, key=lambda v: v.count), first=last.first, last=vote.last)
        self._unclear.append(vote)

    def _consistent(self, waiting: list[int], poses: Floats) -> list[int]:
        """The most attempts of which each agrees with every other; those of one key scan do not contradict."""
        attempts = [self.attempts[index] for index in waiting]
        agree = [[a.key_new == b.key_new or self._agree(a, b, poses) for a in attempts] for b in attempts]
        members = maximum_clique(np.array(agree, dtype=np.bool_).reshape(len(waiting), len(waiting)))
        return [index for index, is_member in zip(waiting, members, strict=True) if is_member]

    def _agree(self, a: Attempt, b: Attempt, poses: Floats) -> bool:
        return are_consistent(a, b, poses, self._config.verification)

    def _close(self, index: int) -> None:
        """Let an attempt into the graph; one that fitted elsewhere, too, if its neighbours did not."""
        attempt = self.attempts[index]
        if not attempt.accepted:
            attempt = self.attempts[index] = attempt.judged("here its neighbours fit best", accepted=True)
        self.n_closed += 1
        self.graph.add(closure_factor(attempt))


def _offset(attempt: Attempt, poses: Floats) -> Floats:
    """(3,) where a closure puts the later pose, seen from where it is."""
    assert attempt.match is not None
    return between(between(poses[attempt.key_old], poses[attempt.key_new]), attempt.match.T_ref_cur)


def solve_track(
    closer: LoopCloser,
    motions: Sequence[OdometryMotion | None],
    graph_config: PoseGraphConfig,
    log: Log | None = None,
) -> Solution:
    """Build and solve the graph of a whole track.

    Args:
        closer: looks for loops in the track; its settings say how.
        motions: to every key scan but the first, None where nothing but the matches tells of it.
        graph_config: how the graph is solved.
        log: all scans, which tell whether the robot was carried where tracking fails; None where they are not at hand.

    Returns:
        The solved graph.
    """
    track, closures = closer.track, closer.config
    back_end = BackEnd(closer, graph_config)
    for key, motion in enumerate(motions, start=1):
        back_end.add(key, motion)
    solution = back_end.solution()
    if log is None:
        return relocalise(closer, solution, back_end.failures)[0]
    across = closures_across(solution.factors, len(track.keys), closures)
    views = ViewChanges(log, track, closer.judge, closures.view)
    known = settled(back_end.failures, across, closures.failures)
    failures = judged_by_view(back_end.failures, known, views, closures.failures)
    relocalised, judged = relocalise(closer, solution, failures)
    return with_conflicts(relocalised, track, judged, closures)


def _front_end_failures(track: Track) -> dict[int, TrackingFailure]:
    """Key poses whose scans matched nothing that was known."""
    lost, unknown_motion = set(track.lost), set(track.unknown_motion)
    jumps = np.searchsorted([scan.index for scan in track.keys], track.breaks).tolist()
    failures = {
        key: TrackingFailure(kind=FailureKind.NO_MATCH, reason="the odometry jumped, and the laser did not see it")
        for key in jumps
        if key < len(track.keys)
    }
    for key, scan in enumerate(track.keys):
        if scan.index in lost:
            failures[key] = TrackingFailure(
                kind=FailureKind.TRACKING_LOSS, reason="nothing matched what was known before"
            )
        elif scan.index in unknown_motion:
            failures[key] = TrackingFailure(
                kind=FailureKind.UNKNOWN_MOTION, reason="neither odometry nor laser told the way there"
            )
        elif key not in failures and isinstance(scan.match, NoMatch):
            failures[key] = TrackingFailure(kind=FailureKind.NO_MATCH, reason=scan.match.reason)
    return failures

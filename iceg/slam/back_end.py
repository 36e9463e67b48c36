"""The back end: key poses, odometry, matches and loop closures in one graph, solved as it grows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.matcher import Matcher
from graph.config import PoseGraphConfig
from graph.factors import RobustKernel
from graph.measurement import NoMatch
from graph.odometry import OdometryModel, OdometryMotion
from graph.pose_graph import PoseGraph
from graph.se2 import between, compose
from iceg.slam.config import LoopClosureConfig
from iceg.slam.loop_closure import Attempt, LoopCloser
from iceg.slam.track import Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The solved graph.

    Attributes:
        graph: every factor once, solved by iSAM2.
        poses: (k, 3) T_map_robot of the key poses.
        attempts: every loop closure that was tried.
    """

    graph: PoseGraph
    poses: NDArray[np.float64]
    attempts: list[Attempt]


class BackEnd:
    """Adds one key scan after the other to the graph and looks for places seen before."""

    def __init__(
        self, track: Track, matcher: Matcher, graph_config: PoseGraphConfig, closures: LoopClosureConfig
    ) -> None:
        self._track = track
        self._config = closures
        self._closer = LoopCloser(matcher, track.keys, closures)
        self._kernel = RobustKernel(name="dcs", width=closures.kernel_width)
        self.graph = PoseGraph(graph_config)
        self.graph.add_first_pose(np.zeros(3))
        self._poses = np.zeros((len(track.keys), 3))
        self.attempts: list[Attempt] = []
        self._since_search = np.zeros(2)
        self._since_closure = 0.0

    def add(self, key: int, motion: OdometryMotion | None) -> None:
        """Add one key pose with its odometry and its match, then look for loops.

        Args:
            key: index of the key scan, the next one.
            motion: calibrated odometry since the previous one, None in a log without odometry.
        """
        previous, current = self._track.keys[key - 1], self._track.keys[key]
        step = between(previous.T_track_robot, current.T_track_robot)
        self._poses[key] = compose(self._poses[key - 1], step)
        self.graph.add_pose(self._poses[key])
        if motion is not None:
            self.graph.add_odometry(key - 1, key, motion.T_key_robot, motion.covariance)
        if not isinstance(current.match, NoMatch):
            self.graph.add_match(key - 1, key, current.match)
        elif motion is None:
            self.graph.add_odometry(key - 1, key, step, _UNKNOWN_MOTION)
        self._poses[key] = self.graph.update()
        self._since_search += (current.motion.distance, current.motion.turn)
        self._since_closure += current.motion.distance
        if self._config.enabled and self._is_search_due():
            self._search(key)

    def solution(self) -> Solution:
        """The graph as it stands."""
        return Solution(graph=self.graph, poses=self.graph.all_poses(), attempts=self.attempts)

    def _is_search_due(self) -> bool:
        return bool(self._since_search[0] > self._config.spacing or self._since_search[1] > self._config.spacing_angle)

    def _search(self, key: int) -> None:
        self._since_search[:] = 0.0
        known = self._poses[: key + 1]
        attempts = [
            self._closer.match(candidate, key, known)
            for candidate in self._closer.candidates(key, known, self._drift())
        ]
        self.attempts += attempts
        accepted = [attempt for attempt in attempts if attempt.accepted and attempt.match is not None]
        for attempt in accepted:
            assert attempt.match is not None
            self.graph.add_closure(attempt.key_old, key, attempt.match, self._kernel)
        if accepted:
            self.graph.update()
            self._poses[: key + 1] = self.graph.all_poses()
            self._since_closure = 0.0

    def _drift(self) -> NDArray[np.float64]:
        """Standard deviations of the newest pose relative to earlier passes, grown since the last closure."""
        config = self._config
        position = min(config.max_drift, config.drift_floor + config.drift_per_metre * self._since_closure)
        heading = min(config.max_turn, config.turn_floor + config.turn_per_metre * self._since_closure)
        return np.array([position, position, heading])


_UNKNOWN_MOTION = np.diag([0.25, 0.25, 0.25])


def solve_track(
    track: Track,
    odometry: NDArray[np.float64] | None,
    noise: OdometryModel,
    matcher: Matcher,
    graph_config: PoseGraphConfig,
    closures: LoopClosureConfig,
) -> Solution:
    """Build and solve the graph of a whole track.

    Args:
        track: what the front end found.
        odometry: (n_scans, 3) calibrated odometry, None in a log without.
        noise: what the calibration left.
        matcher: for loop closures.
        graph_config: how the graph is solved.
        closures: how loops are found.

    Returns:
        The solved graph.
    """
    back_end = BackEnd(track, matcher, graph_config, closures)
    steps = None if odometry is None else between(odometry[:-1], odometry[1:])
    for key in range(1, len(track.keys)):
        motion = None if steps is None else _motion(track, key, steps, noise)
        back_end.add(key, motion)
    return back_end.solution()


def _motion(track: Track, key: int, steps: NDArray[np.float64], noise: OdometryModel) -> OdometryMotion:
    motion = noise.start()
    for step in steps[track.keys[key - 1].index : track.keys[key].index]:
        motion = noise.extend(motion, step)
    return motion

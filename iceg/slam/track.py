"""What the front end hands over: key scans, and every other scan tied to one."""

from dataclasses import dataclass, field

import numpy as np

from frontends.scan import Scan
from graph.arrays import Floats, Ints
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryMotion
from graph.se2 import compose
from graph.short_repr import short_repr

SEES_TOO_LITTLE = NoMatch(reason="contradicts odometry, and observes next to nothing")
FEW_SEE = NoMatch(reason="contradicts odometry, and few beams return")
"""What becomes of a match that is not believed against odometry."""

UNKNOWN_STEP = np.diag([100.0, 100.0, np.pi]) ** 2
"""Covariance of a step of which nothing is known, as one on which the robot was carried [m², rad²]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyScan:
    """A scan that became a node of the graph.

    Attributes:
        index: which scan of the log it is.
        scan: the scan.
        motion: odometry since the previous key scan.
        match: of this scan in the frame of key scan `anchor`, no surer than how that lies to what holds it; or why
            there is none.
        anchor: index of the newest key scan in the reference it was matched against.
        T_track_robot: (3,) its pose in the front end's own frame.
    """

    index: int
    scan: Scan
    motion: OdometryMotion
    match: RelativePose | NoMatch
    anchor: int
    T_track_robot: Floats

    __repr__ = short_repr

    @property
    def is_fully_observed(self) -> bool:
        """Whether its match sees all directions."""
        return isinstance(self.match, RelativePose) and self.match.is_fully_observed


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """What the front end knows after a log.

    Attributes:
        keys: the key scans in order.
        key_of_scan: (n_scans,) index into `keys` of the key scan each scan is tied to.
        T_key_scan: (n_scans, 3) pose of each scan in the frame of its key scan.
        failures: scans without a credible match, carried by odometry.
        lost: scans from which on nothing matched what was known, so that a new local reference was begun.
        breaks: scans before which the odometry jumped, and the robot did not.
        unknown_motion: key scans reached by a motion that neither odometry nor a match has seen.
        dead: first and last scans of the intervals over which the odometry stood still, and the robot did not.
        match_covariance_scale: factor of the matcher's variances that this log asks for; the matches of `keys` have it.
    """

    keys: list[KeyScan]
    key_of_scan: Ints
    T_key_scan: Floats
    failures: int
    lost: list[int]
    breaks: list[int] = field(default_factory=list)
    unknown_motion: list[int] = field(default_factory=list)
    dead: list[tuple[int, int]] = field(default_factory=list)
    match_covariance_scale: float = 1.0

    __repr__ = short_repr

    @property
    def key_scans(self) -> Ints:
        """(k,) which scans of the log the key scans are."""
        return np.array([key.index for key in self.keys], dtype=np.int64)

    @property
    def T_track_keys(self) -> Floats:
        """(k, 3) poses of the key scans in the front end's own frame."""
        return np.array([key.T_track_robot for key in self.keys])

    @property
    def path(self) -> Floats:
        """(k,) how far the robot had driven by odometry at each key scan [m]."""
        return np.cumsum([key.motion.distance for key in self.keys])

    @property
    def T_track_scans(self) -> Floats:
        """(n_scans, 3) poses of all scans in the front end's own frame."""
        return self.trajectory(self.T_track_keys)

    def trajectory(self, key_poses: Floats) -> Floats:
        """(n_scans, 3) pose of every scan, given the (k, 3) poses of the key scans."""
        return compose(key_poses[self.key_of_scan], self.T_key_scan)

    def keys_without_odometry(self) -> set[int]:
        """Indices into `keys` of those whose way from the one before the odometry does not know."""
        unknown = set(np.searchsorted(self.key_scans, self.breaks).tolist())
        for interval in self.dead:
            first, last = np.searchsorted(self.key_scans, np.add(interval, 1)).tolist()
            unknown.update(range(first, last + 1))
        return unknown

    def keys_left_to_velocity(self) -> set[int]:
        """Those of them in a log whose odometry is dead somewhere; else all, as in a log without odometry."""
        return self.keys_without_odometry() if self.dead else set(range(len(self.keys)))

"""Which transform ties a recording to the map of a run (REP 105): map → odom, or where there is no odom, map → base."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from frontends.bags.assembly import BagOptions, choose
from frontends.bags.frame_motion import poses_in_root, root_of
from frontends.bags.frames import Frames
from frontends.bags.records import Records
from frontends.bags.sources import last_word
from frontends.scan import Log
from graph.se2 import compose, inverse

_MAP = "map"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MapTransform:
    """Where the root of the recording's frames is in the map.

    Attributes:
        map_frame: name of the map's frame.
        root: the frame given in it.
        stamps: (n,) of the middle of each scan [s].
        T_map_root: (n, 3) then.
        behind: by how much the recording lags behind the stamps [s].
        notes: what a person should know.
    """

    map_frame: str
    root: str
    stamps: NDArray[np.float64]
    T_map_root: NDArray[np.float64]
    behind: float
    notes: tuple[str, ...]


def map_transform(T_map_robot: NDArray[np.float64], log: Log, records: Records, options: BagOptions) -> MapTransform:
    """The transform that puts the robot's frame where a run has found it, whatever carries it meanwhile.

    Args:
        T_map_robot: (n, 3) poses of the run.
        log: its scans.
        records: of the bag that the log is of.
        options: as the run has read it.

    Raises:
        BagError: what the options name is not there.
    """
    chosen = choose(records, options)
    root = root_of(chosen.base, chosen.frames)
    T_root_robot, notes = poses_in_root(chosen.base, root, records, chosen.frames, chosen.times, log.stamps)
    if chosen.times.are_recorded:
        notes.append("the scans bear no stamps of use: the transforms hold at the times of recording")
    return MapTransform(
        map_frame=_map_frame(root, chosen.frames),
        root=root,
        stamps=log.stamps,
        T_map_root=compose(T_map_robot, inverse(T_root_robot)),
        behind=chosen.times.behind,
        notes=tuple(notes),
    )


def _map_frame(root: str, frames: Frames) -> str:
    """The map's frame as the recording calls it, if it has one."""
    return next((name for name in frames.above(root)[1:] if last_word(name) == _MAP), _MAP)

"""Where odometry comes from: a topic, the transforms, or nowhere."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from frontends.bags import messages
from frontends.bags.errors import BagError
from frontends.bags.frames import Frames
from frontends.bags.records import Laser, PoseSource, Records, Rows
from frontends.bags.rigid import planar_poses
from frontends.bags.sources import is_estimate, is_fixed_frame, is_odometry, is_odometry_frame, is_truth, last_word
from frontends.bags.times import ScanTimes, covered, pose_times
from frontends.pose_samples import poses_at

_MOVED = 1e-6  # m or rad
_MOST_SCANS = 0.5
"""A source that tells of fewer of the scans is not offered as odometry: it may be a goal, or a place to begin from."""
_WHOLE = 0.9
"""A source that tells of so many of the scans tells of the whole recording."""


@dataclass(frozen=True, kw_only=True)
class PosesOfScans:
    """Poses of one source at the scans.

    Attributes:
        poses: (n, 3) of the frame `child`.
        child: the frame whose pose they are; empty where nothing says.
        reason: where they come from, for a person.
        share: of the scans that lie within what the source tells of.
        moves: whether they move at all.
        warnings: what is odd about them.
    """

    poses: NDArray[np.float64]
    child: str
    reason: str
    share: float
    moves: bool
    warnings: tuple[str, ...] = ()


def choose_odometry(
    records: Records, frames: Frames, laser: Laser, times: ScanTimes, stamps: NDArray[np.float64], topic: str | None
) -> tuple[PosesOfScans | None, tuple[str, ...]]:
    """Find the robot's own odometry at the scans.

    Args:
        records: what the bag holds.
        frames: its tree.
        laser: of the robot; where the bag holds several robots, the others carry another.
        times: of the scans, as their messages state them.
        stamps: (n,) the times odometry is wanted at [s].
        topic: the topic to take, whatever it is; None to choose.

    Returns:
        The odometry, None where there is none; and what else there was, a sentence each.

    Raises:
        BagError: there are no poses on the topic.
    """
    if topic is not None:
        return _at_scans(*_asked_for(records, topic), times, stamps), ()
    candidates = _candidates(records, frames, laser)
    found = [_at_scans(name, child, rows, times, stamps) for name, child, rows in candidates]
    if not found:
        return None, (*_why_none(records), *_may_be_asked_for(records, times, stamps))
    best = max(found, key=lambda source: (source.moves and source.share > 0.0, min(source.share, _WHOLE)))
    if not best.share:
        return None, (f"{best.reason} tells of no scan: its stamps lie elsewhere",)
    return best, ()


def choose_truth(records: Records, times: ScanTimes, stamps: NDArray[np.float64]) -> PosesOfScans | None:
    """The true poses at the scans, where a topic's name says that it holds them and it tells of nearly all scans."""
    found = [
        _at_scans(f"{source.topic} ({_kind(source)})", source.child, rows, times, stamps)
        for source, rows in records.poses.items()
        if is_truth(source)
    ]
    return max(found, key=lambda source: (source.moves, source.share), default=None)


def _candidates(records: Records, frames: Frames, laser: Laser) -> Iterator[tuple[str, str, Rows]]:
    """Name, child frame and poses of what may be odometry, best first: of several robots the laser's own."""

    def rank(source: PoseSource) -> tuple[bool, int, bool, str]:
        is_of_another = bool(source.child) and frames.between(source.child, laser.frame) is None
        return is_of_another, -_n_shared(source.topic, laser.topic), last_word(source.topic) != "odom", source.topic

    for source in sorted(filter(is_odometry, records.poses), key=rank):
        yield f"{source.topic} (Odometry)", source.child, records.poses[source]
    chain = frames.above(laser.frame)
    for (parent, child), rows in sorted(records.transforms.items(), key=lambda entry: entry[0][1] not in chain):
        if is_odometry_frame(parent) and child in {*chain, *_bases(records.transforms)} and len(rows) > 1:
            yield f"the transform {parent} → {child}", child, rows


def _n_shared(topic: str, other: str) -> int:
    """How many words two topics begin with, both."""
    words = zip(topic.strip("/").split("/"), other.strip("/").split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], words))


def _bases(transforms: Mapping[tuple[str, str], Rows]) -> set[str]:
    return {child for _, child in transforms if last_word(child).startswith("base")}


def _asked_for(records: Records, topic: str) -> tuple[str, str, Rows]:
    for source, rows in records.poses.items():
        if source.topic.strip("/") == topic.strip("/"):
            return f"{source.topic} ({_kind(source)}), as asked for", source.child, rows
    present = ", ".join(dict.fromkeys(source.topic for source in records.poses)) or "none at all"
    raise BagError(f"no poses are on the topic '{topic}': expected one of {present}")


def _at_scans(name: str, child: str, rows: Rows, times: ScanTimes, stamps: NDArray[np.float64]) -> PosesOfScans:
    source_times, warnings = pose_times(rows.stamps, rows.recorded, times)
    planar = planar_poses(rows.values)
    within = covered(source_times, stamps)
    if not within.all() and within.any():
        early, late = int(np.argmax(within)), int(np.argmax(within[::-1]))
        warnings += [
            f"it {what} {n} scans {where}: for them it stays as it is"
            for n, what, where in ((early, "begins", "late"), (late, "ends", "early"))
            if n
        ]
    return PosesOfScans(
        poses=poses_at(source_times, planar, stamps),
        child=child,
        reason=f"{name}, {_rate(source_times)}",
        share=float(within.mean()),
        moves=bool(np.ptp(planar, axis=0).max() > _MOVED),
        warnings=tuple(f"{name}: {warning}" for warning in warnings),
    )


def _rate(times: NDArray[np.float64]) -> str:
    span = float(np.ptp(times))
    return f"{len(times)} poses" + (f", {(len(times) - 1) / span:.1f} Hz" if span > 0.0 else "")


def _kind(source: PoseSource) -> str:
    return source.type.rsplit("/", 1)[-1]


def _may_be_asked_for(records: Records, times: ScanTimes, stamps: NDArray[np.float64]) -> Iterator[str]:
    """Topics of poses whose type and name do not say what they are of, if they move while the laser scans."""
    for source, rows in sorted(records.poses.items()):
        if source.type != messages.ODOMETRY and not is_truth(source) and not is_estimate(source):
            found = _at_scans(source.topic, source.child, rows, times, stamps)
            if found.moves and found.share >= _MOST_SCANS:
                yield f"{source.topic} ({_kind(source)}) is, if asked for: --log.odometry-topic {source.topic}"


def _why_none(records: Records) -> tuple[str, ...]:
    """What there is that is no odometry."""
    others = sorted({source.topic for source in records.poses if source.type == messages.ODOMETRY})
    maps = sorted({f"{parent} → {child}" for parent, child in records.transforms if is_fixed_frame(parent)})
    return tuple(
        f"{name} is not taken for odometry: it is the truth, or another program's estimate" for name in (*others, *maps)
    )

"""Which laser of a bag is used, and why."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from frontends.bags.errors import BagError
from frontends.bags.frames import Frames
from frontends.bags.records import Laser, ScanRecords, is_called

_FEWEST = 0.5
"""A laser with fewer than this share of the scans of the one with most is not preferred for what it sees."""
_SAMPLES = 64
"""Scans of each laser that are looked at."""
_SAME = 0.9
"""Share of the scans looked at that another topic must repeat to the last bit to be the same laser again."""
_ALIKE = 1.25
"""Views and ranges that differ by less than about this factor are alike."""
_UPRIGHT = 0.7
"""Cosine of the angle up to which a laser still looks into the plane."""


@dataclass(frozen=True, kw_only=True)
class LaserChoice:
    """The laser that is used.

    Attributes:
        laser: its topic and frame.
        reason: why this one, for a person.
        warnings: what is odd about it.
    """

    laser: Laser
    reason: str
    warnings: tuple[str, ...] = ()


def choose_laser(
    scans: Mapping[Laser, ScanRecords], frames: Frames, *, topic: str | None, frame: str | None
) -> LaserChoice:
    """Pick a laser.

    Lasers that repeat another one's readings are left out first. Of the rest, the first difference counts: does it
    look into the plane, by its place or else by its name; does it have half as many scans as the one with most; is its
    place known; how wide a view returns something; how far; is its topic called scan, or front; how many scans.

    Args:
        scans: the sweeps of each.
        frames: what is known of the frames.
        topic: only lasers of this topic; None for any.
        frame: only lasers of this frame; None for any.

    Raises:
        BagError: there is no such laser.
    """
    wanted = {
        laser: records
        for laser, records in scans.items()
        if is_called(laser.topic, topic) and (frame is None or laser.frame == frame.lstrip("/"))
    }
    if not wanted:
        asked = " with ".join(
            f"{what} '{name}'" for what, name in (("the topic", topic), ("the frame", frame)) if name is not None
        )
        present = ", ".join(f"{laser.topic} in frame '{laser.frame}'" for laser in scans)
        raise BagError(f"no laser has {asked}: expected one of {present}")
    originals = [laser for laser in wanted if not any(_repeats(laser, other, wanted) for other in wanted)]
    most = max(len(wanted[laser]) for laser in originals)
    best = max(originals, key=lambda laser: _merits(laser, wanted[laser], frames, most))
    repeats = [laser.topic for laser in wanted if laser not in originals]
    return LaserChoice(laser=best, reason=_reason(best, originals, repeats, wanted), warnings=_warnings(best, wanted))


def _repeats(laser: Laser, other: Laser, scans: Mapping[Laser, ScanRecords]) -> bool:
    """Whether a topic repeats an original: the one with more scans, recorded earlier, or named before it."""
    if laser == other or _precedence(laser, scans[laser]) > _precedence(other, scans[other]):
        return False
    known = {ranges.tobytes() for ranges in scans[other].ranges}
    own = scans[laser].ranges
    looked_at = np.unique(np.linspace(0, len(own) - 1, _SAMPLES).astype(int)).tolist()
    return sum(own[k].tobytes() in known for k in looked_at) >= _SAME * len(looked_at)


def _precedence(laser: Laser, records: ScanRecords) -> tuple[float, ...]:
    return (len(records), -_lag(records), -len(laser.topic), *(-ord(letter) for letter in laser.topic + laser.frame))


def _lag(records: ScanRecords) -> float:
    """By how much the recording lags behind the stamps [s]: a copy that is stamped anew comes later, or backdated."""
    return abs(float(np.median(np.array(records.recorded) - np.array(records.stamps))))


def _merits(laser: Laser, records: ScanRecords, frames: Frames, most: int) -> tuple[float, ...]:
    view, reach = _seen(records)
    mount = _known_place(laser, frames)
    name = laser.topic.rsplit("/", 1)[-1].lower()
    return (
        not _is_called_vertical(laser) if mount is None else abs(mount) >= _UPRIGHT,
        len(records) >= _FEWEST * most,
        mount is not None,
        _grade(view),
        _grade(reach),
        name == "scan",
        "front" in laser.topic.lower() or "front" in laser.frame.lower(),
        len(records),
        -len(laser.topic),
    )


def _is_called_vertical(laser: Laser) -> bool:
    return "vertical" in f"{laser.topic} {laser.frame}".lower()


def _known_place(laser: Laser, frames: Frames) -> float | None:
    """Cosine of its tilt where something says where it sits, else None."""
    chain = frames.above(laser.frame)
    if len(chain) == 1:
        return 1.0 if "base" in laser.frame else None
    base = next((name for name in chain if "base" in name and name != laser.frame), chain[-1])
    found = frames.between(base, laser.frame)
    return None if found is None else found[0].upright


def _seen(records: ScanRecords) -> tuple[float, float]:
    """The view that returns something [rad], and the farthest that it does, of the scans looked at."""
    looked_at = np.unique(np.linspace(0, len(records) - 1, _SAMPLES).astype(int)).tolist()
    views, farthest = [], 0.0
    for k in looked_at:
        ranges, (first, last, _, _, _, low, high) = records.ranges[k], records.settings[k]
        with np.errstate(invalid="ignore"):
            hit = ranges[np.isfinite(ranges) & (ranges > max(low, 0.0)) & ((ranges < high) | (high <= 0.0))]
        views.append(abs(last - first) * len(hit) / max(1, len(ranges)))
        farthest = max(farthest, float(hit.max()) if len(hit) else 0.0)
    view = float(np.median(views))
    return (view if math.isfinite(view) else 0.0), farthest


def _grade(value: float) -> int:
    return round(math.log(max(value, 1e-3)) / math.log(_ALIKE))


def _reason(best: Laser, originals: list[Laser], repeats: list[str], scans: Mapping[Laser, ScanRecords]) -> str:
    own = f"{best.topic} in frame '{best.frame}', {len(scans[best])} scans"
    others = ", ".join(
        f"{laser.topic} in '{laser.frame}' ({_described(scans[laser])})" for laser in originals if laser != best
    )
    said = [own if not others else f"{own} ({_described(scans[best])}), preferred to {others}"]
    if repeats:
        said.append(f"{', '.join(repeats)} repeats it")
    return "; ".join(said)


def _described(records: ScanRecords) -> str:
    view, reach = _seen(records)
    return f"{len(records)} scans, {math.degrees(view):.0f}° with returns, to {reach:.1f} m"


def _warnings(best: Laser, scans: Mapping[Laser, ScanRecords]) -> tuple[str, ...]:
    publishers = [laser for laser in scans if laser.topic == best.topic]
    if len(publishers) == 1:
        return ()
    listed = ", ".join(f"{len(scans[laser])} in '{laser.frame}'" for laser in publishers)
    return (f"{len(publishers)} lasers share the topic {best.topic} ({listed}): those in '{best.frame}' are used",)

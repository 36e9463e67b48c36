"""What the tables of `corrections.toml` may hold, each checked and turned into what it asks for.

A table is asked to build it with a function that tells file and line of one of its keys, of the table itself without.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from frontends.radians import not_in_radians
from graph.limits import LIMITS
from iceg.corrections.corrections import CorrectionsError, Cut, Distrusted, Forbidden, MapFrame, Pinned, check_factor
from iceg.corrections.manual_closures import SIGMA_M, SIGMA_RAD, ManualClosure, check_deviations
from iceg.slam.kept_scans import Interval

Pair = tuple[int, int]
At = Callable[..., str]


@dataclass(frozen=True, kw_only=True)
class ForbidEntry:
    """`[[forbid]]`: the closure between two `scans`, or all `between` two intervals."""

    scans: Pair | None = None
    between: tuple[Interval, Interval] | None = None

    def built(self, at: At) -> Forbidden:
        """What it asks for."""
        if (self.scans is None) == (self.between is None):
            raise CorrectionsError(f"{at()}: expected either scans = [i, j] or between = [[a, b], [c, d]]")
        if self.between is not None:
            one, other = (_interval(interval, at, "between") for interval in self.between)
            return Forbidden(one=one, other=other, where=at("between"))
        i, j = _pair(self.scans, at)
        return Forbidden(one=(i, i), other=(j, j), is_single=True, where=at("scans"))


@dataclass(frozen=True, kw_only=True)
class AddEntry:
    """`[[add]]`: a closure between two `scans`; `pose` of the second in the frame of the first, else it is matched."""

    scans: Pair | None = None
    pose: tuple[float, float, float] | None = None
    sigma_m: float = SIGMA_M
    sigma_rad: float = SIGMA_RAD
    pin: bool = False

    def built(self, at: At) -> ManualClosure:
        """What it asks for."""
        i, j = _pair(self.scans, at)
        if self.pose is not None:
            _check_pose(self.pose, at("pose"))
        check_deviations(self.sigma_m, self.sigma_rad, at("sigma_m"), at("sigma_rad"))
        return ManualClosure(
            scan_i=i,
            scan_j=j,
            T_i_j=None if self.pose is None else np.array(self.pose),
            sigma_m=self.sigma_m,
            sigma_rad=self.sigma_rad,
            pinned=self.pin,
            where=at("scans"),
        )


@dataclass(frozen=True, kw_only=True)
class PinEntry:
    """`[[pin]]`: a closure that the program has found between two `scans`."""

    scans: Pair | None = None

    def built(self, at: At) -> Pinned:
        """What it asks for."""
        i, j = _pair(self.scans, at)
        return Pinned(scan_i=i, scan_j=j, where=at("scans"))


@dataclass(frozen=True, kw_only=True)
class DistrustEntry:
    """`[[distrust]]`: the interval from the first to the last of `scans`; `factor` on standard deviations there."""

    scans: Interval | None = None
    factor: float = 10.0

    def built(self, at: At) -> Distrusted:
        """What it asks for."""
        if self.scans is None:
            raise CorrectionsError(f"{at()}: found no scans, expected scans = [first, last]")
        check_factor(self.factor, at("factor"))
        return Distrusted(scans=_interval(self.scans, at, "scans"), factor=self.factor, where=at("scans"))


@dataclass(frozen=True, kw_only=True)
class CutEntry:
    """`[cut]`: only the intervals that `keep` names take part, but none of those that `drop` does."""

    keep: tuple[Interval, ...] = ()
    drop: tuple[Interval, ...] = ()

    def built(self, at: At) -> Cut:
        """What it asks for."""
        keep = tuple(_interval(interval, at, "keep") for interval in self.keep)
        drop = tuple(_interval(interval, at, "drop") for interval in self.drop)
        return Cut(keep=keep, drop=drop, where=at(), where_kept=at("keep"), where_dropped=at("drop"))


@dataclass(frozen=True, kw_only=True)
class MapEntry:
    """`[map]`: `upright` walls, turned by `turn_degrees`, its origin at a point or at a scan."""

    upright: bool = False
    turn_degrees: float = 0.0
    origin: tuple[float, float] | None = None
    origin_scan: int | None = None

    def built(self, at: At) -> MapFrame:
        """What it asks for."""
        for key, numbers in (("turn_degrees", (self.turn_degrees,)), ("origin", self.origin or ())):
            for number in numbers:
                if abs(number) > LIMITS.coordinate:
                    raise CorrectionsError(
                        f"{at(key)}: {key}: found {number:g}, expected numbers of at most {LIMITS.coordinate:g}"
                    )
        if self.origin_scan is None:
            return MapFrame(**vars(self), where=at())
        if self.origin_scan < 0:
            raise CorrectionsError(f"{at('origin_scan')}: origin_scan: found {self.origin_scan}, expected 0 or more")
        return MapFrame(**vars(self), where=at("origin_scan"))


ENTRIES: dict[str, Any] = {
    "forbid": ForbidEntry,
    "add": AddEntry,
    "pin": PinEntry,
    "distrust": DistrustEntry,
}
"""The tables of which there may be several."""
SINGLE_ENTRIES: dict[str, Any] = {"cut": CutEntry, "map": MapEntry}
"""Those of which there may be one."""


def _pair(scans: Pair | None, at: At) -> Pair:
    if scans is None:
        raise CorrectionsError(f"{at()}: found no scans, expected scans = [i, j]")
    if min(scans) < 0 or scans[0] == scans[1]:
        raise CorrectionsError(f"{at('scans')}: scans: found {list(scans)}, expected two different ones counted from 0")
    return scans


def _check_pose(pose: tuple[float, float, float], where: str) -> None:
    most = (LIMITS.coordinate, LIMITS.coordinate, LIMITS.heading)
    if not all(abs(number) <= top for number, top in zip(pose, most, strict=True)):
        raise CorrectionsError(f"{where}: pose: found {list(pose)}, expected [x m, y m, heading rad]")
    misread = not_in_radians(pose[2])
    if misread:
        raise CorrectionsError(f"{where}: pose: {misread}")


def _interval(scans: Interval, at: At, key: str) -> Interval:
    if not 0 <= scans[0] <= scans[1]:
        raise CorrectionsError(f"{at(key)}: {key}: found {list(scans)}, expected [first, last] of scans counted from 0")
    return scans

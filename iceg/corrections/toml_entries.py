"""What the tables of `corrections.toml` may hold, each checked and turned into what it asks for."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from graph.limits import LIMITS
from iceg.corrections.corrections import CorrectionsError, Cut, Distrusted, Forbidden, MapFrame, Pinned
from iceg.corrections.manual_closures import SIGMA_M, SIGMA_RAD, ManualClosure
from iceg.slam.kept_scans import Interval

Pair = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class ForbidEntry:
    """`[[forbid]]`: the closure between two `scans`, or all `between` two intervals."""

    scans: Pair | None = None
    between: tuple[Interval, Interval] | None = None

    def built(self, where: str) -> Forbidden:
        """What it asks for."""
        if (self.scans is None) == (self.between is None):
            raise CorrectionsError(f"{where}: expected either scans = [i, j] or between = [[a, b], [c, d]]")
        if self.between is not None:
            one, other = (_interval(interval, f"{where}: between") for interval in self.between)
            return Forbidden(one=one, other=other, where=where)
        i, j = _pair(self.scans, where)
        return Forbidden(one=(i, i), other=(j, j), is_single=True, where=where)


@dataclass(frozen=True, kw_only=True)
class AddEntry:
    """`[[add]]`: a closure between two `scans`; `pose` of the second in the frame of the first, else it is matched."""

    scans: Pair | None = None
    pose: tuple[float, float, float] | None = None
    sigma_m: float = SIGMA_M
    sigma_rad: float = SIGMA_RAD
    pin: bool = False

    def built(self, where: str) -> ManualClosure:
        """What it asks for."""
        i, j = _pair(self.scans, where)
        most = (LIMITS.coordinate, LIMITS.coordinate, LIMITS.heading)
        if self.pose is not None and not all(abs(number) <= top for number, top in zip(self.pose, most, strict=True)):
            raise CorrectionsError(f"{where}: pose: found {list(self.pose)}, expected [x m, y m, heading rad]")
        return ManualClosure(
            scan_i=i,
            scan_j=j,
            T_i_j=None if self.pose is None else np.array(self.pose),
            sigma_m=self.sigma_m,
            sigma_rad=self.sigma_rad,
            pinned=self.pin,
            where=where,
        )


@dataclass(frozen=True, kw_only=True)
class PinEntry:
    """`[[pin]]`: a closure that the program has found between two `scans`."""

    scans: Pair | None = None

    def built(self, where: str) -> Pinned:
        """What it asks for."""
        i, j = _pair(self.scans, where)
        return Pinned(scan_i=i, scan_j=j, where=where)


@dataclass(frozen=True, kw_only=True)
class DistrustEntry:
    """`[[distrust]]`: the interval from the first to the last of `scans`; `factor` on standard deviations there."""

    scans: Interval | None = None
    factor: float = 10.0

    def built(self, where: str) -> Distrusted:
        """What it asks for."""
        if self.scans is None:
            raise CorrectionsError(f"{where}: found no scans, expected scans = [first, last]")
        return Distrusted(scans=_interval(self.scans, f"{where}: scans"), factor=self.factor, where=where)


@dataclass(frozen=True, kw_only=True)
class CutEntry:
    """`[cut]`: only the intervals that `keep` names take part, but none of those that `drop` does."""

    keep: tuple[Interval, ...] = ()
    drop: tuple[Interval, ...] = ()

    def built(self, where: str) -> Cut:
        """What it asks for."""
        keep = tuple(_interval(interval, f"{where}: keep") for interval in self.keep)
        return Cut(keep=keep, drop=tuple(_interval(interval, f"{where}: drop") for interval in self.drop), where=where)


@dataclass(frozen=True, kw_only=True)
class MapEntry:
    """`[map]`: `upright` walls, turned by `turn_degrees`, its origin at a point or at a scan."""

    upright: bool = False
    turn_degrees: float = 0.0
    origin: tuple[float, float] | None = None
    origin_scan: int | None = None

    def built(self, where: str) -> MapFrame:
        """What it asks for."""
        numbers = (self.turn_degrees, *(self.origin or ()))
        if any(abs(number) > LIMITS.coordinate for number in numbers) or (self.origin_scan or 0) < 0:
            raise CorrectionsError(f"{where}: found a number that no map needs: {vars(self)}")
        return MapFrame(**vars(self), where=where)


ENTRIES: dict[str, Any] = {
    "forbid": ForbidEntry,
    "add": AddEntry,
    "pin": PinEntry,
    "distrust": DistrustEntry,
}
"""The tables of which there may be several."""
SINGLE_ENTRIES: dict[str, Any] = {"cut": CutEntry, "map": MapEntry}
"""Those of which there may be one."""


def _pair(scans: Pair | None, where: str) -> Pair:
    if scans is None:
        raise CorrectionsError(f"{where}: found no scans, expected scans = [i, j]")
    if min(scans) < 0 or scans[0] == scans[1]:
        raise CorrectionsError(f"{where}: scans: found {list(scans)}, expected two different ones counted from 0")
    return scans


def _interval(scans: Interval, where: str) -> Interval:
    if not 0 <= scans[0] <= scans[1]:
        raise CorrectionsError(f"{where}: found {list(scans)}, expected [first, last] of scans counted from 0")
    return scans

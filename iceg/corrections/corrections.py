"""Corrections as values: what a person says of a run, scans counted from 0 as the log was recorded."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graph.errors import IcegError
from iceg.corrections.manual_closures import ManualClosure
from iceg.slam.kept_scans import Interval, KeptScans

VerdictWord = Literal["accepted", "rejected", "removed", "pinned"]
_LEAST_FACTOR, _MOST_FACTOR = 1.0, 1e4


CORRECTIONS_EXPECTED = "iceg.Corrections, as iceg.read_corrections(path) gives"
"""What an argument of corrections must be, for messages."""


class CorrectionsError(IcegError):
    """Corrections that cannot be read, or do not fit the log."""


@dataclass(frozen=True, kw_only=True)
class Forbidden:
    """Closures that must not be.

    Attributes:
        one: no closure joins a scan of this interval …
        other: … with one of this.
        is_single: whether it is about the closure between two scans, each interval being one of them.
        where: file and line it is from, for messages.
    """

    one: Interval
    other: Interval
    is_single: bool = False
    where: str = "a closure forbidden"


@dataclass(frozen=True, kw_only=True)
class Pinned:
    """A closure found by the program that is to be believed whatever happens.

    Attributes:
        scan_i: one of its scans.
        scan_j: the other.
        where: file and line it is from, for messages.
    """

    scan_i: int
    scan_j: int
    where: str = "a closure pinned"


@dataclass(frozen=True, kw_only=True)
class Distrusted:
    """An interval whose matches and odometry are not to be trusted.

    Attributes:
        scans: first and last of them.
        factor: on the standard deviations of what measures poses there; its walls hold no pose.
        where: file and line it is from, for messages.
    """

    scans: Interval
    factor: float = 10.0
    where: str = "an interval distrusted"

    def __post_init__(self) -> None:
        check_factor(self.factor, self.where)


@dataclass(frozen=True, kw_only=True)
class Cut:
    """What is cut from a log.

    Attributes:
        keep: only these intervals take part; all scans if there are none.
        drop: intervals that take no part.
        where: file and line it is from, for messages …
        where_kept: … those of what is kept …
        where_dropped: … and those of what is dropped.
    """

    keep: tuple[Interval, ...] = ()
    drop: tuple[Interval, ...] = ()
    where: str = "a cut"
    where_kept: str = "a cut"
    where_dropped: str = "a cut"

    def kept(self, n_scans: int) -> KeptScans:
        """Which of so many recorded scans are left.

        Raises:
            CorrectionsError: none are.
        """
        is_kept = np.full(n_scans, not self.keep)
        for first, last in self.keep:
            is_kept[first : last + 1] = True
        for first, last in self.drop:
            is_kept[first : last + 1] = False
        if not is_kept.any():
            raise CorrectionsError(f"{self.where}: nothing is left of {n_scans} scans, expected at least one")
        edges = np.diff(np.concatenate([[False], is_kept, [False]]).astype(np.int8))
        firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return KeptScans(recorded=n_scans, intervals=tuple(zip(firsts.tolist(), lasts.tolist(), strict=True)))


@dataclass(frozen=True, kw_only=True)
class MapFrame:
    """Where the map's axes lie.

    Attributes:
        upright: turned by the least angle that lays most walls along the axes.
        turn_degrees: turned by so much more, counter-clockwise.
        origin: (x, y) of the point, in the map as it is without this, that becomes the origin [m].
        origin_scan: the scan whose robot stands at the origin.
        where: file and line it is from, for messages.
    """

    upright: bool = False
    turn_degrees: float = 0.0
    origin: tuple[float, float] | None = None
    origin_scan: int | None = None
    where: str = "the map's frame"

    def __post_init__(self) -> None:
        if self.origin is not None and self.origin_scan is not None:
            raise CorrectionsError(f"{self.where}: found origin and origin_scan, expected one of them")
        if not all(map(isfinite, (self.turn_degrees, *(self.origin or ())))):
            raise CorrectionsError(f"{self.where}: found a number that is not finite")

    @property
    def is_as_found(self) -> bool:
        """Whether it leaves the map where it is."""
        return not self.upright and self.turn_degrees == 0.0 and self.origin is None and self.origin_scan is None


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenVerdict:
    """A row of `closures.csv` handed back.

    Attributes:
        scan_i: the earlier scan.
        scan_j: the later.
        T_i_j: (3,) how they lie to each other; None where the row does not say.
        verdict: "accepted" and "rejected" are what is to be; "pinned", too; "removed" leaves it to the program.
        where: file and line it is from, for messages.
    """

    scan_i: int
    scan_j: int
    T_i_j: NDArray[np.float64] | None
    verdict: VerdictWord
    where: str


@dataclass(frozen=True, kw_only=True)
class Corrections:
    """What a person corrects of a run; scans count from 0 as the log was recorded, whatever is cut.

    Attributes:
        forbidden: closures that must not be.
        added: closures by hand.
        pinned: closures of the program that are believed whatever happens.
        distrusted: intervals whose matches and odometry are not to be trusted.
        cut: what is cut from the log.
        frame: where the map's axes lie.
        verdicts: rows of `closures.csv` handed back, those that were changed and those that were not.
    """

    forbidden: tuple[Forbidden, ...] = ()
    added: tuple[ManualClosure, ...] = ()
    pinned: tuple[Pinned, ...] = ()
    distrusted: tuple[Distrusted, ...] = ()
    cut: Cut = field(default_factory=Cut)
    frame: MapFrame = field(default_factory=MapFrame)
    verdicts: tuple[GivenVerdict, ...] = ()

    def with_closures(self, closures: Sequence[ManualClosure]) -> "Corrections":
        """The same with closures by hand more."""
        return replace(self, added=(*self.added, *closures))

    def handed_back_from(self, kept: KeptScans) -> "Corrections":
        """The same, verdicts counting scans as recorded instead of as the results of a run do, which has cut some.

        Raises:
            CorrectionsError: a verdict is about a scan that those results do not have.
        """

        def recorded(row: GivenVerdict) -> GivenVerdict:
            last = max(row.scan_i, row.scan_j)
            if last >= len(kept.indices):
                raise CorrectionsError(f"{row.where}: found scan {last}, but the run has {len(kept.indices)} scans")
            scan_i, scan_j = kept.indices[[row.scan_i, row.scan_j]].tolist()
            return replace(row, scan_i=scan_i, scan_j=scan_j)

        return replace(self, verdicts=tuple(map(recorded, self.verdicts)))

    def joined(self, others: "Corrections") -> "Corrections":
        """Both together.

        Raises:
            CorrectionsError: both cut the log, or turn the map.
        """
        more = "found more than one file that"
        if self.cut != Cut() and others.cut != Cut():
            raise CorrectionsError(f"{others.cut.where}: {more} cuts the log, expected one")
        if not (self.frame.is_as_found or others.frame.is_as_found):
            raise CorrectionsError(f"{others.frame.where}: {more} turns the map, expected one")
        return Corrections(
            forbidden=(*self.forbidden, *others.forbidden),
            added=(*self.added, *others.added),
            pinned=(*self.pinned, *others.pinned),
            distrusted=(*self.distrusted, *others.distrusted),
            cut=others.cut if self.cut == Cut() else self.cut,
            frame=others.frame if self.frame.is_as_found else self.frame,
            verdicts=(*self.verdicts, *others.verdicts),
        )

    def check(self, n_scans: int, taken: KeptScans | None = None) -> KeptScans:
        """Refuse what is about scans that the log does not have, or that are cut from it; what is left of it.

        Args:
            n_scans: of the recorded log.
            taken: what takes part where these corrections cut nothing; all scans if it is left out.

        Raises:
            IcegError: naming where the correction is from, the scan and the number of scans.
        """
        for where, scan in self._scans():
            if scan >= n_scans:
                raise CorrectionsError(f"{where}: found scan {scan}, but the log has {n_scans} scans")
        kept = taken if taken is not None and not (self.cut.keep or self.cut.drop) else self.cut.kept(n_scans)
        for where, scan in self._single_scans():
            if kept.position(scan) is None:
                raise CorrectionsError(f"{where}: found scan {scan}, which is cut from the log")
        return kept

    def counted_in(self, kept: KeptScans) -> "Corrections":
        """The same with scans counted among those that take part; nothing cut."""
        if kept.is_all:
            return replace(self, cut=Cut())
        at = kept.indices.searchsorted

        def moved(closure: Any) -> Any:  # noqa: ANN401
            return replace(closure, scan_i=int(at(closure.scan_i)), scan_j=int(at(closure.scan_j)))

        frame = self.frame
        if frame.origin_scan is not None:
            frame = replace(frame, origin_scan=int(at(frame.origin_scan)))
        return Corrections(
            forbidden=tuple(
                replace(each, one=kept.positions(each.one), other=kept.positions(each.other)) for each in self.forbidden
            ),
            added=tuple(map(moved, self.added)),
            pinned=tuple(map(moved, self.pinned)),
            distrusted=tuple(replace(each, scans=kept.positions(each.scans)) for each in self.distrusted),
            frame=frame,
            verdicts=tuple(map(moved, self.verdicts)),
        )

    def record(self) -> dict[str, Any]:
        """For `summary.json`: what was corrected, nothing of what was not."""
        verdicts = [row for row in self.verdicts if row.verdict != "removed"]
        found: dict[str, Any] = {
            "forbidden": [[list(each.one), list(each.other)] for each in self.forbidden],
            "added": [_closure_record(closure) for closure in self.added],
            "pinned": [[each.scan_i, each.scan_j] for each in self.pinned],
            "distrusted": [{"scans": list(each.scans), "factor": each.factor} for each in self.distrusted],
            "verdicts_handed_back": len(verdicts),
        }
        if not self.frame.is_as_found:
            found["map"] = {
                "upright": self.frame.upright,
                "turn_degrees": self.frame.turn_degrees,
                "origin": self.frame.origin,
                "origin_scan": self.frame.origin_scan,
            }
        return {name: value for name, value in found.items() if value}

    def _scans(self) -> Iterator[tuple[str, int]]:
        """Every scan named, and where."""
        yield from self._single_scans()
        for each in self.forbidden:
            yield from ((each.where, scan) for scan in (*each.one, *each.other))
        for interval in self.distrusted:
            yield from ((interval.where, scan) for scan in interval.scans)
        yield from ((self.cut.where_kept, last) for _, last in self.cut.keep)
        yield from ((self.cut.where_dropped, last) for _, last in self.cut.drop)

    def _single_scans(self) -> Iterator[tuple[str, int]]:
        """Those that must take part."""
        ends: list[ManualClosure | Pinned | GivenVerdict] = [*self.added, *self.pinned, *self.verdicts]
        for closure in ends:
            yield from ((closure.where, scan) for scan in (closure.scan_i, closure.scan_j))
        for each in self.forbidden:
            if each.is_single:
                yield from ((each.where, scan) for scan in (each.one[0], each.other[0]))
        if self.frame.origin_scan is not None:
            yield self.frame.where, self.frame.origin_scan


def check_factor(factor: float, where: str) -> None:
    """Make sure that a factor on standard deviations is one.

    Raises:
        CorrectionsError: it is not, with where it is from.
    """
    if not _LEAST_FACTOR <= factor <= _MOST_FACTOR:
        raise CorrectionsError(f"{where}: factor: found {factor:g}, expected {_LEAST_FACTOR:g} to {_MOST_FACTOR:g}")


def _closure_record(closure: ManualClosure) -> dict[str, Any]:
    return {
        "scans": [closure.scan_i, closure.scan_j],
        "pose": None if closure.T_i_j is None else closure.T_i_j.tolist(),
        "pinned": closure.pinned,
    }

"""The scans of a recorded log that take part: all, or those that are left of it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from frontends.scan import Log
from graph.arrays import Ints
from graph.errors import IcegError
from graph.limits import LIMITS
from graph.short_repr import short_repr

Interval = tuple[int, int]
"""First and last of scans in a row, both counted in, as recorded."""


class KeptScansError(IcegError):
    """A record of scans that cannot be one."""


@dataclass(frozen=True)
class KeptScans:
    """The scans of a recorded log that take part.

    Attributes:
        recorded: how many scans the log has.
        intervals: of those that take part, in order.
    """

    recorded: int
    intervals: tuple[Interval, ...]

    __repr__ = short_repr

    @classmethod
    def all_of(cls, n_scans: int) -> "KeptScans":
        """Every one of so many."""
        return cls(n_scans, ((0, n_scans - 1),))

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> "KeptScans":
        """What `record` has made of it.

        Raises:
            KeptScansError: it is no record of scans in order.
        """
        try:
            intervals = tuple((int(first), int(last)) for first, last in record["kept"])
            kept = cls(int(record["recorded_scans"]), intervals)
        except (KeyError, ValueError, TypeError, OverflowError) as err:
            raise KeptScansError(f"found the scans {str(record)[:80]}, expected recorded_scans and kept") from err
        flat = [scan for interval in intervals for scan in interval]
        if not flat or flat != sorted(flat) or flat[0] < 0 or not flat[-1] < kept.recorded <= LIMITS.scans:
            raise KeptScansError(f"found the scans {str(intervals)[:80]} of {kept.recorded}, expected some in order")
        return kept

    @property
    def is_all(self) -> bool:
        """Whether nothing was cut."""
        return self.intervals == ((0, self.recorded - 1),)

    @cached_property
    def indices(self) -> Ints:
        """(n,) the scans that take part, as recorded."""
        return np.concatenate([np.arange(first, last + 1) for first, last in self.intervals])

    def of(self, log: Log) -> Log:
        """The log of the scans that take part."""
        if self.is_all:
            return log
        if len(self.intervals) == 1:
            ((first, last),) = self.intervals
            return log.select(slice(first, last + 1))
        return log.select(self.indices)

    def position(self, scan: int) -> int | None:
        """Where a recorded scan is among those that take part; None if it does not."""
        at = int(np.searchsorted(self.indices, scan))
        return at if at < len(self.indices) and self.indices[at] == scan else None

    def positions(self, interval: Interval) -> Interval:
        """First and last of those that take part of an interval; the last before the first where none does."""
        first, last = np.searchsorted(self.indices, [interval[0], interval[1] + 1]).tolist()
        return first, last - 1

    def record(self) -> dict[str, Any]:
        """For `summary.json`."""
        return {"recorded_scans": self.recorded, "kept": [list(interval) for interval in self.intervals]}

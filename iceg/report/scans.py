"""The scans of a run for its report: short whole numbers, and no more of them than a file to be sent can hold."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from iceg.report.packing import packed

_MOST_READINGS = 7_000_000
"""So many readings are 19 MB of the page."""
_STEPS = 65_534
_AT_ONCE = 500
_FINEST = 0.001
"""Ranges are told to a millimetre [m], to more where the laser reaches farther than 65 m."""


def scans_payload(log: Log, key_scans: NDArray[np.int64]) -> Mapping[str, Any]:
    """The laser and its scans: all of them, or the key scans and as many others as there is room for.

    Args:
        log: the log.
        key_scans: (k,) which scans the graph has poses for.
    """
    geometry = log.geometry
    every_beam = max(1, math.ceil(len(key_scans) * geometry.n_beams / _MOST_READINGS))
    beams = np.arange(0, geometry.n_beams, every_beam)
    kept = _kept(len(log), key_scans, _MOST_READINGS // len(beams))
    unit = max(_FINEST, max((float(some.max(initial=0.0)) for some in _ranges(log, kept, beams)), default=0.0) / _STEPS)
    counts = np.empty((len(kept), len(beams)), dtype=np.uint16)
    for k, some in enumerate(_ranges(log, kept, beams)):
        counts[_AT_ONCE * k : _AT_ONCE * (k + 1)] = np.rint(some / unit)
    return {
        "scans": packed(kept, "i4"),
        "unit_m": unit,
        "ranges": packed(counts, "u2"),
        "directions": packed(geometry.directions_robot[beams], "f4"),
        "origin": geometry.origin_robot.tolist(),
        "left_out": {"scans": len(log) - len(kept), "every_beam": every_beam},
    }


def _ranges(log: Log, scans: NDArray[np.int64], beams: NDArray[np.int64]) -> Iterator[NDArray[np.float64]]:
    """The ranges of some scans [m], 0 without return, a few scans at a time: all would take much memory."""
    for first in range(0, len(scans), _AT_ONCE):
        yield np.nan_to_num(log.ranges[scans[first : first + _AT_ONCE]][:, beams].astype(np.float64), nan=0.0)


def _kept(n_scans: int, key_scans: NDArray[np.int64], room: int) -> NDArray[np.int64]:
    """Scans to show: the key scans, and others evenly spread, about `room` in all."""
    if n_scans <= room:
        return np.arange(n_scans)
    others = np.arange(0, n_scans, math.ceil(n_scans / max(1, room - len(key_scans))))
    return np.union1d(key_scans, others) if room > len(key_scans) else key_scans

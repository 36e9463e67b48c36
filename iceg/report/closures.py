"""The record of loop closures for the report of a run, each with how the final path differs from it."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from graph.se2 import between
from iceg.report.factors import KINDS, HeldBy
from iceg.report.packing import packed

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

_VERDICTS = ("accepted", "rejected", "removed", "by hand")
_BY_HAND = "by hand"


def closures_payload(result: "SlamResult", held: HeldBy) -> Mapping[str, Any]:
    """Scans, transforms, scores, verdicts and reasons of all closures tried.

    Args:
        result: of the run.
        held: its factors; of the closures among them it knows the residual in standard deviations.
    """
    closures = result.closures
    scans = np.array([(closure.scan_i, closure.scan_j) for closure in closures], dtype=np.int64).reshape(-1, 2)
    T_i_j = np.array([closure.T_i_j for closure in closures], dtype=np.float64).reshape(-1, 3)
    on_path = between(result.trajectory[scans[:, 0]], result.trajectory[scans[:, 1]])
    verdicts = [_BY_HAND if c.verdict == "accepted" and c.reason.startswith(_BY_HAND) else c.verdict for c in closures]
    return {
        "names": _VERDICTS,
        "scans": packed(scans, "i4"),
        "matched": packed(T_i_j, "f4"),
        "on_path": packed(on_path, "f4"),
        "scores": packed([closure.score for closure in closures], "f4"),
        "inliers": packed([closure.inliers for closure in closures], "i4"),
        "overlaps": packed([closure.overlap for closure in closures], "f4"),
        "verdicts": packed([_VERDICTS.index(verdict) for verdict in verdicts], "u1"),
        "off_path": packed([closure.off_path for closure in closures], "f4"),
        "rivals": [None if (rival := closure.rival) is None else asdict(rival) for closure in closures],
        "factors": packed(_factors_of(result, held), "i4"),
        "reasons": [closure.reason for closure in closures],
    }


def _factors_of(result: "SlamResult", held: HeldBy) -> list[int]:
    """Index of the factor that each closure has become, -1 for none."""
    chosen = np.flatnonzero(held.kinds == KINDS.index("closure")).tolist()
    factor_of = {(int(held.i[m]), int(held.j[m])): m for m in chosen}
    scans = np.array([(c.scan_i, c.scan_j) for c in result.closures], dtype=np.int64).reshape(-1, 2)
    keys = (np.searchsorted(result.key_scans, scans, side="right") - 1).tolist()
    return [
        factor_of.get((i, j), -1) if closure.verdict == "accepted" else -1
        for (i, j), closure in zip(keys, result.closures, strict=True)
    ]

"""Everything the page of a run shows, as JSON."""

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graph.file_names import readable
from iceg.ice.features import KIND_NAMES
from iceg.report.closures import closures_payload
from iceg.report.curves import curves_payload, shares_of
from iceg.report.factors import HeldBy
from iceg.report.figures import figures_payload
from iceg.report.grid import grid_payload
from iceg.report.joint import joint_payload
from iceg.report.learned import learned_payload
from iceg.report.packing import packed
from iceg.report.scans import scans_payload
from iceg.report.settings import changed_settings
from iceg.report.truth import truth_payload
from iceg.report.walls import walls_payload
from iceg.report.warned_places import warnings_payload

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

_UPPER = np.triu_indices(3)


def page_payload(result: "SlamResult", truth: NDArray[np.float64] | None = None) -> Iterator[str]:
    """The data of the page, in one line of JSON that holds no `<`, piece by piece.

    Args:
        result: of the run.
        truth: (n_scans, 3) true poses, in any frame; those of the log when left out.
    """
    before = "{"
    for name, value in _members(result, result.log.truth if truth is None else truth):
        yield f"{before}{_json(name)}:"
        yield _json(value)
        before = ","
    yield "}"


def _members(result: "SlamResult", truth: NDArray[np.float64] | None) -> Iterator[tuple[str, Any]]:
    """The parts of the data one by one, so that no two of them take memory at a time."""
    held, shares = HeldBy.of(result), shares_of(result)
    yield "name", readable(result.log.path.name)
    yield "stamps", packed(_seconds(result.log.stamps), "f8")
    yield "trajectory", packed(result.trajectory, "f4")
    yield "keys", _key_poses(result)
    yield "laser", scans_payload(result.log, result.key_scans)
    yield "grid", grid_payload(result.grid)
    yield "walls", walls_payload(result.walls)
    yield "landmarks", _landmarks(result)
    yield "closures", closures_payload(result, held)
    yield "factors", held.payload()
    yield "joint", joint_payload(result.joint, result.summary["laser"])
    yield "curves", curves_payload(result, shares)
    yield "truth", None if truth is None else truth_payload(result, truth)
    yield "figures", figures_payload(result, held, shares)
    yield "learned", learned_payload(result.summary, has_odometry=result.log.has_odometry)
    yield "settings", changed_settings(result.config)
    yield "warnings", warnings_payload(result)
    yield "kept", result.summary.get("cut", {"kept": [[0, len(result.log) - 1]]})["kept"]
    yield "is_corrected", "corrections" in result.summary
    yield "lost", [int(scan) for scan in result.summary["lost_at_scans"]]


def _key_poses(result: "SlamResult") -> dict[str, Any]:
    return {
        "scans": packed(result.key_scans, "i4"),
        "poses": packed(result.key_poses, "f8"),
        "covariances": packed(result.covariances[:, *_UPPER], "f4"),
    }


def stages_payload(result: "SlamResult") -> str:
    """Seconds a stage, the one thing in the page that differs when the same log is run again."""
    return _json(result.summary["seconds"])


def _json(value: Any) -> str:  # noqa: ANN401
    """A value as it may stand in a script element, where nothing but `<` could end the text early."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _seconds(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Since the first scan; what clocks show is long and in the way."""
    return stamps - stamps[0] if len(stamps) else stamps


def _landmarks(result: "SlamResult") -> dict[str, Any]:
    landmarks = result.landmarks
    return {
        "names": KIND_NAMES,
        "settled": len(landmarks.settled()),
        "kinds": packed(landmarks.kinds, "u1"),
        "positions": packed(landmarks.positions, "f4"),
        "directions": packed(landmarks.directions, "f4"),
        "seen": packed(landmarks.seen, "i4"),
        "first_seen": packed(landmarks.first_seen, "i4"),
        "expired_at": packed(landmarks.expired_at, "i4"),
    }

"""How often ICE finds a scan again in a local map of another pass, whatever the initial error."""

import time
from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log, Scan
from graph.se2 import between
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import Relations
from iceg.evaluation.scan_pairs import SEPARATE_PASSES, errors_against, is_success
from iceg.ice.hypotheses import SearchWindow
from iceg.ice.local_map import LocalMap
from iceg.ice.matcher import IceMatcher
from iceg.slam.track import Track

_HALF = 8
"""Key scans to either side that make up the reference."""
_RECALL_M, _RECALL_RAD = 0.3, radians(6.0)
"""A hypothesis this near to the true pose is right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecallResult:
    """What became of n matches.

    Attributes:
        n: matches tried.
        recall: share where some hypothesis lay within 0.3 m and 6° of the relation.
        success: share whose final pose lay within 0.15 m and 3°.
        median_ms: CPU time of one match, features included [ms].
        hypotheses: mean number of hypotheses.
        translation_errors: (n,) of the final pose [m].
        rotation_errors: (n,) of the final pose, not negative [rad].
    """

    n: int
    recall: float
    success: float
    median_ms: float
    hypotheses: float
    translation_errors: NDArray[np.float64]
    rotation_errors: NDArray[np.float64]

    @property
    def median_error(self) -> float:
        """Median translation error of the matches that succeeded [m]."""
        good = is_success(self.translation_errors, self.rotation_errors)
        return float(np.median(self.translation_errors[good])) if good.any() else float("nan")


def recall_benchmark(
    log: Log,
    relations: Relations,
    track: Track,
    window_m: float,
    window_rad: float,
    seed: int = 0,
    *,
    matcher: IceMatcher | None = None,
) -> RecallResult:
    """Match scan j of each relation against a local map of the other pass, around scan i.

    Args:
        log: the log.
        relations: known relative poses; those whose two scans lie more than 200 scans apart are used.
        track: of the front end on the same log; up to 17 of its key scans around scan i make the local map.
        window_m: the initial error is uniform within this in x and y [m] …
        window_rad: … and in heading within this [rad].
        seed: of the initial errors.
        matcher: ICE with the settings to judge; the defaults when left out.

    Returns:
        Recall, success and time.

    Raises:
        EvaluationError: no relation joins two passes.
    """
    matcher = matcher or IceMatcher()
    apart = np.flatnonzero(np.abs(relations.scans_i - relations.scans_j) > SEPARATE_PASSES)
    if not len(apart):
        raise EvaluationError(f"{relations.path}: none of its {len(relations)} relations joins two passes")
    places = _Places(log, track, matcher)
    # One draw per relation, before any match: the same starts whatever the matcher does.
    offsets = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(apart), 3)) * [window_m, window_m, window_rad]
    trials = [
        _try(
            matcher,
            places.local_map(int(relations.scans_i[k])),
            log.scan(int(relations.scans_j[k])),
            relations.T_i_j[k],
            SearchWindow(T_ref_guess=relations.T_i_j[k] + offset, translation=window_m, rotation=window_rad),
        )
        for k, offset in zip(apart, offsets, strict=True)
    ]
    errors = np.array([trial.error for trial in trials])
    return RecallResult(
        n=len(trials),
        recall=float(np.mean([trial.recalled for trial in trials])),
        success=float(np.mean(is_success(errors[:, 0], errors[:, 1]))),
        median_ms=1e3 * float(np.median([trial.seconds for trial in trials])),
        hypotheses=float(np.mean([trial.hypotheses for trial in trials])),
        translation_errors=errors[:, 0],
        rotation_errors=errors[:, 1],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trial:
    recalled: bool
    error: tuple[float, float]
    seconds: float
    hypotheses: int


def _try(
    matcher: IceMatcher, local_map: LocalMap, scan: Scan, T_i_j: NDArray[np.float64], window: SearchWindow
) -> _Trial:
    started = time.process_time()
    refined = matcher.align(local_map, scan, window)
    seconds = time.process_time() - started
    hypotheses, _ = matcher.rank(local_map, matcher.observe(scan), window)
    distances, turns = errors_against(hypotheses, T_i_j)
    error_m, error_rad = errors_against(refined.T_ref_cur, T_i_j)
    return _Trial(
        recalled=bool(((distances < _RECALL_M) & (turns < _RECALL_RAD)).any()),
        error=(float(error_m), float(error_rad)),
        seconds=seconds,
        hypotheses=len(hypotheses),
    )


class _Places:
    """Local maps around scans of the log, in the frame of that scan."""

    def __init__(self, log: Log, track: Track, matcher: IceMatcher) -> None:
        self._matcher = matcher
        self._keys = track.key_scans
        self._scans = [log.scan(index) for index in self._keys.tolist()]
        self._T_track_robot = track.T_track_scans
        self._last: tuple[int, LocalMap] | None = None

    def local_map(self, index: int) -> LocalMap:
        """Up to 17 key scans around a scan, the nearest in time last."""
        if self._last is not None and self._last[0] == index:
            return self._last[1]
        middle = int(np.searchsorted(self._keys, index))
        members = np.arange(max(0, middle - _HALF), min(len(self._keys), middle + _HALF + 1))
        members = members[np.argsort(-np.abs(self._keys[members] - index), kind="stable")]
        poses = between(self._T_track_robot[index], self._T_track_robot[self._keys[members]])
        local_map = self._matcher.prepare([self._scans[k] for k in members], poses)
        self._last = (index, local_map)
        return local_map

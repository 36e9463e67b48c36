"""Pairs of scans that share enough of their view, with the pose between them: what matchers are judged on."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from math import radians

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log, Scan
from frontends.simulator.scene import Scene
from frontends.simulator.simulation import scan_pairs
from graph.se2 import between, transform_points
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import Relations

SEPARATE_PASSES = 200
"""Two scans more than this far apart in the log count as two passes."""
_SUCCESS_M, _SUCCESS_RAD = 0.15, radians(3.0)
"""A match within these of the true pose has succeeded."""
_SEEN_BY_BOTH_M = 0.3
"""A point this near to one of the other scan is seen by both."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPair:
    """Two scans and the pose of the second robot in the frame of the first, (3,)."""

    reference: Scan
    current: Scan
    T_ref_cur: NDArray[np.float64]


def shared_view(pair: ScanPair) -> float:
    """Share of the returns that the other scan has as well, within 0.3 m; the smaller of the two shares."""
    from scipy.spatial import cKDTree

    reference, current = pair.reference.points, transform_points(pair.T_ref_cur, pair.current.points)
    if not (len(reference) and len(current)):
        return 0.0
    there, back = cKDTree(reference).query(current)[0], cKDTree(current).query(reference)[0]
    return float(min(np.mean(np.asarray(there) < _SEEN_BY_BOTH_M), np.mean(np.asarray(back) < _SEEN_BY_BOTH_M)))


def simulated_pairs(
    scene: str | Scene,
    n: int,
    seed: int = 0,
    *,
    least_shared: float = 0.5,
    max_translation: float = 1.0,
    max_rotation: float = np.pi / 4,
) -> list[ScanPair]:
    """Pairs along the route of a simulated scene; their pose is exact.

    Args:
        scene: the scene, or its name.
        n: how many.
        seed: of places, offsets and noise.
        least_shared: of their view.
        max_translation: the two poses lie at most this far apart [m] …
        max_rotation: … and are turned by at most this [rad].

    Raises:
        EvaluationError: too few pairs share that much.
    """
    drawn = scan_pairs(scene, 4 * n, seed, max_translation=max_translation, max_rotation=max_rotation)
    pairs = (
        ScanPair(
            reference=Scan(ranges=reference, geometry=drawn.geometry),
            current=Scan(ranges=current, geometry=drawn.geometry),
            T_ref_cur=T_ref_cur,
        )
        for reference, current, T_ref_cur in zip(drawn.reference, drawn.current, drawn.T_ref_cur, strict=True)
    )
    return _first_that_share(pairs, n, least_shared, str(scene))


def recorded_pairs(
    log: Log, relations: Relations, n: int | None, seed: int = 0, *, least_shared: float = 0.5
) -> list[ScanPair]:
    """Pairs of a recorded log whose relative pose was verified by hand, two passes of the same place each.

    Args:
        log: the log.
        relations: of its scans; those more than 200 scans apart are used.
        n: how many; None takes all that share that much.
        seed: of the choice among them.
        least_shared: of their view.

    Raises:
        EvaluationError: too few pairs share that much.
    """
    apart = np.flatnonzero(np.abs(relations.scans_i - relations.scans_j) > SEPARATE_PASSES)
    order = np.random.default_rng(seed).permutation(apart)
    pairs = (
        ScanPair(
            reference=log.scan(int(relations.scans_i[k])),
            current=log.scan(int(relations.scans_j[k])),
            T_ref_cur=relations.T_i_j[k],
        )
        for k in order.tolist()
    )
    return _first_that_share(pairs, n, least_shared, str(relations.path))


def posed_pairs(
    log: Log,
    scans: NDArray[np.int64],
    poses: NDArray[np.float64],
    n: int,
    seed: int = 0,
    *,
    least_shared: float = 0.5,
    max_translation: float = 1.0,
    max_rotation: float = np.pi / 4,
) -> list[ScanPair]:
    """Pairs of a recorded log whose scans have known poses, two passes of the same place each.

    Args:
        log: the log.
        scans: (m,) whose poses are known, counted from 0; those more than 200 scans apart are paired.
        poses: (m, 3) T_world_robot of these scans.
        n: how many.
        seed: of the choice among them.
        least_shared: of their view.
        max_translation: the two poses lie at most this far apart [m] …
        max_rotation: … and are turned by at most this [rad].

    Raises:
        EvaluationError: too few pairs share that much.
    """
    from scipy.spatial import cKDTree

    i, j = np.asarray(cKDTree(poses[:, :2]).query_pairs(max_translation, output_type="ndarray")).T
    T_i_j = between(poses[i], poses[j])
    usable = (np.abs(T_i_j[:, 2]) <= max_rotation) & (np.abs(scans[i] - scans[j]) > SEPARATE_PASSES)
    order = np.random.default_rng(seed).permutation(np.flatnonzero(usable))
    pairs = (
        ScanPair(reference=log.scan(int(scans[i[k]])), current=log.scan(int(scans[j[k]])), T_ref_cur=T_i_j[k])
        for k in order.tolist()
    )
    return _first_that_share(pairs, n, least_shared, f"{len(scans)} scans of known poses")


def errors_against(
    T_ref_cur: NDArray[np.float64], T_true: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance [m] and angle [rad], not negative, between poses (..., 3)."""
    off = between(T_true, T_ref_cur)
    return np.hypot(off[..., 0], off[..., 1]), np.abs(off[..., 2])


def is_success(distance: NDArray[np.float64], angle: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether matches with such errors, see `errors_against`, found the place: 0.15 m and 3° at most."""
    return (distance < _SUCCESS_M) & (angle < _SUCCESS_RAD)


def _first_that_share(pairs: Iterator[ScanPair], n: int | None, least_shared: float, where: str) -> list[ScanPair]:
    kept = list(islice((pair for pair in pairs if shared_view(pair) >= least_shared), n))
    wanted = n or 1
    if len(kept) < wanted:
        raise EvaluationError(
            f"{where}: found {len(kept)} pairs that share {least_shared:.0%} of their view, expected {wanted}"
        )
    return kept

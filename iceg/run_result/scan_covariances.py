"""How well each scan's pose is known, from what is known of the key poses around it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graph.dense import congruence, inv
from graph.factors import Factor
from graph.se2 import adjoint, between


def scan_covariances(
    trajectory: NDArray[np.float64],
    key_scans: NDArray[np.int64],
    covariances: NDArray[np.float64],
    tracking: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of every scan's pose, in the tangent space at it.

    A key scan has its key pose's. Of a scan between two, at the share w of the scans from one to the next, the errors
    of both key poses are carried to it rigidly, Ad(T_scan_key) Σ Ad(T_scan_key)ᵀ, and weighted with 1 − w and w: an
    upper bound for an error that goes over from one into the other, as a mean of covariances is never less than the
    covariance of the mean. To this comes what tracking between the two may be off by, a bridge that is widest midway:
    4 w (1 − w) times its covariance. Behind the last key scan that is added in full.

    Args:
        trajectory: (n, 3) T_map_robot of every scan.
        key_scans: (k,) the key scans, increasing.
        covariances: (k, 3, 3) of the key poses, tangent space at each.
        tracking: (k, 3, 3) of a pose tracked on the way to each key scan, see `tracking_covariances`.

    Returns:
        (n, 3, 3).
    """
    scans = np.arange(len(trajectory))
    before = np.clip(np.searchsorted(key_scans, scans, side="right") - 1, 0, None)
    after = np.minimum(before + 1, len(key_scans) - 1)
    span = np.maximum(key_scans[after] - key_scans[before], 1)
    is_behind = scans > key_scans[-1]
    share = np.where(is_behind, 0.0, np.clip((scans - key_scans[before]) / span, 0.0, 1.0))
    bridge = np.where(is_behind, 1.0, 4.0 * share * (1.0 - share))[:, None, None]
    from_before = _carried(trajectory, key_scans[before], covariances[before])
    from_after = _carried(trajectory, key_scans[after], covariances[after])
    weight = share[:, None, None]
    return np.asarray((1.0 - weight) * from_before + weight * from_after + bridge * tracking[after])


def tracking_covariances(factors: Sequence[Factor], n_keys: int, stand_in: tuple[float, float]) -> NDArray[np.float64]:
    """What a pose tracked on the way to each key scan may be off by.

    That is what the match and the odometry to the key scan say together, (Σ_match⁻¹ + Σ_odometry⁻¹)⁻¹: the scans on the
    way are matched like it, and odometry holds the directions that a match does not observe.

    Args:
        factors: of the graph.
        n_keys: number of key poses k.
        stand_in: standard deviations where no factor says: x and y [m], heading [rad].

    Returns:
        (k, 3, 3).
    """
    stated = np.diag([stand_in[0] ** 2, stand_in[0] ** 2, stand_in[1] ** 2])
    kept = [factor for factor in factors if factor.kind in ("ice", "odometry")]
    information = np.zeros((n_keys, 3, 3))
    if kept:
        each = inv(np.array([factor.covariance for factor in kept]))
        np.add.at(information, np.array([factor.j for factor in kept]), each)
    known = information[:, 0, 0] > 0.0
    covariances = np.broadcast_to(stated, information.shape).copy()
    if known.any():
        covariances[known] = inv(information[known])
    return covariances


def _carried(
    trajectory: NDArray[np.float64], key_scans: NDArray[np.int64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3, 3): the covariance of a key pose each, rigidly carried to the scans."""
    return congruence(adjoint(between(trajectory, trajectory[key_scans])), covariances)

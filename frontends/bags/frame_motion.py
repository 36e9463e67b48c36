"""Where a frame is at given times, by the transforms of a bag: as tf2 looks it up."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from frontends.bags.frames import Frames
from frontends.bags.records import Records, Rows
from frontends.bags.rigid import Rigid
from frontends.bags.sources import is_fixed_frame
from frontends.bags.times import ScanTimes, covered, pose_times

_NEARLY_EQUAL = 0.9995
"""Quaternions with a larger product are interpolated linearly: the sine of their angle says nothing any more."""


def root_of(base: str, frames: Frames) -> str:
    """The highest frame that carries the robot's, below the map and other fixed frames: most often odom."""
    chain = frames.above(base)
    n = next((n for n, name in enumerate(chain) if n and is_fixed_frame(name)), len(chain))
    return chain[n - 1]


def poses_in_root(
    base: str, root: str, records: Records, frames: Frames, times: ScanTimes, stamps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], list[str]]:
    """The planar poses of the robot's frame in the root, each edge between two transforms as tf2 interpolates it.

    Args:
        base: the robot's frame.
        root: one that carries it, directly or not.
        records: the transforms.
        frames: their tree.
        times: of the scans.
        stamps: (n,) wanted [s].

    Returns:
        (n, 3) T_root_base, before the first and behind the last transform as there; and what a person should know.
    """
    above = frames.above(base)
    poses, notes = [Rigid()] * len(stamps), []
    for child, parent in itertools.pairwise(above[: above.index(root) + 1]):
        rows = records.transforms.get((parent, child))
        if rows is None or child not in frames.moving:
            edges = [frames.edges[child]] * len(stamps)
        else:
            edges, said = _interpolated(rows, times, stamps)
            notes += [f"{parent} → {child}: {sentence}" for sentence in said]
        poses = [edge.compose(pose) for edge, pose in zip(edges, poses, strict=True)]
    return np.array([pose.planar for pose in poses]).reshape(-1, 3), notes


def _interpolated(rows: Rows, times: ScanTimes, stamps: NDArray[np.float64]) -> tuple[list[Rigid], list[str]]:
    at, notes = pose_times(rows.stamps, rows.recorded, times)
    outside = int(np.count_nonzero(~covered(at, stamps)))
    if outside:
        notes.append(f"it does not tell of {outside} scans: for them it stays as it is")
    order = np.argsort(at, kind="stable")
    at, values = at[order], rows.values[order]
    after = np.clip(np.searchsorted(at, stamps), 1, len(at) - 1)
    spans = at[after] - at[after - 1]
    shares = np.clip((stamps - at[after - 1]) / np.where(spans > 0.0, spans, 1.0), 0.0, 1.0)
    rigid = [Rigid.of(tuple(row)) for row in values.tolist()]
    steps = zip(after.tolist(), shares.tolist(), strict=True)
    return [_between(rigid[k - 1], rigid[k], share) for k, share in steps], notes


def _between(a: Rigid, b: Rigid, share: float) -> Rigid:
    """Linear in place, spherical in rotation (slerp)."""
    place = [(1.0 - share) * ours + share * theirs for ours, theirs in zip(a[:3], b[:3], strict=True)]
    product = sum(ours * theirs for ours, theirs in zip(a[3:], b[3:], strict=True))
    sign = math.copysign(1.0, product)
    angle = math.acos(min(1.0, abs(product)))
    if abs(product) > _NEARLY_EQUAL:
        weights = 1.0 - share, sign * share
    else:
        weights = math.sin((1.0 - share) * angle) / math.sin(angle), sign * math.sin(share * angle) / math.sin(angle)
    turned = [weights[0] * ours + weights[1] * theirs for ours, theirs in zip(a[3:], b[3:], strict=True)]
    return Rigid.of((*place, *turned))

"""Which frame sits where on which other: the tree that transforms and the robot's description make."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from frontends.bags.records import Rows
from frontends.bags.rigid import Rigid, planar_poses
from graph.se2 import wrap_angle

_STILL = (0.02, math.radians(1.0))
"""What a transform that is stated again and again may vary by, and is still fixed [m, rad]."""


@dataclass(frozen=True, kw_only=True)
class Frames:
    """Frames and what each sits on.

    Attributes:
        parents: of each frame that has one.
        edges: the pose of each such frame in its parent; of one that moves, at the middle of its messages.
        moving: frames that move on their parents.
    """

    parents: Mapping[str, str] = field(default_factory=dict)
    edges: Mapping[str, Rigid] = field(default_factory=dict)
    moving: frozenset[str] = frozenset()

    @classmethod
    def of(cls, transforms: Mapping[tuple[str, str], Rows], described: Mapping[tuple[str, str], Rigid]) -> "Frames":
        """From the transforms of a bag, and from its description where these leave a frame out."""
        parents: dict[str, str] = {}
        edges: dict[str, Rigid] = {}
        moving = set()
        for (parent, child), rows in sorted(transforms.items(), key=lambda entry: len(entry[1])):
            values = rows.values
            parents[child] = parent
            edges[child] = Rigid.of(tuple(values[len(values) // 2].tolist()))
            moving.discard(child)
            if _moves(rows):
                moving.add(child)
        for (parent, child), pose in described.items():
            if child not in parents:
                parents[child], edges[child] = parent, pose
        return cls(parents=parents, edges=edges, moving=frozenset(moving))

    def above(self, frame: str) -> list[str]:
        """The frame, what it sits on, and so on up."""
        chain = [frame]
        while (parent := self.parents.get(chain[-1])) is not None and parent not in chain:
            chain.append(parent)
        return chain

    def between(self, frame: str, other: str) -> tuple[Rigid, list[str]] | None:
        """The pose of the other frame in one, and which frames on the way move; None where nothing joins them."""
        ours, theirs = self.above(frame), self.above(other)
        common = next((name for name in ours if name in theirs), None)
        if common is None:
            return None
        up, down = ours[: ours.index(common)], theirs[: theirs.index(common)]
        pose = self._pose(up).inverse().compose(self._pose(down))
        return pose, [name for name in (*up, *down) if name in self.moving]

    def _pose(self, chain: list[str]) -> Rigid:
        """The pose of the first of a chain in the parent of its last."""
        pose = Rigid()
        for name in reversed(chain):
            pose = pose.compose(self.edges[name])
        return pose


def _moves(rows: Rows) -> bool:
    values = rows.values
    poses = planar_poses(values)
    turned = np.abs(wrap_angle(poses[:, 2] - poses[0, 2]))
    return bool(np.ptp(values[:, :3], axis=0).max() > _STILL[0] or turned.max() > _STILL[1])

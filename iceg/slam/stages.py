"""The stages of a run that can be replaced, one by one, by functions of the caller's own."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from frontends.checked_arguments import type_name
from frontends.matcher import Matcher
from frontends.scan import Scan, ScanGeometry
from graph.arrays import Float32s, Floats
from graph.errors import IcegError
from graph.factors import Factor
from iceg.ice.features import Features
from iceg.maps.config import GridConfig
from iceg.maps.grid import OccupancyGrid
from iceg.slam.closures.attempt import Attempt
from iceg.slam.closures.candidates import Candidate
from iceg.slam.track import KeyScan


class StageError(IcegError):
    """A stage of the caller's own returned what the run cannot go on with."""


class FeatureExtractor(Protocol):
    """Finds what a scan has of corners, ends of walls and intersections."""

    def __call__(self, scan: Scan, /) -> Features:
        """The features of a scan in the robot frame: ICE matches by them, and landmarks are made of the real ones."""
        ...


class LoopCandidates(Protocol):
    """Says where loops may close."""

    def __call__(self, key_new: int, keys: Sequence[KeyScan], poses: Floats, /) -> Sequence[Candidate]:
        """Earlier key scans that may show the place of a new one; each is matched and verified.

        Args:
            key_new: index of the new key scan.
            keys: the key scans up to it.
            poses: (key_new + 1, 3) T_map_robot of them, as estimated now.
        """
        ...


class ClosureVerification(Protocol):
    """Says which matches to earlier places are believed."""

    def __call__(self, attempt: Attempt, keys: Sequence[KeyScan], poses: Floats, /) -> Attempt:
        """The attempt with another verdict: `accepted`, and the `reason`.

        Args:
            attempt: that matched, with iceg's own verdict.
            keys: the key scans up to the later of the two.
            poses: (n, 3) T_map_robot of these at least, as estimated now.
        """
        ...


class RobustSolver(Protocol):
    """Solves the graph of the whole log."""

    def __call__(self, factors: Sequence[Factor], poses: Floats, /) -> Floats:
        """The most likely key poses.

        Args:
            factors: each with the robust kernel that iceg would give it, None for none.
            poses: (n, 3) first guesses of T_map_robot.

        Returns:
            (n, 3).
        """
        ...


class GridRenderer(Protocol):
    """Draws the occupancy grid."""

    def __call__(
        self, trajectory: Floats, ranges: Float32s, geometry: ScanGeometry, config: GridConfig, /
    ) -> OccupancyGrid:
        """The grid; see `iceg.render_grid`, which is one."""
        ...


@dataclass(frozen=True, kw_only=True)
class Stages:
    """What of a run the caller replaces; what is None is iceg's own.

    Attributes:
        features: corners, ends of walls and intersections of a scan, for ICE and for the feature map.
        matcher: matches scans; None for the one that the settings name.
        candidates: where loops may close, asked as often as the settings space the searches. The finish, which matches
            passes again that lie side by side, asks nobody.
        verification: which closures are believed, on top of whether they fit the path.
        solver: of the whole graph, after the log has been read and after matching again.
        grid: the occupancy grid.

    Raises:
        TypeError: the matcher is no object that has `prepare` and `match`.
    """

    features: FeatureExtractor | None = None
    matcher: Matcher | None = None
    candidates: LoopCandidates | None = None
    verification: ClosureVerification | None = None
    solver: RobustSolver | None = None
    grid: GridRenderer | None = None

    def __post_init__(self) -> None:
        matcher = self.matcher
        is_matcher = callable(getattr(matcher, "prepare", None)) and callable(getattr(matcher, "match", None))
        if matcher is not None and (isinstance(matcher, type) or not is_matcher):
            raise TypeError(f"matcher: found {type_name(matcher)}, expected an object that has prepare and match")


IN_HOUSE = Stages()
"""All stages iceg's own."""


def checked_candidates(found: Sequence[Candidate], key_new: int) -> list[Candidate]:
    """Candidates of the caller's own.

    Raises:
        StageError: one is not of an earlier key scan and the new one.
    """
    for candidate in found:
        if candidate.key_new != key_new or not 0 <= candidate.key_old < key_new:
            raise StageError(
                f"candidates: found key scans {candidate.key_old} and {candidate.key_new}, expected an earlier one "
                f"and {key_new}"
            )
    return list(found)


def checked_poses(found: Floats, n_keys: int) -> Floats:
    """Key poses of the caller's own solver.

    Raises:
        StageError: they are not (n_keys, 3) finite numbers.
    """
    poses = np.asarray(found, dtype=np.float64)
    if poses.shape != (n_keys, 3) or not np.isfinite(poses).all():
        raise StageError(f"solver: found poses of shape {poses.shape}, expected {(n_keys, 3)} finite numbers")
    return poses

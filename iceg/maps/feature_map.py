"""The feature map: landmarks anchored to key poses, fused when seen again, forgotten when no longer there."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Scan
from graph import dense
from graph.elementary import arctan2, cos_sin
from graph.se2 import wrap_angle
from iceg.ice.features import KIND_NAMES, Features
from iceg.maps import _landmark_kernels as kernels
from iceg.maps.config import FeatureMapConfig, FeatureMapError
from iceg.maps.landmark_arrays import FEATURE, LANDMARK, Observed, Records, Settings

_AT_ONCE = 1000
"""So many key scans are entered by one call; their features need memory together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Landmarks:
    """n landmarks placed in the map frame, as parallel arrays.

    Attributes:
        ids: (n,) int64 number of each landmark, in order of appearance.
        kinds: (n,) int8: CORNER, END_OF_WALL or INTERSECTION of `iceg.ice.features`.
        positions: (n, 2) [m], map frame.
        directions: (n, 2) headings of the walls that start at the landmark [rad], map frame: the one on the clockwise
            side as seen from the open side, and the one on the counter-clockwise side; NaN: no such wall.
        covariances: (n, 2, 2) of the positions [m²], map frame, relative to the anchor (its own error is not in it).
        direction_variances: (n, 2) [rad²]; NaN where there is no such wall.
        distances: (n,) shortest distance from the laser when observed [m].
        anchors: (n,) key pose each landmark is anchored to.
        first_seen: (n,) key pose of the first observation.
        last_seen: (n,) key pose of the latest observation.
        seen: (n,) number of observations.
        missed: (n,) how often it lay in the visible area and was not seen.
        expired_at: (n,) key pose at which it expired, -1 while it is valid.
    """

    ids: NDArray[np.int64]
    kinds: NDArray[np.int8]
    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    direction_variances: NDArray[np.float64]
    distances: NDArray[np.float64]
    anchors: NDArray[np.int64]
    first_seen: NDArray[np.int64]
    last_seen: NDArray[np.int64]
    seen: NDArray[np.int64]
    missed: NDArray[np.int64]
    expired_at: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of landmarks."""
        return len(self.kinds)

    def __getitem__(self, selection: NDArray[Any]) -> "Landmarks":
        """The landmarks that a boolean mask or an index array selects."""
        return Landmarks(**{f.name: getattr(self, f.name)[selection] for f in fields(self)})

    def __repr__(self) -> str:
        counts = np.bincount(self.kinds[self.expired_at < 0], minlength=len(KIND_NAMES)).tolist()
        kinds = ", ".join(f"{count} {name}" for count, name in zip(counts, KIND_NAMES, strict=True))
        expired = int((self.expired_at >= 0).sum())
        return f"Landmarks({len(self)}, {len(self.settled())} of them settled: {kinds}, {expired} expired)"

    def settled(self, min_seen: int = 3) -> "Landmarks":
        """Those that have not expired and were seen at least so many times: the ones that pictures show."""
        return self[(self.seen >= min_seen) & (self.expired_at < 0)]

    def features(self) -> Features:
        """The same landmarks as features in the map frame, for matching against them."""
        variances = np.where(np.isnan(self.direction_variances), 0.0, self.direction_variances).max(axis=1, initial=0.0)
        return Features(
            kinds=self.kinds,
            positions=self.positions,
            directions=self.directions,
            covariances=self.covariances,
            direction_variances=variances,
            distances=self.distances,
            real=np.ones(len(self), dtype=np.bool_),
        )


class FeatureMap:
    """Landmarks collected from key scans, each in the frame of the key pose that saw it first.

    Nothing is baked into the map frame: moved key poses move their landmarks. A landmark that lies in the visible area
    of key scans, not occluded, and is seen too rarely expires; it stays in the record.
    """

    def __init__(self, config: FeatureMapConfig | None = None) -> None:
        self.config = config or FeatureMapConfig()
        self._frames = np.full((64, 4), np.nan)
        self._count = 0
        self._landmarks: Records = np.zeros(256, LANDMARK)
        self._valid = np.zeros(0, np.int64)

    def __len__(self) -> int:
        """Number of landmarks, expired ones included."""
        return self._count

    def observe(self, key_index: int, T_map_key: NDArray[np.float64], features: Features, scan: Scan) -> None:
        """Enter the features of one key scan.

        Args:
            key_index: index of the key pose, ≥ 0; key scans come in time order.
            T_map_key: (3,) its pose.
            features: the features of its scan, robot frame. Only real ones become landmarks.
            scan: the scan, for what it could have seen.

        Raises:
            FeatureMapError: if the pose is not finite.
        """
        self._place(key_index, T_map_key)
        self._enter(key_index, [features], [scan])

    def observe_all(
        self, key_poses: NDArray[np.float64], key_features: Iterable[Features], key_scans: Iterable[Scan]
    ) -> None:
        """Enter the features of key scans into an empty map, as `observe` does one by one.

        Args:
            key_poses: (n_keys, 3) T_map_key of each key scan, numbered as given.
            key_features: their features.
            key_scans: the scans.

        Raises:
            FeatureMapError: if a pose is not finite.
        """
        keys = zip(key_poses, key_features, key_scans, strict=True)
        first = 0
        for _, group in itertools.groupby(keys, key=lambda key: id(key[2].geometry)):
            while some := list(itertools.islice(group, _AT_ONCE)):
                poses, features, scans = zip(*some, strict=True)
                for key_index, T_map_key in enumerate(poses, first):
                    self._place(key_index, T_map_key)
                self._enter(first, features, scans)
                first += len(scans)

    def move(self, key_poses: NDArray[np.float64]) -> None:
        """Move the key poses, and with them their landmarks, before further observations.

        Args:
            key_poses: (n_keys, 3) T_map_key of key poses 0 … n_keys - 1.
        """
        for key_index, T_map_key in enumerate(key_poses):
            self._place(key_index, T_map_key)

    def landmarks(self, key_poses: NDArray[np.float64] | None = None) -> Landmarks:
        """The valid landmarks in the map frame.

        Args:
            key_poses: (n_keys, 3) T_map_key of all key poses observed from; those given to `observe` when left out.

        Returns:
            The landmarks that have not expired.

        Raises:
            FeatureMapError: if the pose of an anchor is not among key_poses.
        """
        record = self.record(key_poses)
        return record[record.expired_at < 0]

    def record(self, key_poses: NDArray[np.float64] | None = None) -> Landmarks:
        """All landmarks in the map frame, expired ones included.

        Args:
            key_poses: (n_keys, 3) T_map_key of all key poses observed from; those given to `observe` when left out.

        Raises:
            FeatureMapError: if the pose of an anchor is not among key_poses.
        """
        landmarks = self._landmarks[: self._count]
        frames = self._frames if key_poses is None else _frames(np.asarray(key_poses, dtype=np.float64))
        anchors = landmarks["anchor"].copy()
        if len(anchors) and anchors.max() >= len(frames):
            raise FeatureMapError(f"a landmark is anchored to key pose {anchors.max()}, given are {len(frames)}")
        x, y, cos, sin = frames[anchors].T
        rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        positions = np.stack([x, y], -1) + dense.matvec(rotation, landmarks["position"])
        directions = landmarks["directions"] + arctan2(sin, cos)[:, None]
        return Landmarks(
            ids=np.arange(self._count),
            kinds=landmarks["kind"].copy(),
            positions=positions,
            directions=wrap_angle(directions),
            covariances=dense.congruence(rotation, landmarks["covariance"]),
            direction_variances=landmarks["direction_variances"].copy(),
            distances=landmarks["distance"].copy(),
            anchors=anchors,
            first_seen=landmarks["first_seen"].copy(),
            last_seen=landmarks["last_seen"].copy(),
            seen=landmarks["seen"].copy(),
            missed=landmarks["missed"].copy(),
            expired_at=landmarks["expired_at"].copy(),
        )

    def _place(self, key_index: int, T_map_key: NDArray[np.float64]) -> None:
        if key_index < 0 or not np.isfinite(T_map_key).all():
            raise FeatureMapError(f"key pose {key_index} is {T_map_key}, expected an index ≥ 0 and finite numbers")
        if key_index >= len(self._frames):
            longer = np.full((2 * key_index + 1, 4), np.nan)
            longer[: len(self._frames)] = self._frames
            self._frames = longer
        x, y, heading = (float(value) for value in T_map_key)
        self._frames[key_index] = x, y, math.cos(heading), math.sin(heading)

    def _enter(self, first_key: int, key_features: Sequence[Features], key_scans: Sequence[Scan]) -> None:
        """Enter the features of key scans, taken by one laser at key poses that have their places."""
        geometry = key_scans[0].geometry
        ranges = np.stack([scan.ranges for scan in key_scans])
        observed = Observed(
            features=_records(key_features),
            ranges=ranges[0],
            bearings=np.ascontiguousarray(geometry.bearings),
            T_robot_laser=np.ascontiguousarray(geometry.T_robot_laser),
        )
        ends = np.cumsum([len(features) for features in key_features])
        self._reserve(self._count + int(ends[-1]))
        valid = np.concatenate([self._valid, np.empty(ends[-1], np.int64)])
        settings = _kernel_settings(self.config, geometry.range_max)
        self._count, n_valid = kernels.observe(
            first_key,
            ends,
            self._frames,
            observed,
            ranges,
            self._landmarks,
            valid,
            len(self._valid),
            self._count,
            settings,
        )
        self._valid = valid[:n_valid]

    def _reserve(self, capacity: int) -> None:
        if capacity > len(self._landmarks):
            longer: Records = np.zeros(2 * capacity, LANDMARK)
            longer[: self._count] = self._landmarks[: self._count]
            self._landmarks = longer


def build_feature_map(
    key_poses: NDArray[np.float64],
    key_features: Iterable[Features],
    key_scans: Iterable[Scan],
    config: FeatureMapConfig | None = None,
) -> FeatureMap:
    """Replay key scans over a trajectory.

    Args:
        key_poses: (n_keys, 3) T_map_key.
        key_features: the features of each key scan, robot frame.
        key_scans: the key scans.
        config: settings; the defaults when left out.

    Returns:
        The feature map, with key poses numbered as given.
    """
    feature_map = FeatureMap(config)
    feature_map.observe_all(key_poses, key_features, key_scans)
    return feature_map


def _frames(key_poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4) x, y, cosine and sine of poses."""
    return np.stack([key_poses[:, 0], key_poses[:, 1], *cos_sin(key_poses[:, 2])], axis=1)


def _records(scans_features: Sequence[Features]) -> Records:
    """(n,) `FEATURE` each: those of all scans."""
    records: Records = np.empty(sum(map(len, scans_features)), FEATURE)
    for name, field in zip(FEATURE.names or (), fields(Features), strict=True):
        records[name] = np.concatenate([getattr(features, field.name) for features in scans_features])
    return records


def _kernel_settings(config: FeatureMapConfig, range_max: float) -> Settings:
    true, false = config.detection_probability, config.false_detection_probability
    return Settings(
        gate=config.gate,
        max_distance=config.max_distance,
        max_angle=config.max_angle,
        pose_variance=config.pose_sigma**2,
        heading_variance=config.heading_sigma**2,
        drift_variance=config.drift_sigma**2,
        landmark_range=config.landmark_range,
        landmark_variance=config.landmark_sigma**2,
        visible_range=float(min(config.visible_range, range_max)),
        occlusion_margin=config.occlusion_margin,
        sin_edge_on=math.sin(config.edge_on),
        seen_evidence=math.log(true / false),
        missed_evidence=math.log((1.0 - true) / (1.0 - false)),
        highest_evidence=math.log(config.longest_memory / (1.0 - config.longest_memory)),
        expiry_evidence=math.log(config.expiry / (1.0 - config.expiry)),
    )

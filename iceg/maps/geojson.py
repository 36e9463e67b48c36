"""Landmarks as GeoJSON."""

from functools import cache
from pathlib import Path

import numpy as np

from graph.atomic import write_atomically
from graph.se2 import wrap_angle
from iceg.ice.features import KIND_NAMES
from iceg.maps.config import FeatureMapError
from iceg.maps.feature_map import Landmarks

_HEAD = '{"type": "FeatureCollection", "frame": "map", "units": {"length": "m", "angle": "rad"}, "features": [\n'


def write_geojson(landmarks: Landmarks, path: Path | str) -> None:
    """Write landmarks as GeoJSON points, one a line, in metres of the map frame.

    Lengths and angles are written to a millionth, variances to six digits.

    Args:
        landmarks: valid ones, or a record with expired ones.
        path: the file.

    Raises:
        FeatureMapError: a number that should be there is not finite.
    """
    path = Path(path)
    write_atomically(path, f"{_HEAD}{_features(landmarks)}\n]}}\n".encode())


def _features(landmarks: Landmarks) -> str:
    """All features by one formatting of all numbers: each has the places for those it has."""
    walls = np.isfinite(landmarks.directions)
    expired = landmarks.expired_at >= 0
    columns = (
        landmarks.ids[:, None],
        landmarks.positions,
        landmarks.directions,
        landmarks.direction_variances,
        np.abs(wrap_angle(landmarks.directions[:, 0] - landmarks.directions[:, 1]))[:, None],
        landmarks.covariances.reshape(-1, 4),
        *(numbers[:, None] for numbers in (landmarks.anchors, landmarks.first_seen, landmarks.last_seen)),
        *(numbers[:, None] for numbers in (landmarks.seen, landmarks.missed, landmarks.expired_at)),
    )
    table = np.concatenate(columns, axis=1, dtype=np.float64)
    known = np.ones(table.shape, dtype=np.bool_)
    known[:, 3:5] = known[:, 5:7] = walls
    known[:, 7], known[:, -1] = walls.all(axis=1), expired
    broken = np.flatnonzero((known & ~np.isfinite(table)).any(axis=1))
    if len(broken):
        raise FeatureMapError(f"landmark {landmarks.ids[broken[0]]}: found a number that is not finite")
    places = map(_places, landmarks.kinds.tolist(), walls.sum(axis=1).tolist(), expired.tolist())
    return ",\n".join(places) % tuple(table[known].tolist())


@cache
def _places(kind: int, walls: int, expired: bool) -> str:
    """One feature, with a place for each of its numbers."""
    directions, variances = ", ".join(["%.6f"] * walls), ", ".join(["%.6g"] * walls)
    return (
        '{"type": "Feature", "id": %d, "geometry": {"type": "Point", "coordinates": [%.6f, %.6f]}, '
        f'"properties": {{"kind": "{KIND_NAMES[kind]}", "directions": [{directions}], '
        f'"direction_variances": [{variances}], "opening_angle": {"%.6f" if walls == 2 else "null"}, '
        '"covariance": [[%.6g, %.6g], [%.6g, %.6g]], "anchor": %d, "first_seen": %d, "last_seen": %d, '
        f'"seen": %d, "missed": %d, "expired_at": {"%d" if expired else "null"}}}}}'
    )

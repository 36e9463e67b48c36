"""Landmarks as GeoJSON."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frontends.scan import Scan, ScanGeometry
from iceg.ice.features import CORNER, END_OF_WALL, Features
from iceg.maps.config import FeatureMapError
from iceg.maps.feature_map import FeatureMap
from iceg.maps.geojson import write_geojson

NAN = math.nan


def feature(kind: int, x: float, y: float, clockwise: float, counter_clockwise: float) -> Features:
    return Features(
        kinds=np.array([kind], dtype=np.int8),
        positions=np.array([[x, y]]),
        directions=np.array([[clockwise, counter_clockwise]]),
        covariances=0.02**2 * np.eye(2)[None],
        direction_variances=np.array([0.02**2]),
        distances=np.array([math.hypot(x, y)]),
        real=np.array([True]),
    )


def two_landmarks() -> FeatureMap:
    """A corner, and an end of wall seen from a key pose that is turned."""
    bearings = np.radians(np.arange(-90.0, 91.0))
    nothing = Scan(
        ranges=np.full(len(bearings), NAN, np.float32),
        geometry=ScanGeometry(bearings=bearings, range_min=0.05, range_max=20.0),
    )
    feature_map = FeatureMap()
    feature_map.observe(0, np.zeros(3), feature(CORNER, 2.0, 1.0, 0.5, 2.0), nothing)
    feature_map.observe(1, np.array([10.0, 0.0, 1.0]), feature(END_OF_WALL, 1.0, -2.0, NAN, 0.3), nothing)
    return feature_map


def test_geojson_tells_all_there_is_to_know(tmp_path: Path) -> None:
    feature_map = two_landmarks()
    write_geojson(feature_map.landmarks(), tmp_path / "features.geojson")
    content = json.loads((tmp_path / "features.geojson").read_text(encoding="utf-8"))
    assert content["type"] == "FeatureCollection"
    corner, end = content["features"]
    assert corner["geometry"] == {"type": "Point", "coordinates": [2.0, 1.0]}
    assert corner["properties"] == {
        "kind": "corner",
        "directions": [0.5, 2.0],
        "direction_variances": [0.0004, 0.0004],
        "opening_angle": 1.5,
        "covariance": [[0.0004, 0.0], [0.0, 0.0004]],
        "anchor": 0,
        "first_seen": 0,
        "last_seen": 0,
        "seen": 1,
        "missed": 0,
        "expired_at": None,
    }
    assert end["properties"]["kind"] == "end_of_wall"
    assert end["properties"]["directions"] == [1.3]
    assert end["properties"]["opening_angle"] is None
    assert [path.name for path in tmp_path.iterdir()] == ["features.geojson"]


def test_geojson_of_an_empty_map_is_valid(tmp_path: Path) -> None:
    write_geojson(FeatureMap().landmarks(), tmp_path / "features.geojson")
    assert json.loads((tmp_path / "features.geojson").read_text(encoding="utf-8"))["features"] == []


def test_geojson_writes_what_is_unknown_as_missing_and_each_number_as_it_is(tmp_path: Path) -> None:
    feature_map = two_landmarks()
    corner = feature_map.record()[np.array([0])]
    odd = replace(
        corner,
        ids=np.array([7]),
        kinds=np.array([2], dtype=np.int8),
        positions=np.array([[-1234.5678901, 2e-7]]),
        directions=np.array([[NAN, NAN]]),
        direction_variances=np.array([[NAN, NAN]]),
        covariances=np.array([[[1.23456789e-9, -3.0], [-3.0, 1234567.0]]]),
        expired_at=np.array([12]),
    )
    write_geojson(odd, tmp_path / "odd.geojson")
    (feature,) = json.loads((tmp_path / "odd.geojson").read_text(encoding="utf-8"))["features"]
    assert feature["id"] == 7
    assert feature["geometry"]["coordinates"] == [-1234.56789, 0.0]
    properties = feature["properties"]
    assert (properties["kind"], properties["expired_at"]) == ("intersection", 12)
    assert (properties["directions"], properties["direction_variances"], properties["opening_angle"]) == ([], [], None)
    assert properties["covariance"] == [[1.23457e-9, -3.0], [-3.0, 1234570.0]]


@pytest.mark.parametrize("name", ["positions", "covariances", "direction_variances"])
def test_geojson_holds_no_number_that_json_lacks(tmp_path: Path, name: str) -> None:
    feature_map = two_landmarks()
    landmarks = feature_map.landmarks()
    getattr(landmarks, name)[1].flat[-1] = math.inf
    getattr(landmarks, name)[0].flat[0] = math.inf
    with pytest.raises(FeatureMapError, match="landmark 0: found a number that is not finite"):
        write_geojson(landmarks, tmp_path / "features.geojson")
    assert not list(tmp_path.iterdir())

"""map.yaml and map.pgm by the rules of the map servers of ROS 1 and nav2, which say them in code only.

nav2_map_server's `loadMapYaml` and `loadMapFromFile`, written down again: which keys there must be and of what type,
where the image is looked for, and how a grey becomes a cell.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image
from ruamel.yaml import YAML

from iceg.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, write_ros_map

CLASSES = np.array([[FREE, OCCUPIED, UNKNOWN], [OCCUPIED, FREE, FREE]], np.int8)
LOG_ODDS = {FREE: -3.0, OCCUPIED: 3.0, UNKNOWN: 0.0}


@pytest.fixture
def description(tmp_path: Path) -> Path:
    log_odds = np.vectorize(LOG_ODDS.get)(CLASSES).astype(np.float32)
    grid = OccupancyGrid(log_odds=log_odds, origin=np.array([-12.345678901, 1e-7]), resolution=0.05)
    return write_ros_map(grid, tmp_path)[1]


def loaded(description: Path) -> dict[str, Any]:
    """As `loadMapYaml`: each key has to convert, or the map is refused."""
    document = YAML(typ="safe").load(description.read_text())
    image = str(document["image"])
    assert image
    origin = [float(number) for number in document["origin"]]
    assert len(origin) == 3
    mode = document.get("mode", "trinary")
    assert mode in {"trinary", "scale", "raw"}
    assert isinstance(document["negate"], int)
    return {
        "image": Path(image) if image.startswith("/") else description.parent / image,
        "resolution": float(document["resolution"]),
        "origin": origin,
        "free": float(document["free_thresh"]),
        "occupied": float(document["occupied_thresh"]),
        "mode": mode,
        "negate": bool(document["negate"]),
    }


def cells(parameters: dict[str, Any]) -> NDArray[np.int8]:
    """As `loadMapFromFile`: the image's top row is the message's last, shades are compared strictly."""
    image = Image.open(parameters["image"])
    assert image.mode == "L"  # no alpha, which modes treat differently
    shade = np.round(np.asarray(image).astype(float) * 257) / 65535  # the image library's 16 bits
    occupied = shade if parameters["negate"] else 1.0 - shade
    if parameters["mode"] == "raw":
        percent = np.floor(shade * 255 + 0.5)
        return np.where(percent <= OCCUPIED, percent, UNKNOWN).astype(np.int8)[::-1]
    between = np.full(shade.shape, UNKNOWN)
    if parameters["mode"] == "scale":
        span = parameters["occupied"] - parameters["free"]
        between = np.rint((occupied - parameters["free"]) / span * 100.0).astype(int)
    found = np.where(occupied < parameters["free"], FREE, between)
    return np.where(parameters["occupied"] < occupied, OCCUPIED, found).astype(np.int8)[::-1]


@settings(max_examples=30)
@given(arrays(np.int8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from(sorted(LOG_ODDS))))
def test_any_grid_reads_back(tmp_path_factory: pytest.TempPathFactory, classes: NDArray[np.int8]) -> None:
    log_odds = np.vectorize(LOG_ODDS.get, otypes=[np.float32])(classes)
    grid = OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), resolution=0.1)
    parameters = loaded(write_ros_map(grid, tmp_path_factory.mktemp("map"))[1])
    np.testing.assert_array_equal(cells(parameters), classes)


@pytest.mark.parametrize(
    ("changed", "unknown"),
    [({"mode": "scale"}, FREE), ({"free": 0.25}, FREE), ({"mode": "raw"}, UNKNOWN), ({"negate": True}, OCCUPIED)],
)
def test_what_an_edited_description_would_make_of_the_unknown(
    description: Path, changed: dict[str, Any], unknown: int
) -> None:
    """Savers of nav2 write 0.25 for a grey of their own, scale for images with alpha: neither goes with map.pgm."""
    found = cells(loaded(description) | changed)
    assert set(found[CLASSES == UNKNOWN]) == {unknown}


def test_map_servers_find_every_cell_as_it_is(description: Path) -> None:
    parameters = loaded(description)
    assert (parameters["mode"], parameters["negate"]) == ("trinary", False)
    assert 0.0 <= parameters["free"] < parameters["occupied"] <= 1.0
    np.testing.assert_array_equal(cells(parameters), CLASSES)


def test_where_the_map_lies(description: Path) -> None:
    parameters = loaded(description)
    assert parameters["resolution"] == 0.05
    assert parameters["origin"] == pytest.approx([-12.3456789, 1e-7, 0.0], abs=1e-7)
    assert parameters["image"] == description.parent / "map.pgm"

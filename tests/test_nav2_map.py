"""map.yaml and map.pgm by the rules of the map servers of ROS 1 and nav2, which say them in code only.

nav2_map_server's `loadMapYaml` and `loadMapFromFile`, written down again: which keys there must be and of what type,
where the image is looked for, and how a grey becomes a cell.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
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


def cells(parameters: dict[str, Any], free_threshold: float) -> NDArray[np.int8]:
    """As `loadMapFromFile` in trinary mode: rows from the top of the image, shades compared strictly."""
    grey = np.asarray(Image.open(parameters["image"]))
    assert grey.ndim == 2
    shade = np.round(grey.astype(float) * 257) / 65535  # the image library's 16 bits
    occupied = shade if parameters["negate"] else 1.0 - shade
    found = np.full(grey.shape, UNKNOWN, np.int8)
    found[occupied < free_threshold] = FREE
    found[parameters["occupied"] < occupied] = OCCUPIED
    return found[::-1]


def test_map_servers_find_every_cell_as_it_is(description: Path) -> None:
    parameters = loaded(description)
    assert (parameters["mode"], parameters["negate"]) == ("trinary", False)
    assert 0.0 <= parameters["free"] < parameters["occupied"] <= 1.0
    np.testing.assert_array_equal(cells(parameters, parameters["free"]), CLASSES)


def test_where_the_map_lies(description: Path) -> None:
    parameters = loaded(description)
    assert parameters["resolution"] == 0.05
    assert parameters["origin"] == pytest.approx([-12.3456789, 1e-7, 0.0], abs=1e-7)
    assert parameters["image"] == description.parent / "map.pgm"


def test_another_free_threshold_would_take_the_unknown_for_free(description: Path) -> None:
    """Map savers of nav2 write 0.25, for a grey of their own: map.yaml must not be edited to that."""
    assert (cells(loaded(description), 0.25) == FREE).sum() > (CLASSES == FREE).sum()

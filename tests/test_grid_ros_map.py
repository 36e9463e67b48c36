"""map.pgm and map.yaml, read back by map_server's rules."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from iceg.maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, write_ros_map


def read_yaml(path: Path) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in path.read_text(encoding="ascii").splitlines())


def read_pgm(path: Path) -> NDArray[np.uint8]:
    content = path.read_bytes()
    lines = [line for line in content.split(b"\n")[:4] if not line.startswith(b"#")]
    assert lines[0] == b"P5"
    width, height = map(int, lines[1].split())
    assert lines[2] == b"255"
    return np.frombuffer(content[-width * height :], np.uint8).reshape(height, width)


def map_server(yaml: Path) -> tuple[NDArray[np.int8], dict[str, Any]]:
    """The OccupancyGrid message of a trinary map: row 0 is the lowest, image row 0 the top."""
    description = read_yaml(yaml)
    assert description["mode"] == "trinary"
    assert description["negate"] == "0"
    occupancy = (255 - read_pgm(yaml.parent / description["image"]).astype(float)) / 255.0
    message = np.full(occupancy.shape, -1, np.int8)
    message[occupancy > float(description["occupied_thresh"])] = 100
    message[occupancy < float(description["free_thresh"])] = 0
    origin = [float(value) for value in description["origin"].strip("[]").split(",")]
    return message[::-1], {"resolution": float(description["resolution"]), "origin": origin}


def grid_of(probabilities: NDArray[np.float64]) -> OccupancyGrid:
    log_odds = np.log(probabilities / (1 - probabilities)).astype(np.float32)
    return OccupancyGrid(log_odds=log_odds, origin=np.array([-3.25, 17.1]), resolution=0.05)


@settings(max_examples=30)
@given(arrays(np.float64, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.floats(0.02, 0.98)))
def test_what_is_written_reads_back_as_the_same_classes(
    tmp_path_factory: pytest.TempPathFactory, probabilities: NDArray[np.float64]
) -> None:
    grid = grid_of(probabilities)
    _, yaml = write_ros_map(grid, tmp_path_factory.mktemp("map"))
    message, info = map_server(yaml)
    np.testing.assert_array_equal(message, grid.classes())
    assert info == {"resolution": 0.05, "origin": [-3.25, 17.1, 0.0]}


def test_a_corner_stays_where_it_is(tmp_path: Path) -> None:
    probabilities = np.full((4, 6), 0.5)
    probabilities[0, 0], probabilities[3, 5] = 0.9, 0.1  # lower left occupied, upper right free
    pgm, yaml = write_ros_map(grid_of(probabilities), tmp_path, stem="office")
    assert (pgm.name, yaml.name) == ("office.pgm", "office.yaml")
    image = read_pgm(pgm)
    assert image.shape == (4, 6)
    assert (image[-1, 0], image[0, -1], image[0, 0]) == (0, 254, 205)
    message, _ = map_server(yaml)
    assert (message[0, 0], message[3, 5], message[3, 0]) == (OCCUPIED, FREE, UNKNOWN)


def test_the_description_is_the_one_ros_writes(tmp_path: Path) -> None:
    _, yaml = write_ros_map(grid_of(np.full((2, 2), 0.5)), tmp_path)
    assert read_yaml(yaml) == {
        "image": "map.pgm",
        "mode": "trinary",
        "resolution": "0.05",
        "origin": "[-3.25, 17.1, 0.0]",
        "negate": "0",
        "occupied_thresh": "0.65",
        "free_thresh": "0.196",
    }


def test_files_are_replaced_whole_and_nothing_is_left_behind(tmp_path: Path) -> None:
    for size in (50, 3):
        write_ros_map(grid_of(np.full((size, size), 0.9)), tmp_path)
        assert read_pgm(tmp_path / "map.pgm").shape == (size, size)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]
    assert math.isclose(float(read_yaml(tmp_path / "map.yaml")["resolution"]), 0.05)


def test_a_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_ros_map(grid_of(np.full((2, 2), 0.9)), tmp_path)
    before = (tmp_path / "map.pgm").read_bytes()

    def refuse(self: Path, target: Path) -> None:
        raise OSError(f"no space for {target} from {self}")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="no space"):
        write_ros_map(grid_of(np.full((5, 5), 0.9)), tmp_path)
    assert (tmp_path / "map.pgm").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]

"""Pictures that Pillow, which reads them by the book, finds as they were."""

import io

import numpy as np
import pytest
from PIL import Image

from iceg.show.png import png_bytes


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (300, 211)], ids=str)
def test_pixels_and_resolution_are_read_back(shape: tuple[int, int]) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (*shape, 3), dtype=np.uint8)
    with Image.open(io.BytesIO(png_bytes(pixels, 220))) as picture:
        picture.load()
        assert (picture.format, picture.mode) == ("PNG", "RGB")
        assert picture.info["dpi"] == pytest.approx((220, 220), abs=0.02)
        np.testing.assert_array_equal(np.asarray(picture), pixels)


def test_damage_is_noticed() -> None:
    content = bytearray(png_bytes(np.full((4, 4, 3), 200, np.uint8), 220))
    content[-20] ^= 1
    with pytest.raises((OSError, SyntaxError)), Image.open(io.BytesIO(bytes(content))) as picture:
        picture.load()


def test_plain_areas_take_little_room() -> None:
    assert len(png_bytes(np.full((1000, 1000, 3), 255, np.uint8), 220)) < 20_000


def test_any_view_of_pixels_will_do() -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    assert png_bytes(pixels[::-1], 72) == png_bytes(pixels[::-1].copy(), 72)

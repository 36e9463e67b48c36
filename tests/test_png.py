"""PNG files: what another reader finds in them."""

import io

import numpy as np
import pytest
from PIL import Image

from iceg.show.png import encode_png


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 3), (300, 40, 3)])
def test_every_pixel_and_the_size_in_print_read_back(shape: tuple[int, int, int]) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    image = Image.open(io.BytesIO(encode_png(pixels, dots_per_inch=200)))
    assert image.mode == "RGB"
    np.testing.assert_array_equal(np.asarray(image), pixels)
    assert image.info["dpi"] == pytest.approx((200, 200), abs=0.1)


def test_rows_that_are_no_copy_of_their_own_read_back() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    mirrored = pixels[::-1, ::2]
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(encode_png(mirrored, dots_per_inch=96)))), mirrored)


def test_even_areas_take_hardly_any_room() -> None:
    assert len(encode_png(np.full((1000, 1000, 3), 232, dtype=np.uint8), dots_per_inch=96)) < 30_000

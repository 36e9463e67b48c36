"""Lasers whose beams are numbered from 0 to 2π see as much as those numbered from -π to π."""

import math

import numpy as np
import pytest

from iceg.ice import _visibility_kernels as kernels
from tests.kernels import from_python

PLACE = from_python(kernels._place)
N_BEAMS = 360
RESOLUTION = 2.0 * math.pi / N_BEAMS
HERE = (0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize("first", [-math.pi, 0.0, -math.pi / 2])
def test_a_surface_is_seen_by_the_beam_that_points_at_it(first: float) -> None:
    for beam in range(2, N_BEAMS - 2):
        bearing = first + RESOLUTION * beam
        x, y = 3.0 * math.cos(bearing), 3.0 * math.sin(bearing)
        found, distance, _ = PLACE(x, y, -x / 3.0, -y / 3.0, HERE, first, RESOLUTION, N_BEAMS, 10.0)
        assert found == beam
        assert distance == pytest.approx(3.0)


def test_beside_the_view_there_is_no_beam() -> None:
    for bearing in np.radians([-170.0, -100.0, 100.0, 179.0]):
        x, y = 3.0 * math.cos(bearing), 3.0 * math.sin(bearing)
        assert PLACE(x, y, 0.0, 0.0, HERE, -math.pi / 2, math.radians(1.0), 181, 10.0)[0] == -1

"""What counts as a covered laser, and as too little to speak against odometry."""

import numpy as np
import pytest

from frontends.scan import Scan, ScanGeometry
from iceg.slam.tracking.sight import sees_little, sees_nothing
from iceg.slam.tracking_config import SightConfig


def scan_of(n_beams: int, returns: int, distance: float) -> Scan:
    """So many beams return from a distance, and the rest not at all."""
    geometry = ScanGeometry(bearings=np.linspace(-1.5, 1.5, n_beams), range_min=0.0, range_max=80.0)
    ranges = np.full(n_beams, np.nan, np.float32)
    ranges[:returns] = distance
    return Scan(ranges=ranges, geometry=geometry)


@pytest.mark.parametrize(
    ("returns", "distance", "expected"),
    [
        (361, 0.3, True),  # something in front of the laser
        (30, 0.3, True),
        (0, 5.0, True),
        (30, 5.0, False),  # nearly all beams lost: how much wall holds a match tells what the rest is worth
        (30, 25.0, False),
    ],
)
def test_a_laser_is_covered_by_what_is_close_not_where_it_sees_little(
    returns: int, distance: float, expected: bool
) -> None:
    assert sees_nothing(scan_of(361, returns, distance), SightConfig()) == expected


@pytest.mark.parametrize(("returns", "distance", "expected"), [(30, 5.0, True), (30, 15.0, False), (34, 5.0, False)])
def test_few_returns_from_close_by_are_little(returns: int, distance: float, expected: bool) -> None:
    assert sees_little(scan_of(100, returns, distance), SightConfig()) == expected

"""What counts as a covered laser, and as too little to speak against odometry."""

import numpy as np
import pytest

from frontends.scan import Scan, ScanGeometry
from iceg.slam.tracking.sight import is_blind, sees_little
from iceg.slam.tracking_config import SightConfig


def scan_of(n_beams: int, returns: int, distance: float, others: int = 0) -> Scan:
    """So many beams return from a distance, some others from 2 m, and the rest not at all."""
    geometry = ScanGeometry(bearings=np.linspace(-1.5, 1.5, n_beams), range_min=0.0, range_max=80.0)
    ranges = np.full(n_beams, np.nan, np.float32)
    ranges[:returns] = distance
    ranges[returns : returns + others] = 2.0
    return Scan(ranges=ranges, geometry=geometry)


@pytest.mark.parametrize(
    ("n_beams", "returns", "distance", "expected"),
    [
        (361, 361, 0.3, True),  # something in front of the laser
        (361, 0, 5.0, True),
        (361, 30, 5.0, True),  # nearly all beams lost, and what is left is close by
        (361, 30, 25.0, False),  # a lawn, and a wall far away
        (361, 19, 25.0, True),
        (181, 18, 25.0, True),
        (181, 19, 5.0, False),
    ],
)
def test_a_laser_is_covered_by_what_is_close_not_by_open_ground(
    n_beams: int, returns: int, distance: float, expected: bool
) -> None:
    assert is_blind(scan_of(n_beams, returns, distance), SightConfig(), knows_motion=True) == expected


@pytest.mark.parametrize(
    ("returns", "distance", "expected"), [(361, 0.3, True), (0, 5.0, True), (30, 0.3, True), (30, 5.0, False)]
)
def test_where_nothing_else_tells_the_way_few_beams_are_better_than_none(
    returns: int, distance: float, expected: bool
) -> None:
    assert is_blind(scan_of(361, returns, distance), SightConfig(), knows_motion=False) == expected


def test_on_open_ground_most_of_what_is_seen_is_far() -> None:
    assert not is_blind(scan_of(361, 20, 25.0, others=15), SightConfig(), knows_motion=True)
    assert is_blind(scan_of(361, 15, 25.0, others=20), SightConfig(), knows_motion=True)


@pytest.mark.parametrize(("returns", "distance", "expected"), [(30, 5.0, True), (30, 15.0, False), (34, 5.0, False)])
def test_few_returns_from_close_by_are_little(returns: int, distance: float, expected: bool) -> None:
    assert sees_little(scan_of(100, returns, distance), SightConfig()) == expected

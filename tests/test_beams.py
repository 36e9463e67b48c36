"""Bearings of a sweep, and sweeps of other settings put on them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from frontends.logs.beams import Setup, find_beams, place_on_bearings, stack_sweeps, usual_setup

STEP = 0.1
TARGET = np.array([0.0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize(("shift", "first"), [(0.0, 1), (0.4, 1), (0.6, 2), (-0.4, 1), (-0.6, 0)])
def test_a_bearing_takes_the_nearest_beam_within_half_a_step(shift: float, first: int) -> None:
    beams = np.array([1.0 + shift, 2.0 + shift]) * STEP
    placed = place_on_bearings(np.array([3.0, 4.0], dtype=np.float32), beams, TARGET)
    expected = np.full(5, np.nan)
    expected[[first, first + 1]] = 3.0, 4.0
    assert_array_equal(placed, expected)


def test_a_sweep_without_beams_leaves_all_bearings_empty() -> None:
    none, no_bearings = np.empty(0, dtype=np.float32), np.empty(0)
    assert np.isnan(place_on_bearings(none, no_bearings, TARGET)).all()


def test_sweeps_are_stacked_on_the_usual_setting() -> None:
    setups = [Setup(181, None), Setup(361, None), Setup(181, None)]
    sweeps = [np.full(setup.n_beams, k + 1.0, dtype=np.float32) for k, setup in enumerate(setups)]
    usual = usual_setup(setups)
    assert usual == setups[0]
    stacked, bearings, warnings = stack_sweeps(sweeps, setups, usual, {})
    assert_array_equal(stacked, np.repeat([[1.0], [2.0], [3.0]], 181, axis=1))
    assert_allclose(bearings, find_beams(usual, {}).bearings)
    assert warnings == ["the beams change: 1 scans with 361 are placed on the bearings of the usual 181"]


def test_parameters_that_say_another_view_than_the_known_scanners_are_believed() -> None:
    around = find_beams(Setup(360, None), {"resolution": 1.0, "fov": 360.0}).bearings
    assert np.degrees(around[-1] - around[0]) == pytest.approx(359.0)
    known = find_beams(Setup(360, None), {}).bearings
    assert_array_equal(find_beams(Setup(360, None), {"resolution": 0.5, "fov": 180.0}).bearings, known)

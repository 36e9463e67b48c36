"""Time from scan to scan in usual ones, and whether a robot confirms it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from iceg.slam.recording.intervals import confirmed_intervals, usual_interval, waits

pauses = st.lists(st.sampled_from([1, 1, 1, 1, 2, 3, 7]), min_size=12, max_size=60).filter(
    lambda found: found.count(1) > len(found) // 2
)


def test_a_stamp_that_steps_back_makes_no_pause() -> None:
    stamps = np.array([0.0, 1.0, 2.0, 0.5, 3.0, 4.0, 5.0])
    assert usual_interval(stamps) == 1.0
    np.testing.assert_array_equal(waits(stamps), np.ones(6))


def test_shuffled_and_reversed_stamps_count_scans() -> None:
    stamps = np.arange(100.0)
    shuffled = np.random.default_rng(0).permutation(stamps)
    for each in (stamps[::-1], shuffled):
        np.testing.assert_array_equal(waits(each), np.ones(99))


@given(found=pauses, speed=st.floats(0.01, 2.0), unit=st.floats(0.01, 10.0))
def test_a_robot_that_goes_on_while_scans_are_missing_confirms_them(
    found: list[int], speed: float, unit: float
) -> None:
    elapsed = np.array(found, dtype=np.float64)
    stamps = 100.0 + unit * np.append(0.0, np.cumsum(elapsed))
    np.testing.assert_array_equal(confirmed_intervals(stamps, speed * elapsed), elapsed)


@given(found=pauses, speed=st.floats(0.01, 2.0))
def test_a_recorder_that_stamps_scans_when_it_gets_round_to_it_is_not_believed(found: list[int], speed: float) -> None:
    elapsed = np.array([1, *found, 5, 1, 1], dtype=np.float64)
    stamps = np.append(0.0, np.cumsum(elapsed))
    lengths = np.full(len(elapsed), speed)
    np.testing.assert_array_equal(confirmed_intervals(stamps, lengths), np.ones(len(elapsed)))


def test_few_scans_have_nothing_to_confirm() -> None:
    for n in range(4):
        assert len(confirmed_intervals(np.arange(float(n)), np.zeros(max(n - 1, 0)))) == max(n - 1, 0)

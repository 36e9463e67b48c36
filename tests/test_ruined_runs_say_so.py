"""What must never be: a map that may not be used for anything, and not a word about it."""

from pathlib import Path

import pytest

from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes


@pytest.mark.parametrize("seed", [82, 152, 236])
def test_a_ruined_run_says_so(seed: int) -> None:
    """Markets, corridors and rings in which the path slides along, most of them without odometry."""
    cell = Cell(group="random", source=f"random:{seed}")
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert not outcome.verdict.is_ruined_in_silence, (outcome.error_m, outcome.nees)


def test_a_view_that_changes_by_a_tenth_tears_no_path() -> None:
    """A campus without odometry: where tracking slipped by 20 cm the rest was once put 40 m aside."""
    cell = Cell(group="random", source="random:294")
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert outcome.error_m < 0.1


def test_a_laser_that_repeats_every_scan_is_survived(data_dir: Path) -> None:
    """Half the key poses once rested on nothing, and the path was lost six times: 0.7 m off."""
    cell = Cell(group="faults", source="mit-csail", fault="laser stuck 2")
    (outcome,) = outcomes(recording_of(cell, data_dir), [cell])
    assert outcome.error_m < 0.1


def test_a_robot_carried_to_a_place_that_looks_the_same_is_told(data_dir: Path) -> None:
    """Nothing but a contradiction of match and odometry gives it away: 8.5 m off without a word."""
    cell = Cell(group="worlds", source="25-school-lms8-poor", fault="carried")
    (outcome,) = outcomes(recording_of(cell, data_dir), [cell])
    assert not outcome.verdict.is_ruined_in_silence, (outcome.error_m, outcome.nees)

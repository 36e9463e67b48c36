"""What a run warns of is told in one line a kind."""

from iceg.slam.run_warning import RunWarning, in_short


def lost(scan: int) -> RunWarning:
    return RunWarning(kind="lost", sentence=f"tracking was lost at scan {scan}", scan=scan)


def test_many_of_a_kind_are_one_line_with_their_number_and_the_first_place() -> None:
    coarse = RunWarning(kind="coarse grid", sentence="the cells are wide")
    many, one = in_short([lost(90), coarse, *(lost(scan) for scan in range(45, 66))], "warnings in summary.json")
    assert many.startswith("tracking was lost at 22 places, first at scan 45; ")
    assert many.endswith("; see warnings in summary.json")
    assert one == "the cells are wide"


def test_a_single_one_is_told_as_it_is() -> None:
    assert in_short([lost(7)], "warnings in summary.json") == ["tracking was lost at scan 7"]
    assert in_short([], "") == []

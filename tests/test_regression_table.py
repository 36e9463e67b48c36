"""The regression table: what is called ruined or said, which cells there are, and what is kept of them."""

import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontends.logs import read_log
from frontends.simulator.random_scenes.devices import Quality
from frontends.simulator.random_scenes.scene import drawn_odometry
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.bench.tables import write_csv
from iceg.evaluation.degradation import DEGRADATIONS
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression import keep
from iceg.evaluation.regression.cells import GROUPS, LOGS, Cell, cells, chosen, close_cells
from iceg.evaluation.regression.comparison import changed_cells, compare
from iceg.evaluation.regression.kept import BASELINE
from iceg.evaluation.regression.lasers import LASERS
from iceg.evaluation.regression.outcome import Outcome, read_outcomes, write_outcomes
from iceg.evaluation.regression.random_cells import in_words, random_cells
from iceg.evaluation.regression.recordings import Recording, recording_of, with_noise
from iceg.evaluation.regression.runner import outcomes
from iceg.evaluation.regression.totals import Totals
from iceg.evaluation.regression.verdict import is_said, verdict
from iceg.evaluation.trajectory import read_truth_csv, trajectory_errors

_SILENT: dict[str, object] = {"lost_at_scans": [], "breaks": [], "warnings": []}
_OUTCOME = Outcome(
    group="logs",
    source="office",
    fault="none",
    seed=0,
    error_m=0.01,
    odometry_m=2.0,
    given_m=2.0,
    usual_m=0.0,
    is_said=False,
    nees=3.0,
    cpu_s=1.0,
)


def _outcome(**changes: object) -> Outcome:
    return replace(_OUTCOME, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("summary", "said"),
    [
        (_SILENT, False),
        (_SILENT | {"lost_at_scans": [12]}, True),
        (_SILENT | {"breaks": [{"scan": 3, "outcome": "apart", "moved_m": 0.0}]}, True),
        (_SILENT | {"warnings": ["the path is uncertain: …"]}, True),
        (_SILENT | {"warnings": ["there is no odometry (zero throughout)"]}, False),
    ],
)
def test_a_run_says_so_that_was_lost_or_broken_or_warns_of_more_than_its_log(
    summary: dict[str, object], said: bool
) -> None:
    assert is_said(summary, frozenset({"there is no odometry (zero throughout)"})) == said


@pytest.mark.parametrize(
    ("error", "odometry", "usual", "expected"),
    [
        (0.09, 0.5, 0.0, "good"),
        (0.11, 0.5, 0.0, "off"),
        (0.11, 6.0, 0.0, "good"),  # 2 % of the odometry's error
        (0.31, 5.0, 0.0, "ruined"),
        (0.31, 16.0, 0.0, "good"),
        (0.31, 5.0, 0.07, "off"),  # hardly worse than without the fault
        (0.36, 5.0, 0.07, "ruined"),
    ],
)
def test_good_and_ruined_are_told_by_the_error(error: float, odometry: float, usual: float, expected: str) -> None:
    found = verdict(error, odometry, False, usual)
    assert ("good" if found.is_good else "ruined" if found.is_ruined else "off") == expected


@given(
    error=st.floats(0.0, 100.0),
    odometry=st.floats(0.0, 100.0),
    usual=st.floats(0.0, 1.0),
    said=st.booleans(),
)
def test_a_verdict_is_one_of_good_off_and_ruined_and_silence_is_none_that_is_said(
    error: float, odometry: float, usual: float, said: bool
) -> None:
    found = verdict(error, odometry, said, usual)
    assert not (found.is_good and found.is_ruined)
    assert found.is_ruined == (found.is_ruined_and_said or found.is_ruined_in_silence)
    assert not (found.is_ruined_and_said and found.is_ruined_in_silence)
    assert found.is_off_in_silence == (not found.is_good and not said)
    assert verdict(error, odometry, not said, usual).is_good == found.is_good


def test_what_is_worse_than_its_odometry_counts_where_it_is_not_good() -> None:
    assert _outcome(error_m=0.2, given_m=0.17).is_worse_than_odometry
    assert not _outcome(error_m=0.05, given_m=0.04).is_worse_than_odometry
    assert not _outcome(error_m=0.2, given_m=0.3).is_worse_than_odometry
    assert not _outcome(error_m=0.2, given_m=None).is_worse_than_odometry


def test_totals_are_the_counts_and_means_of_a_table() -> None:
    table = [
        _outcome(error_m=0.01, nees=2.0),
        _outcome(error_m=0.04, nees=13.0),
        _outcome(error_m=2.0, nees=None),
        _outcome(error_m=2.0, is_said=True, nees=4.0, given_m=1.0),
        _outcome(error_m=0.2, nees=1.0),
    ]
    found = Totals.of(table)
    assert (found.cells, found.good, found.ruined_and_said, found.ruined_in_silence, found.off_in_silence) == (
        (5, 2, 1, 1, 2)
    )
    assert found.error_m == pytest.approx((0.01 * 0.04 * 2.0 * 2.0 * 0.2) ** 0.2)
    assert (found.nees, found.dishonest, found.worse) == (3.0, 0.25, 1)


def test_cells_have_names_of_their_own_and_the_short_form_holds_every_group(tmp_path: Path) -> None:
    for name in LOGS[1:]:
        (tmp_path / f"{name}.clf.gz").touch()
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "01-office-lms8-fair.clf.gz").touch()
    everything = cells(tmp_path)
    assert len({cell.name for cell in everything}) == len(everything)
    assert {cell.group for cell in everything if cell.is_short} == set(GROUPS)
    faults = [cell for cell in everything if cell.group == "faults" and cell.seed == 0 and cell.source in LOGS]
    assert len(faults) == len(LOGS) * len(DEGRADATIONS)
    assert {cell.source for cell in faults if cell.is_short} == set(LOGS)
    short = sum(cell.is_short for cell in faults)
    assert 0.1 * len(faults) <= short <= 0.2 * len(faults)
    assert len(chosen(tmp_path)) < len(chosen(tmp_path, short=False)) == len(everything)
    assert {cell.group for cell in chosen(tmp_path, ("worlds", "carried"))} == {"worlds", "carried"}


def test_without_public_logs_the_embedded_one_and_simulations_are_left() -> None:
    assert {cell.source for cell in cells(None) if cell.group in {"logs", "faults"}} == {"office"}
    with pytest.raises(EvaluationError, match="worlds"):
        chosen(None, ("worlds",))


def test_close_faults_come_with_any_seeds_of_noise(tmp_path: Path) -> None:
    found = close_cells(tmp_path, range(11, 13))  # no public logs there
    assert {cell.source for cell in found} == {"office"}
    assert [cell.seed for cell in found] == [11, 12] * (len(found) // 2)
    assert len({cell.name for cell in found}) == len(found) == 4


def test_random_scenes_are_chosen_by_their_seeds_and_the_wheels_they_draw() -> None:
    everything = random_cells("40-75")
    assert [cell.source for cell in everything] == [f"random:{seed}" for seed in range(40, 76)]
    by_wheels = [random_cells("40-75", (quality,)) for quality in get_args(Quality)]
    assert sorted(cell.name for some in by_wheels for cell in some) == sorted(cell.name for cell in everything)
    without = random_cells("40-75", ("none",))[0]
    assert not recording_of(without, None).log.has_odometry
    assert [cell.source for cell in random_cells("7")] == ["random:7"]
    assert in_words("40-75") == "random scenes 40-75"
    assert in_words("40-75", ("fair", "none")) == "random scenes 40-75, odometry fair or none"


def test_random_scenes_are_driven_with_another_laser() -> None:
    (cell,) = random_cells("7", laser="kinect")
    (usual,) = random_cells("7")
    log, own = recording_of(cell, None).log, recording_of(usual, None).log
    assert log.geometry.n_beams == 640 != own.geometry.n_beams
    assert cell.name != usual.name
    assert in_words("7", laser="kinect") == "random scenes 7, kinect"
    with pytest.raises(EvaluationError, match="found laser 'velodyne', expected one of sick, "):
        random_cells("7", laser="velodyne")


def test_all_random_scenes_may_have_one_fault() -> None:
    (cell,) = random_cells("7", fault="carried")
    assert (cell.source, cell.fault) == ("random:7", "carried")
    assert in_words("7", fault="carried") == "random scenes 7, carried"
    with pytest.raises(EvaluationError, match=r"found fault .flooded., expected one of .*carried"):
        random_cells("7", fault="flooded")


@pytest.mark.parametrize("seeds", ["", "a", "-3", "7-", "9-8", "1-2-3", "0-10000", "\u0663", "1 - 2"])
def test_what_is_no_range_of_seeds_is_refused(seeds: str) -> None:
    with pytest.raises(EvaluationError, match=f"found seeds '{seeds}', expected one or a range"):
        random_cells(seeds)


def test_a_range_of_seeds_without_such_wheels_is_told() -> None:
    (quality,) = {drawn_odometry(3)}
    others = tuple(other for other in get_args(Quality) if other != quality)
    with pytest.raises(EvaluationError, match=r"found no scene with odometry .* among seeds 3"):
        random_cells("3", others)


def test_lasers_see_as_far_and_as_wide_as_they_are_named() -> None:
    reach = [laser.geometry.range_max for laser in LASERS.values()]
    assert (reach[0], reach[-1]) == (3.5, 80.0)
    assert reach == sorted(reach)
    circle = LASERS["rplidar"].geometry.bearings
    np.testing.assert_allclose(np.diff(circle), 2.0 * np.pi / 360)
    assert circle[0] == -np.pi
    half = LASERS["lms80"].geometry.bearings
    assert (len(half), half[0], half[-1]) == (361, -0.5 * np.pi, 0.5 * np.pi)


def test_noise_is_a_millimetre_and_its_seed_decides() -> None:
    log = read_log(demo_log_path()).select(slice(0, 50))
    assert with_noise(log, 0) is log
    noisy, again, other = with_noise(log, 1), with_noise(log, 1), with_noise(log, 2)
    np.testing.assert_array_equal(noisy.ranges, again.ranges)
    assert (noisy.ranges != other.ranges).any()
    np.testing.assert_array_equal(np.isnan(noisy.ranges), np.isnan(log.ranges))
    assert np.nanstd(noisy.ranges - log.ranges) == pytest.approx(0.001, rel=0.05)


def test_a_recording_with_a_fault_is_judged_by_the_truth_and_by_the_run_without() -> None:
    whole = recording_of(Cell(group="logs", source="office"), None)
    n_scans = 400
    log, truth = whole.log.select(slice(0, n_scans)), read_truth_csv(demo_truth_path())[:n_scans]
    recording = Recording(log=log, truth=truth, judge=lambda T: trajectory_errors(T, truth).ate_rmse)
    plain = Cell(group="logs", source="office")
    thinned = Cell(group="faults", source="office", fault="every 2nd scan", seed=1)
    clean, worse = outcomes(recording, [plain, thinned])
    assert clean.verdict.is_good
    assert worse.verdict.is_good
    assert worse.usual_m == pytest.approx(clean.error_m)
    assert worse.error_m != clean.error_m
    assert clean.odometry_m == worse.odometry_m == pytest.approx(trajectory_errors(log.odometry, truth).ate_rmse)
    assert clean.nees is not None
    assert clean.nees > 0.0


_LENGTHS = st.floats(0.0, 1e3).map(lambda value: round(value, 6))
_OUTCOMES = st.builds(
    Outcome,
    group=st.sampled_from(GROUPS),
    source=st.text(st.characters(codec="utf-8", exclude_characters="\r\n\0"), min_size=1, max_size=9),
    fault=st.sampled_from(("none", *DEGRADATIONS)),
    seed=st.integers(0, 9),
    error_m=_LENGTHS,
    odometry_m=_LENGTHS,
    given_m=st.none() | _LENGTHS,
    usual_m=_LENGTHS,
    is_said=st.booleans(),
    nees=st.none() | _LENGTHS,
    cpu_s=_LENGTHS,
)


@given(table=st.lists(_OUTCOMES, min_size=1, max_size=4))
def test_a_table_that_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, table: list[Outcome]) -> None:
    path = tmp_path_factory.mktemp("table") / "regression.csv"
    write_outcomes(table, path)
    assert read_outcomes(path) == table


@pytest.mark.parametrize(
    ("content", "message"),
    [("a,b\n1,2\n", "found the columns a, b"), (None, "cannot be read"), ("row", "regression.csv:2: found a row")],
)
def test_another_file_is_refused(tmp_path: Path, content: str | None, message: str) -> None:
    path = tmp_path / "regression.csv"
    if content == "row":
        write_outcomes([_OUTCOME], path)
        path.write_text(path.read_text().replace("0.01", "much"))
    elif content is not None:
        path.write_text(content)
    with pytest.raises(EvaluationError, match=message):
        read_outcomes(path)


def test_tables_are_compared_by_the_cells_they_have_in_common() -> None:
    before = [_outcome(source=str(k), error_m=0.02) for k in range(8)]
    after = [_outcome(source=str(k), error_m=0.01 if k < 6 else 0.02, cpu_s=0.5) for k in range(1, 9)]
    found = compare(before, after)
    assert found.before.cells == found.after.cells == 7
    assert (found.changed, found.better, found.worse) == (5, 5, 0)
    assert found.ratio == pytest.approx(0.5 ** (5 / 7))
    assert found.error_chance == pytest.approx(2 / 2**5)
    assert found.low <= found.ratio <= found.high
    assert (found.good_chance, found.nees_chance, found.cpu_ratio) == (1.0, 1.0, 0.5)
    with pytest.raises(EvaluationError, match="no cell in common"):
        compare(before, [_outcome(source="elsewhere")])


def test_a_change_beyond_what_noise_does_is_told_from_one_within() -> None:
    steady = [_outcome(source="steady", seed=seed, error_m=0.02 * 1.01**seed) for seed in range(4)]
    shaky = [_outcome(source="shaky", seed=seed, error_m=0.02 * 3.0**seed) for seed in range(4)]
    after = [replace(steady[0], error_m=0.03), replace(shaky[0], error_m=0.03)]
    rows = changed_cells([*steady, *shaky], after)
    assert {str(row["cell"]): row["beyond it"] for row in rows} == {"steady, none, 0": "yes", "shaky, none, 0": "no"}
    logs = [math.log(1.01) * seed for seed in range(4)]
    told = next(row for row in rows if row["cell"] == "steady, none, 0")
    assert told["scatter of its logarithm"] == pytest.approx(float(np.std(logs, ddof=1)))


def test_the_page_holds_baseline_present_and_rules() -> None:
    before = [_outcome(source=str(k)) for k in range(3)]
    after = [replace(one, error_m=0.5) for one in before]
    text = keep.page(before, after, [{"off": "nothing", "good": 3}, {"off": "near odometry", "good": 2}])
    assert "## The baseline" in text
    assert "0, none, 0" in text
    assert "ruined, silent" in text
    assert "| nothing" in text
    assert "- *near odometry*: a match near odometry is preferred" in text
    assert "The present" not in keep.page(before, before, [])
    assert "What one fault does" not in text
    faulty = [replace(one, group="faults", fault="carried", source="log", seed=k) for k, one in enumerate(after)]
    row = next(line for line in keep.page(faulty, faulty, []).splitlines() if line.startswith("| carried"))
    assert "0.500, 0.500, 0.500" in row


def test_the_command_that_keeps_writes_the_page_from_what_was_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("BASELINE", "RULES_TABLE"):
        monkeypatch.setattr(keep, name, tmp_path / f"kept-{name}.csv")
    outcomes_file, rules_file = tmp_path / "regression.csv", tmp_path / "rules.csv"
    write_outcomes([_OUTCOME], outcomes_file)
    write_csv(
        [{"off": "nothing", "good": 3, "error ratio": None}, {"off": "near odometry", "good": 2, "error ratio": 1.5}],
        rules_file,
    )
    keep.Keep(measured=(tmp_path,), as_baseline=True, page=tmp_path / "page.md")()
    assert read_outcomes(tmp_path / "kept-BASELINE.csv") == [_OUTCOME]
    assert (tmp_path / "kept-RULES_TABLE.csv").read_bytes() == rules_file.read_bytes()
    first = (tmp_path / "page.md").read_bytes()
    assert b"| near odometry | 2    | 1.50        |" in first
    keep.Keep(measured=(), page=tmp_path / "page.md")()  # from what was kept
    assert (tmp_path / "page.md").read_bytes() == first


def test_the_baseline_that_is_kept_is_of_cells_there_are() -> None:
    kept = read_outcomes(BASELINE)
    assert {one.group for one in kept} == set(GROUPS)
    known = {cell.name for cell in cells(None)}
    assert known >= {one.name for one in kept if one.group in {"simulated", "carried"}}

"""A run concluded anew from its folder: the same to the byte without corrections, and right with them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from graph.se2 import between, compose, inverse, transform_points
from iceg.cli import main
from iceg.corrections.corrections import Corrections, CorrectionsError, Cut, Distrusted, Forbidden, MapFrame, Pinned
from iceg.corrections.manual_closures import ManualClosure
from iceg.corrections.map_frame import walls_heading
from iceg.demo import demo_truth_path
from iceg.evaluation.trajectory import trajectory_errors
from iceg.maps.config import GridConfig
from iceg.pipeline import resolve as conclude
from iceg.resolving import findings_of, resolve
from iceg.results import RESULT_FILES, ResultsError
from iceg.run_folder import read_closures
from iceg.run_result.slam_result import SlamResult
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.closures.closure import Closure
from iceg.slam.findings import Findings
from iceg.tables import read_csv_table

CONFIG = iceg.Config(grid=GridConfig(resolution=0.2))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the embedded log."""
    log = iceg.read_log(iceg.demo_log_path())
    directory = tmp_path_factory.mktemp("resolve") / "run"
    iceg.write_results(iceg.run(log, CONFIG), directory)
    return directory


@pytest.fixture(scope="module")
def findings(folder: Path) -> Findings:
    return findings_of(folder)


@pytest.fixture(scope="module")
def as_found(findings: Findings) -> SlamResult:
    return conclude(findings)


@pytest.fixture(scope="module")
def truth() -> NDArray[np.float64]:
    return read_csv_table(demo_truth_path(), ("t_s", "x_m", "y_m", "theta_rad"))[:, 1:]


def error(result: SlamResult, truth: NDArray[np.float64]) -> float:
    return trajectory_errors(result.trajectory, truth).ate_rmse


def wrong(result: SlamResult, *, pinned: bool = False) -> ManualClosure:
    """A closure metres from the truth, beside an accepted one from the end of the path to its beginning."""
    accepted = [closure for closure in result.closures if closure.verdict == "accepted"]
    closure = max(accepted, key=lambda closure: closure.scan_j - closure.scan_i)
    return ManualClosure(
        scan_i=closure.scan_i,
        scan_j=closure.scan_j - 3,
        T_i_j=compose(closure.T_i_j, np.array([4.0, 3.0, 0.5])),
        sigma_m=0.01,
        sigma_rad=0.005,
        pinned=pinned,
        where="c.toml:1",
    )


def test_without_corrections_every_file_is_the_same(folder: Path, tmp_path: Path) -> None:
    assert main(["resolve", str(folder), "-o", str(tmp_path / "again")]) == 0
    for name in RESULT_FILES:
        one, other = ((each / name).read_bytes().splitlines() for each in (folder, tmp_path / "again"))
        if name == "report.html":  # tells how long each stage took
            one, other = ([line for line in lines if b'id="stages"' not in line] for lines in (one, other))
        if name != "summary.json":
            assert one == other, name


def test_a_wrong_closure_is_named_and_bends_nothing(
    findings: Findings, as_found: SlamResult, truth: NDArray[np.float64]
) -> None:
    said = wrong(as_found)
    result = conclude(findings, Corrections(added=(said,)))
    assert error(result, truth) < 1.1 * error(as_found, truth)
    *others, by_hand = result.closures
    assert [c.verdict for c in others] == [c.verdict for c in as_found.closures]
    assert by_hand.verdict == "removed"
    (sentence,) = (warning.sentence for warning in result.run_warnings if warning.kind == "corrections")
    assert sentence.startswith(f"c.toml:1: the closure by hand between scans {said.scan_i} and {said.scan_j}")
    assert "other closures contradict it" in sentence
    assert "standard deviations off; it takes no part unless it is pinned" in sentence
    assert sentence in result.summary["warnings"]


def test_a_closure_by_hand_settles_which_of_match_and_odometry_is_right(
    findings: Findings, as_found: SlamResult
) -> None:
    middle = len(as_found.key_scans) // 2
    conflict = Break(key=middle, outcome=Outcome.CONFLICT, reason="the match lies 0.30 m off")
    contested = replace(findings, solution=replace(findings.solution, breaks=(conflict,)))
    first, last = (int(as_found.key_scans[k]) for k in (middle - 20, middle + 20))
    across = ManualClosure(
        scan_i=first,
        scan_j=last,
        T_i_j=between(as_found.trajectory[first], as_found.trajectory[last]),
        sigma_m=0.02,
        sigma_rad=0.01,
        where="c.toml:1",
    )
    assert [found["outcome"] for found in conclude(contested).summary["breaks"]] == ["conflict"]
    assert conclude(contested, Corrections(added=(across,))).summary["breaks"] == []


def test_a_pinned_one_is_believed_until_it_is_taken_back(
    findings: Findings, as_found: SlamResult, truth: NDArray[np.float64]
) -> None:
    said = wrong(as_found, pinned=True)
    result = conclude(findings, Corrections(added=(said,)))
    assert said.T_i_j is not None
    off = between(said.T_i_j, between(result.trajectory[said.scan_i], result.trajectory[said.scan_j]))
    assert np.hypot(*off[:2]) < 0.5, "the map follows it"
    assert error(result, truth) > 3.0 * error(as_found, truth)
    assert any("it is believed all the same, for it is pinned" in w.sentence for w in result.run_warnings)
    # As the run's own guide it does no harm that taking it back does not mend.
    again = conclude(result.findings)
    np.testing.assert_array_equal(again.trajectory, as_found.trajectory)


def test_a_right_closure_that_lies_far_off_is_followed(
    findings: Findings, as_found: SlamResult, truth: NDArray[np.float64]
) -> None:
    # Nothing but odometry and matches along the way ties the path, and they are not to be trusted around a turn.
    n_scans = len(findings.log)
    bare = Corrections(
        forbidden=(Forbidden(one=(0, n_scans - 1), other=(0, n_scans - 1)),),
        distrusted=(Distrusted(scans=(980, 1020), factor=1000.0),),
    )
    key_scans = as_found.key_scans
    i, j = int(key_scans[10]), int(key_scans[-10])
    T_i_j = compose(between(truth[i], truth[j]), np.array([2.0, 0.0, 0.0]))
    shifted = ManualClosure(scan_i=i, scan_j=j, T_i_j=T_i_j)
    result = conclude(findings, replace(bare, added=(shifted,)))
    off = between(T_i_j, between(result.trajectory[i], result.trajectory[j]))
    assert np.hypot(*off[:2]) < 0.3
    assert result.closures[-1].verdict == "accepted"


def test_scans_alone_are_matched(findings: Findings, as_found: SlamResult, truth: NDArray[np.float64]) -> None:
    closure = next(closure for closure in as_found.closures if closure.verdict == "accepted")
    result = conclude(
        findings, Corrections(added=(ManualClosure(scan_i=closure.scan_j, scan_j=closure.scan_i, T_i_j=None),))
    )
    found = result.closures[-1]
    assert found.verdict == "accepted"
    assert found.reason.startswith("by hand, matched")
    expected = between(truth[closure.scan_j], truth[closure.scan_i])
    np.testing.assert_allclose(found.T_i_j[:2], expected[:2], atol=0.1)


def test_forbidden_closures_take_no_part(findings: Findings, as_found: SlamResult) -> None:
    accepted = [c for c in as_found.closures if c.verdict == "accepted"]
    one, other = (accepted[0].scan_i, accepted[0].scan_j), accepted[len(accepted) // 2]
    corrections = Corrections(
        forbidden=(
            Forbidden(one=(one[0], one[0]), other=(one[1], one[1]), is_single=True),
            Forbidden(one=(other.scan_j - 20, other.scan_j + 20), other=(other.scan_i - 20, other.scan_i + 20)),
        )
    )
    result = conclude(findings, corrections)
    gone = {
        (c.scan_i, c.scan_j): c.reason
        for c, before in zip(result.closures, as_found.closures, strict=True)
        if c.verdict != before.verdict
    }
    assert one in gone
    assert (other.scan_i, other.scan_j) in gone
    assert all(reason.startswith("forbidden by hand; ") for reason in gone.values())
    assert result.summary["factors"]["closure"] == as_found.summary["factors"]["closure"] - len(gone)
    assert result.summary["corrections"]["forbidden"][0] == [[one[0]] * 2, [one[1]] * 2]


def rows_with(folder: Path, verdicts: dict[tuple[int, int], str], target: Path) -> Path:
    lines = (folder / "closures.csv").read_text().splitlines()
    changed = [lines[0]]
    for line in lines[1:]:
        words = line.split(",")
        words[8] = verdicts.get((int(words[0]), int(words[1])), words[8])
        changed.append(",".join(words))
    target.write_text("\n".join(changed) + "\n")
    return target


def verdicts_of(path: Path) -> dict[tuple[int, int], Closure]:
    return {(closure.scan_i, closure.scan_j): closure for closure in read_closures(path)}


def test_closures_csv_handed_back(folder: Path, tmp_path: Path) -> None:
    before = verdicts_of(folder / "closures.csv")
    off = next(scans for scans, closure in before.items() if closure.verdict == "accepted")
    pinned = [scans for scans, closure in before.items() if closure.verdict == "accepted"][5]
    unchanged = rows_with(folder, {}, tmp_path / "same.csv")
    assert main(["resolve", str(folder), "--corrections", str(unchanged), "-o", str(tmp_path / "same")]) == 0
    assert (tmp_path / "same" / "trajectory.tum").read_bytes() == (folder / "trajectory.tum").read_bytes()
    edited = rows_with(folder, {off: "rejected", pinned: "pinned"}, tmp_path / "edited.csv")
    assert main(["resolve", str(folder), "--corrections", str(edited), "-o", str(tmp_path / "edited")]) == 0
    after = verdicts_of(tmp_path / "edited" / "closures.csv")
    assert (after[off].verdict, after[off].reason[:17]) == ("rejected", "forbidden by hand")
    assert after[pinned].reason.startswith("pinned; ")
    # Handed back once more, on top of the results that it gave, it asks for the same.
    again = rows_with(tmp_path / "edited", {pinned: "pinned"}, tmp_path / "again.csv")
    assert main(["resolve", str(tmp_path / "edited"), "--corrections", str(again)]) == 0
    assert verdicts_of(tmp_path / "edited" / "closures.csv")[off].verdict == "rejected"


def test_closures_csv_of_a_run_that_was_cut(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("[cut]\ndrop = [[0, 9]]\n")
    assert main(["resolve", str(folder), "--corrections", str(file), "-o", str(tmp_path / "cut")]) == 0
    accepted = [scans for scans, c in verdicts_of(tmp_path / "cut" / "closures.csv").items() if c.verdict == "accepted"]
    edited = rows_with(tmp_path / "cut", {accepted[0]: "rejected"}, tmp_path / "edited.csv")
    assert main(["resolve", str(tmp_path / "cut"), "--corrections", str(edited), "-o", str(tmp_path / "whole")]) == 0
    recorded = (accepted[0][0] + 10, accepted[0][1] + 10)
    assert verdicts_of(tmp_path / "whole" / "closures.csv")[recorded].reason.startswith("forbidden by hand")
    result = resolve(tmp_path / "cut", iceg.read_corrections(edited))
    reasons = {(closure.scan_i, closure.scan_j): closure.reason for closure in result.closures}
    assert reasons[recorded].startswith("forbidden by hand")


def test_a_rejected_closure_may_be_pinned(findings: Findings, as_found: SlamResult) -> None:
    closure = next(c for c in as_found.closures if c.verdict == "rejected" and np.isfinite(c.T_i_j).all())
    result = conclude(findings, Corrections(pinned=(Pinned(scan_i=closure.scan_i, scan_j=closure.scan_j),) * 2))
    now = {(c.scan_i, c.scan_j): c for c in result.closures}[closure.scan_i, closure.scan_j]
    assert now.verdict == "accepted"
    assert now.reason.startswith("pinned; ")
    keys = [int(np.searchsorted(as_found.key_scans, scan)) for scan in (closure.scan_i, closure.scan_j)]
    assert [(f.i, f.j) for f in result.graph.factors if f.kind == "closure"].count((keys[0], keys[1])) == 1


def test_walls_upright_and_the_origin_at_a_scan(findings: Findings, as_found: SlamResult) -> None:
    turned = conclude(findings, Corrections(frame=MapFrame(turn_degrees=30.0, origin_scan=200)))
    np.testing.assert_allclose(turned.trajectory[200, :2], 0.0, atol=1e-9)
    seen, expected = (between(each.trajectory[200], each.trajectory) for each in (turned, as_found))
    np.testing.assert_allclose(seen, expected, atol=1e-9)
    np.testing.assert_array_equal(turned.covariances, as_found.covariances)
    walls, walls_as_found = (  # seen from the same scan they stand where they stood
        transform_points(inverse(each.trajectory[200]), each.walls.ends) for each in (turned, as_found)
    )
    np.testing.assert_allclose(walls, walls_as_found, atol=1e-9)
    upright = conclude(findings, Corrections(frame=MapFrame(upright=True)))
    segments = as_found.config.ice.segments
    assert abs(walls_heading(findings.track, upright.key_poses, segments)) < 1e-6
    askew = walls_heading(findings.track, turned.key_poses, segments)
    assert np.degrees(askew) == pytest.approx(30.0, abs=2.0)


def test_an_interval_that_is_distrusted_is_known_less(findings: Findings, as_found: SlamResult) -> None:
    result = conclude(findings, Corrections(distrusted=(Distrusted(scans=(300, 500)),)))
    inside = (as_found.key_scans >= 300) & (as_found.key_scans <= 500)
    before, after = (np.sqrt(each.covariances[inside, 0, 0]).mean() for each in (as_found, result))
    assert after > 2.0 * before


def test_a_log_that_was_cut_runs_as_if_there_were_no_more(as_found: SlamResult) -> None:
    log = as_found.log.select(slice(150))
    part = iceg.run(log, corrections=Corrections(cut=Cut(keep=((30, 129),))))
    alone = iceg.run(log.select(slice(30, 130)))
    np.testing.assert_array_equal(part.trajectory, alone.trajectory)
    assert part.summary["cut"] == {"recorded_scans": 150, "kept": [[30, 129]]}


def test_run_and_resolve_with_the_same_corrections_agree(as_found: SlamResult, tmp_path: Path) -> None:
    log, path = as_found.log.select(slice(300)), as_found.trajectory
    corrections = Corrections(
        forbidden=(Forbidden(one=(0, 50), other=(150, 200)),),
        added=(ManualClosure(scan_i=5, scan_j=280, T_i_j=between(path[5], path[280])),),
    )
    corrected = iceg.run(log, CONFIG, corrections=corrections)
    assert "forbidden by hand" in {closure.reason for closure in corrected.closures}
    iceg.write_results(corrected, tmp_path / "run")
    again = resolve(tmp_path / "run", corrections)
    np.testing.assert_array_equal(again.trajectory, corrected.trajectory)
    assert [(c.verdict, c.reason) for c in again.closures] == [(c.verdict, c.reason) for c in corrected.closures]
    record = json.loads((tmp_path / "run" / "summary.json").read_text())["corrections"]
    assert record["added"][0]["scans"] == [5, 280]


def test_a_folder_that_lacks_or_changed_it_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"holds no run\.npz, expected a folder"):
        resolve(tmp_path)
    with pytest.raises(ResultsError, match=r"nowhere: is no folder, expected one that a run has written"):
        resolve(tmp_path / "nowhere")
    changed = tmp_path / "changed"
    changed.mkdir()
    for name in RESULT_FILES:
        (changed / name).write_bytes((folder / name).read_bytes())
    content = bytearray((changed / "run.npz").read_bytes())
    content[-5] ^= 1
    (changed / "run.npz").write_bytes(bytes(content))
    with pytest.raises(ResultsError, match=r"run\.npz: is not what the run has written"):
        resolve(changed)


def test_scans_that_the_log_does_not_have_are_refused(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text("[[forbid]]\nscans = [0, 1848]\n")
    before = (folder / "summary.json").read_bytes()
    assert main(["resolve", str(folder), "--corrections", str(file)]) == 1
    assert (folder / "summary.json").read_bytes() == before


def test_scans_cut_afterwards_take_no_part(folder: Path, as_found: SlamResult, truth: NDArray[np.float64]) -> None:
    cut = Cut(keep=((100, 1800),), drop=((903, 931),))
    result = resolve(folder, Corrections(cut=cut))
    left = np.setdiff1d(np.arange(100, 1801), np.arange(903, 932))
    assert len(result.trajectory) == len(left)
    assert trajectory_errors(result.trajectory, truth[left]).ate_rmse < 1.5 * error(as_found, truth)
    np.testing.assert_array_equal(result.log.stamps, as_found.log.stamps[left])
    assert result.summary["cut"] == {"recorded_scans": 1848, "kept": [[100, 902], [932, 1800]]}


def test_what_a_run_has_cut_can_not_be_asked_for(as_found: SlamResult) -> None:
    part = iceg.run(as_found.log.select(slice(60)), CONFIG, corrections=Corrections(cut=Cut(keep=((0, 39),))))
    shorter = conclude(part.findings, Corrections(cut=Cut(keep=((0, 29),))))
    assert len(shorter.trajectory) == 30
    assert len(conclude(part.findings).trajectory) == 40
    with pytest.raises(CorrectionsError, match=r"were cut when the log was run, expected only those left"):
        conclude(part.findings, Corrections(cut=Cut(drop=((0, 9),))))

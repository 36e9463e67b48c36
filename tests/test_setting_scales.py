"""Half and twice of a setting: which are tried, what becomes of them, and the table on a short log."""

import csv
import gzip
import itertools
from pathlib import Path

import pytest

from graph.errors import IcegError
from iceg.cli import main
from iceg.config import Config
from iceg.demo import demo_log_path, demo_truth_path
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.setting_scales import STAGES, names_to_scale, scalable_settings, scaled

N_SCANS = 150


def test_every_number_is_scaled_alone() -> None:
    usual = dict(scalable_settings(Config()))
    tried = 0
    for (name, value), factor in zip(usual.items(), itertools.cycle((0.5, 2.0)), strict=False):
        try:
            changed = dict(scalable_settings(scaled(Config(), name, factor)))
        except IcegError:
            continue
        tried += 1
        assert changed.pop(name, 0) == pytest.approx(value * factor, abs=0.51 * isinstance(value, int))
        assert changed == {other: usual[other] for other in usual if other != name}
    assert tried > 75


def test_whole_numbers_stay_whole() -> None:
    assert scaled(Config(), "loops.reference_half", 0.5).loops.reference_half == 3
    assert scaled(Config(), "loops.reference_half", 2.0).loops.reference_half == 14


def test_names_and_stages_are_asked_for() -> None:
    assert names_to_scale(["loops.radius"]) == ["loops.radius"]
    assert {name.partition(".")[0] for name in names_to_scale(())} == set(STAGES)
    assert all(name.startswith("finish.joint.") for name in names_to_scale(["finish.joint"]))
    with pytest.raises(EvaluationError, match=r"found the setting 'loops.radios', expected a number"):
        names_to_scale(["loops.radios"])


def test_the_table_on_a_short_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "short.clf"
    with gzip.open(demo_log_path(), "rt", encoding="ascii") as lines:
        scans = (line for line in lines if line.startswith("FLASER"))
        log.write_text("".join(itertools.islice(scans, N_SCANS)), encoding="ascii")
    truth = demo_truth_path().read_text().splitlines()[: N_SCANS + 1]
    (tmp_path / "short.truth.csv").write_text("\n".join(truth) + "\n")
    words = ["--scales", "graph.prior_sigma", "front_end.key_scans.distance", "grid.hit_probability", "grid.max_range"]
    assert main(["ablation", str(log), *words, "-o", str(tmp_path / "out")]) == 0
    assert "4 of 4 settings" in capsys.readouterr().out
    with (tmp_path / "out" / "settings-scaled.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["setting"]: row for row in csv.DictReader(file)}
    assert float(rows["graph.prior_sigma"]["half [%]"]) == pytest.approx(0.0, abs=1.0)  # of the first pose alone
    assert float(rows["front_end.key_scans.distance"]["twice [%]"]) != 0.0
    assert float(rows["grid.max_range"]["half [%]"]) == 0.0
    assert rows["grid.hit_probability"]["twice [%]"] == ""


def test_settings_and_other_studies_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ablation", str(demo_log_path()), "--scales", "--faults"]) == 2
    assert main(["ablation", "--rules", "--scales"]) == 2
    assert capsys.readouterr().err.count("--scales") == 2

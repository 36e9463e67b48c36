"""Rules that are switched off: each is there, is off within, and is back afterwards."""

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from frontends.logs import read_log
from frontends.scan import Log
from iceg.cli.studies import Ablation, Bench
from iceg.cli.usage_error import UsageError
from iceg.config import Config
from iceg.demo import demo_log_path
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.regression import rules
from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.rules import RULES, Rule, switched_off
from iceg.evaluation.regression.study import rule_rows
from iceg.maps.config import GridConfig
from iceg.pipeline import run
from iceg.run_result.slam_result import SlamResult

_QUICK = Config(grid=GridConfig(resolution=0.5))


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(demo_log_path()).select(slice(0, 110))


def _found(path: str) -> Any:
    module, _, names = path.partition(":")
    found: Any = import_module(module)
    for name in names.split("."):
        found = getattr(found, name)
    return found


@pytest.mark.parametrize("name", RULES)
def test_every_rule_is_off_within_and_back_afterwards_and_a_run_ends(name: str, log: Log) -> None:
    rule = RULES[name]
    assert rule.without or rule.config
    before = {path: _found(path) for path in rule.without}
    with switched_off(name) as changed:
        assert all(_found(path) is off for path, off in rule.without.items())
        config = changed(_QUICK)
        assert (config != _QUICK) == (rule.config is not None)
        assert len(run(log, config).trajectory) == len(log)
    assert {path: _found(path) for path in rule.without} == before


def test_what_a_rule_does_is_not_done_without_it(log: Log) -> None:
    def rounds(result: SlamResult) -> set[str]:
        return {done["stage"] for done in result.summary["finish"]}

    assert "joint" in rounds(run(log, _QUICK))
    with switched_off("joint refinement") as changed:
        assert "joint" not in rounds(run(log, changed(_QUICK)))
    with switched_off("halves of scans"):
        assert run(log, _QUICK).summary["match_covariance_scale"] == 1.0


def test_a_rule_nobody_knows_is_refused() -> None:
    with (
        pytest.raises(EvaluationError, match="no rule 'witchcraft', expected one of relocalisation"),
        switched_off("witchcraft"),
    ):
        pass


@pytest.mark.parametrize(
    "path", ["iceg.slam.gone:function", "iceg.slam.back_end:gone", "iceg.slam.back_end:BackEnd.gone"]
)
def test_a_rule_that_is_gone_is_told(monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    monkeypatch.setattr(rules, "RULES", {"old": Rule(what="nothing any more", without={path: None})})
    with pytest.raises(EvaluationError, match=r"rule 'old': found no iceg\.slam"), switched_off("old"):
        pass


def test_a_study_compares_each_rule_with_nothing_switched_off(tmp_path: Path) -> None:
    cell = Cell(group="simulated", source="home lds")
    rows = rule_rows([cell], None, ["plausible"], tmp_path, 1, lambda _rule, _outcomes: None)
    assert [row["off"] for row in rows] == ["nothing", "plausible"]
    assert rows[1]["p error"] == rows[1]["error ratio"] == 1.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rule-nothing.csv", "rule-plausible.csv", "rules.csv"]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (Bench(long=True), "--laser, --fault, --noise, --baseline need --parts regression"),
        (Bench(seeds="1-2"), "--laser, --fault, --noise, --baseline need --parts regression"),
        (Bench(parts=("regression",), workers=0), "--workers 0"),
        (Ablation(off=("near odometry",)), "need --rules"),
        (Ablation(rules=True, off=("witchcraft",)), "--off 'witchcraft', expected some of relocalisation"),
        (Ablation(seeds="1-2"), "--laser, --fault, --noise and --workers need --rules"),
        (Ablation(rules=True, odometry=("none",)), "--odometry, --laser and --fault need --seeds"),
        (Ablation(rules=True, laser="kinect"), "--odometry, --laser and --fault need --seeds"),
        (Bench(parts=("regression",), fault="carried"), "--odometry, --laser and --fault need --seeds"),
        (
            Bench(parts=("regression",), seeds="1-2", groups=("logs",)),
            "--seeds, --noise, and --groups or --long, expected one",
        ),
        (Bench(parts=("regression",), seeds="1-2", noise="1-2"), "found two of --seeds, --noise"),
        (Bench(noise="1-2"), "need --parts regression"),
        (Ablation(rules=True, faults=True), "no logs, --faults or --scales"),
    ],
)
def test_options_that_do_not_go_together_are_refused(command: Bench | Ablation, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        command()

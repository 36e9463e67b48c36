"""Experiments: what their files say, how cells are told apart, kept and summed up."""

import csv
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontends.matchers import MATCHERS
from graph.errors import IcegError
from iceg.evaluation.bench.cell import Cell, LogSource
from iceg.evaluation.bench.comparison import run_experiment
from iceg.evaluation.bench.executors import attempt
from iceg.evaluation.bench.experiment import Experiment, parse_experiment, read_experiment
from iceg.evaluation.bench.methods import METHODS, DpSlamMethod, PipelineMethod, flattened, make_method, nested
from iceg.evaluation.bench.outcome import Outcome, failed, keep, kept
from iceg.evaluation.bench.plots import save_plots
from iceg.evaluation.bench.summary import summary_rows, write_results

ROOM = LogSource(name="room", path="scene:room")
WHOLE = """
seeds = [0, 1]
methods = [
    "ice",
    {method = "csm", name = "correlative", settings = {loops.enabled = false, "grid.resolution" = 0.1}},
    "dp-slam",
]
logs = ["scene:room", {path = "here.clf", seeds = [7]}]

[sweep]
"loops.min_fit" = [0.7, 0.8]
csm.cell = [0.02, 0.04]
"""


def cell(label: str = "ice", log: LogSource = ROOM, seed: int = 0, settings: dict[str, Any] | None = None) -> Cell:
    return Cell(method="ice", label=label, settings=settings or {}, swept={}, log=log, seed=seed)


def outcome(of: Cell, **figures: float) -> Outcome:
    return Outcome(cell=of, figures={"scans_per_cpu_s": 500.0, **figures}, trajectory=b"0 0 0 0 0 0 0 1\n")


def test_an_experiment_is_the_product_of_all_it_names(tmp_path: Path) -> None:
    (tmp_path / "here.clf").touch()
    (tmp_path / "here.truth.csv").touch()
    cells = parse_experiment(WHOLE, tmp_path).cells
    assert [(c.log.name, c.seed) for c in cells[:3]] == [("room", 0), ("room", 1), ("here", 7)]
    assert list(dict.fromkeys(c.label for c in cells)) == [
        "ice loops.min_fit=0.7",
        "ice loops.min_fit=0.8",
        "correlative loops.min_fit=0.7 csm.cell=0.02",
        "correlative loops.min_fit=0.7 csm.cell=0.04",
        "correlative loops.min_fit=0.8 csm.cell=0.02",
        "correlative loops.min_fit=0.8 csm.cell=0.04",
        "dp-slam",
    ]
    assert len(cells) == 7 * 3
    assert len({c.folder for c in cells}) == len(cells)
    swept = next(c for c in cells if c.label.endswith("loops.min_fit=0.8 csm.cell=0.04"))
    assert swept.settings == {"loops.enabled": False, "grid.resolution": 0.1, "loops.min_fit": 0.8, "csm.cell": 0.04}
    assert cells[2].log.truth == str(tmp_path / "here.truth.csv")
    assert all(Cell.from_json(c.to_json()) == c for c in cells)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("methods = 3", "not valid|methods: found 3"),
        ("methods = [", "not valid TOML"),
        ('methods = ["ice"]', "logs: found None"),
        ('method = ["ice"]', "unknown key 'method', did you mean 'methods'"),
        ('methods = ["icee"]\nlogs = ["scene:room"]', "no method 'icee', expected one of ice, icp"),
        ('methods = [{name = "x"}]\nlogs = ["scene:room"]', r"methods\[0\]: method: found None"),
        ('methods = ["ice", "ice"]\nlogs = ["scene:room"]', "2 runs share the name"),
        ('methods = ["ice"]\nlogs = ["scene:rom"]', r"logs\[0\]: no scene 'rom'"),
        ('methods = ["ice"]\nlogs = ["missing.clf"]', r"logs\[0\]: path: no file .*missing\.clf"),
        ('methods = ["ice"]\nlogs = [{path = "scene:room", truth = "t.csv"}]', "knows its truth"),
        ('methods = ["ice"]\nlogs = ["scene:room"]\nseeds = [-1]', "seeds: found"),
        ('methods = ["ice"]\nlogs = ["scene:room"]\ntime_limit_s = 0', "time_limit_s: found 0"),
        ('methods = ["ice"]\nlogs = ["scene:room"]\nsweep = {"loops.min_fit" = 0.7}', "expected a list of values"),
        (
            'methods = ["ice"]\nlogs = ["scene:room"]\nsweep = {csm.cell = [1.0]}',
            "no meaning for any of the methods: ice",
        ),
        (
            'methods = ["ice"]\nlogs = ["scene:room"]\nsweep = {"loops.min_fit" = [0.7, "x"]}',
            "ice loops.min_fit=x: loops.min_fit: found 'x', expected a number",
        ),
        (
            'methods = [{method = "csm", settings = {csm.cells = 0.1}}]\nlogs = ["scene:room"]',
            "csm: csm: unknown key 'cells', did you mean 'cell'",
        ),
        (
            'methods = [{method = "dp-slam", settings = {loops.enabled = false}}]\nlogs = ["scene:room"]',
            "no meaning for DP-SLAM",
        ),
        (
            'methods = [{method = "ice", settings = {"seed" = 1, "seed.x" = 1}}]\nlogs = ["scene:room"]',
            "'seed' is a value already",
        ),
    ],
)
def test_a_wrong_experiment_is_refused_before_anything_runs(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(IcegError, match=message):
        parse_experiment(text, tmp_path)


def test_a_reference_and_a_truth_at_once_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    for name in ("a.clf", "r.csv", "t.csv"):
        (tmp_path / name).touch()
    text = 'methods = ["ice"]\nlogs = [{path = "a.clf", reference = "r.csv", truth = "t.csv"}]'
    with pytest.raises(IcegError, match="expected one of them"):
        parse_experiment(text, tmp_path)
    with pytest.raises(IcegError, match=r"nothing\.toml: cannot be read"):
        read_experiment(tmp_path / "nothing.toml")


names = st.text("abcdefg_", min_size=1, max_size=4)
tables: st.SearchStrategy[dict[str, Any]] = st.recursive(
    st.dictionaries(names, st.integers(), max_size=3),
    lambda inner: st.dictionaries(names, st.one_of(st.integers(), inner), max_size=3),
    max_leaves=8,
)


@given(tables)
def test_dotted_keys_and_tables_say_the_same(table: dict[str, Any]) -> None:
    dotted = dict(flattened(table))
    assert dict(flattened(nested(dotted))) == dotted
    assert all(not isinstance(value, dict) for value in dotted.values())


@pytest.mark.parametrize("name", METHODS)
def test_every_method_can_be_made_with_a_seed(name: str) -> None:
    method = make_method(name, {"log.range_max": 15.0}, 5, "here")
    assert method.config.log.range_max == 15.0
    if isinstance(method, DpSlamMethod):
        assert method.filter.seed == 5
    else:
        assert isinstance(method, PipelineMethod)
        assert method.config.seed == 5
        assert (method.matcher is not None) == (name in MATCHERS)
    if name == "ice":
        assert method.config.ice.hypotheses.seed == 5


def test_a_matcher_takes_settings_of_its_own() -> None:
    plain, finer = (make_method("csm", settings, 0, "here") for settings in ({}, {"csm.cell": 0.011}))
    assert finer.resolved()["matcher"] == {**plain.resolved()["matcher"], "cell": 0.011}


def test_a_digest_follows_what_decides_and_nothing_else(tmp_path: Path) -> None:
    world = tmp_path / "small.world"
    world.write_text("one")
    own = LogSource(name="small", path=f"scene:{world}")
    digests = [
        c.digest()
        for c in (
            cell(),
            cell(seed=1),
            cell(settings={"loops.min_fit": 0.123}),
            cell(log=own),
            cell(log=LogSource(name="office", path="scene:office")),
        )
    ]
    assert len(set(digests)) == len(digests)
    default = make_method("ice", {}, 0, "here").config.loops.min_fit
    assert cell("another name", settings={"loops.min_fit": default}).digest() == digests[0]


def test_only_a_success_with_the_same_digest_is_kept(tmp_path: Path) -> None:
    done = outcome(cell(), ate_rmse=0.0123456789)
    keep(done, "abc", tmp_path)
    again = kept(done.cell, "abc", tmp_path)
    assert again == replace(done, is_reused=True)
    assert kept(done.cell, "abd", tmp_path) is None
    assert kept(cell(seed=1), "abc", tmp_path) is None
    keep(failed(done.cell, "broke"), "abc", tmp_path)
    assert kept(done.cell, "abc", tmp_path) is None
    assert [path.name for path in (tmp_path / done.cell.folder).iterdir()] == ["result.json"]


def test_long_names_still_make_folders_of_their_own() -> None:
    a, b = (cell("ice " + "x" * 200 + end) for end in "ab")
    assert max(len(a.folder), len(b.folder)) < 130
    assert a.folder != b.folder


def test_seeds_are_summed_up_and_failures_counted() -> None:
    outcomes = [
        outcome(cell(), ate_rmse=0.010),
        outcome(cell(seed=1), ate_rmse=0.030),
        failed(cell(seed=2), "broke"),
        failed(cell("other"), "broke"),
    ]
    ice, other = summary_rows(outcomes)
    assert (ice["runs"], ice["failed"], other["runs"], other["failed"]) == (3, 1, 1, 1)
    assert ice["ATE [m]"] == pytest.approx(0.020)
    assert ice["deviation over runs [m]"] == pytest.approx(0.01 * 2**0.5)
    assert ice["scans/CPU s"] == 500
    assert other["ATE [m]"] is None
    assert "NEES" not in ice


def test_results_are_the_same_in_both_formats_whatever_the_types(tmp_path: Path) -> None:
    values = [0.5, "wide", True, 3]
    outcomes = [outcome(replace(cell(seed=k), swept={"x.y": value}), n=k) for k, value in enumerate(values)]
    outcomes.append(failed(cell("other"), 'broke, "badly"'))
    table, columnar = write_results(outcomes, tmp_path)
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = pq.read_table(columnar).to_pydict()
    assert columns["x.y"] == ["0.5", "wide", "True", "3", None]
    assert columns["n"] == [0, 1, 2, 3, None]
    assert columns["error"][-1] == rows[-1]["error"] == 'broke, "badly"'
    for name, column in columns.items():
        assert [row[name] for row in rows] == ["" if value is None else str(value) for value in column]


def test_pictures_are_drawn_even_where_runs_failed(tmp_path: Path) -> None:
    outcomes = [outcome(cell(), trans_mean=0.02), failed(cell(seed=1), "broke"), failed(cell("other"), "broke")]
    first = [path.read_bytes() for path in save_plots(outcomes, tmp_path)]
    assert [content[1:4] for content in first] == [b"PNG", b"PNG"]
    assert first == [path.read_bytes() for path in save_plots(outcomes, tmp_path)]
    save_plots([failed(cell(), "broke")], tmp_path)


def test_a_run_beyond_its_time_and_a_run_that_crashes_are_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    late = attempt(cell(), 0.01)
    assert late.error == "stopped after the time limit of 0.01 s"

    def crashed(*_args: object, **_kwargs: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess([], -11, "", "")

    monkeypatch.setattr("iceg.evaluation.bench.child_process.Children.run", crashed)
    assert attempt(cell()).error == "ended by signal 11 (Segmentation fault)"


def test_what_is_there_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("iceg.evaluation.bench.comparison.run_here", _pretend(asked))
    cells = tuple(cell(seed=seed) for seed in range(4))
    told: list[tuple[int, int]] = []
    two = run_experiment(Experiment(cells=cells[:2]), tmp_path, workers=2)
    assert [o.error for o in two] == [None, "odd"]
    four = run_experiment(
        Experiment(cells=cells), tmp_path, workers=2, tell=lambda _outcome, done, of: told.append((done, of))
    )
    assert [o.cell for o in four] == list(cells)
    assert [o.is_reused for o in four] == [True, False, False, False]
    assert asked == [c.name for c in (cells[0], cells[1], cells[1], cells[2], cells[3])]
    assert told == [(k, 4) for k in range(1, 5)]
    run_experiment(Experiment(cells=cells[:1]), tmp_path, overwrite=True)
    assert asked[5:] == [cells[0].name]


def _pretend(asked: list[str]) -> Callable[..., Iterator[Outcome]]:
    """Runs that take no time; those with an odd seed fail."""

    def run(cells: list[Cell], _workers: int, _limit: float | None) -> Iterator[Outcome]:
        asked.extend(c.name for c in cells)
        yield from (failed(c, "odd") if c.seed % 2 else outcome(c, ate_rmse=0.1) for c in cells)

    return run

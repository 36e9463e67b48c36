"""The notebook of the paper's experiments in its quick form: it runs, its claims hold, and it shows what it says."""

import re
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from iceg.evaluation import paper

PATH = Path(__file__).parent.parent / "notebooks" / "paper_experiments.ipynb"


def read() -> nbformat.NotebookNode:
    notebook: nbformat.NotebookNode = nbformat.reads(PATH.read_text(encoding="utf-8"), as_version=4)  # type: ignore[no-untyped-call]
    return notebook


@pytest.fixture(scope="module")
def executed(own_jupyter: None) -> Iterator[nbformat.NotebookNode]:
    del own_jupyter
    # A backend chosen for the tests would keep the notebook from showing its figures.
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MPLBACKEND", raising=False)
        yield _execute()


def _execute() -> nbformat.NotebookNode:
    resources = {"metadata": {"path": str(PATH.parent)}}
    client = NotebookClient(read(), startup_timeout=600, kernel_name="python3", resources=resources)
    executed: nbformat.NotebookNode = client.execute()
    return executed


def outputs(executed: nbformat.NotebookNode, kind: str) -> list[str]:
    return [
        output["data"][kind]
        for cell in executed.cells
        for output in cell.get("outputs", [])
        if kind in output.get("data", {})
    ]


def test_it_is_committed_in_its_quick_form_without_outputs() -> None:
    cells = read().cells
    assert sum("FULL = False" in cell.source for cell in cells) == 1
    assert not any(cell.get("outputs") for cell in cells)


def test_every_figure_and_table_is_there(executed: nbformat.NotebookNode) -> None:
    assert len(outputs(executed, "image/png")) >= 6  # Figs. 3 to 7 and a basin
    tables = "\n".join(outputs(executed, "text/markdown"))
    for times in paper.TABLE_1.values():
        assert f"{times.dp_slam_s:.2f}" in tables
    assert "the paper" in tables
    assert re.search(r"\| *csm *\|", tables)


def test_each_experiment_asserts_its_claim_and_says_why_figures_differ(executed: nbformat.NotebookNode) -> None:
    text = "\n".join(cell.source for cell in executed.cells if cell.cell_type == "markdown")
    for name in ("Table I", "Fig. 5", "Fig. 6", "Fig. 7"):
        assert name in text
    assert text.count("**Why they differ.**") == 5
    code = [cell.source for cell in executed.cells if cell.cell_type == "code"]
    assert all("assert " in source for source in code[1:])

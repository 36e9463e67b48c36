"""The notebooks run, from the first cell to the last, and are committed without outputs."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
LONG = {"paper_experiments"}
"""Executed by a test of their own."""


def read(path: Path) -> nbformat.NotebookNode:
    notebook: nbformat.NotebookNode = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)  # type: ignore[no-untyped-call]
    return notebook


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_carries_no_outputs(path: Path) -> None:
    for cell in read(path).cells:
        assert not cell.get("outputs"), cell.source
        assert cell.get("execution_count") is None, cell.source


@pytest.mark.usefixtures("own_jupyter")
@pytest.mark.parametrize("path", [path for path in NOTEBOOKS if path.stem not in LONG], ids=lambda path: path.stem)
def test_a_notebook_runs_and_its_claims_hold(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ICEG_DATA", raising=False)  # the embedded log is enough here; all public ones take minutes
    notebook = read(path)
    assert any("assert " in cell.source for cell in notebook.cells), "a notebook asserts what it claims"
    resources = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, startup_timeout=600, kernel_name="python3", resources=resources).execute()


def test_there_are_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] != []

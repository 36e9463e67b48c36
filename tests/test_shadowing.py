"""A user's own graph.py hides the package of that name: iceg says so in one sentence instead of failing obscurely."""

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import graph
from iceg._shadowing import check_shadowing


def test_nothing_in_the_way() -> None:
    check_shadowing()


def test_a_module_already_imported_under_the_name_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    own = ModuleType("graph")
    own.__file__ = str(tmp_path / "graph.py")
    monkeypatch.setitem(sys.modules, "graph", own)
    with pytest.raises(ImportError, match=r"graph\.py shadows the package 'graph' that iceg needs") as caught:
        check_shadowing()
    assert caught.value.path == str((tmp_path / "graph.py").resolve())
    assert str(Path(str(graph.__file__)).resolve()) in str(caught.value)


@pytest.mark.parametrize("file", ["graph.py", "graph/__init__.py", "frontends.py"])
def test_a_file_that_python_would_find_first_is_found(tmp_path: Path, file: str) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text("")
    program = "from iceg._shadowing import check_shadowing; check_shadowing()"
    repository = Path(__file__).parent.parent
    found = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(1, {str(repository)!r}); {program}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode != 0
    assert f"{(tmp_path / file).resolve()} shadows the package" in found.stderr


def test_a_folder_without_init_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A namespace package gives way to a regular one wherever that lies on the path.
    (tmp_path / "graph").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "graph")
    check_shadowing()


def test_nothing_installed_beside_is_not_our_business(tmp_path: Path) -> None:
    check_shadowing(names=("graph",), home=tmp_path)

"""The same log gives the same bytes whatever the processor offers."""

import ast
from pathlib import Path

import pytest

from iceg.demo import demo_log_path
from tests.machines import Machine, openblas_cores, results, without_numpy_features

REPOSITORY = Path(__file__).parent.parent
SOURCES = [path for folder in ("graph", "frontends", "iceg") for path in sorted((REPOSITORY / folder).rglob("*.py"))]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return results(Machine(name="as it is"), demo_log_path(), tmp_path_factory.mktemp("usual") / "run")


@pytest.mark.parametrize(
    "machine",
    [openblas_cores()[0], *without_numpy_features()[:1], Machine(name="one core", one_core=True)],
    ids=lambda machine: machine.name,
)
def test_the_demo_is_the_same(machine: Machine, usual: dict[str, str], tmp_path: Path) -> None:
    assert results(machine, demo_log_path(), tmp_path / "run") == usual


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_nothing_is_left_to_the_processor(path: Path) -> None:
    """What the linter cannot ban: products of matrices written `@`, and orders in which equals are mixed up."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        where = f"{path}:{getattr(node, 'lineno', 0)}"
        assert not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)), f"{where}: graph.dense.matmul"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            assert node.func.attr != "argpartition", where
            assert node.func.attr != "dot", f"{where}: graph.dense.vecdot"
            if node.func.attr == "argsort":
                kinds = [word.value for word in node.keywords if word.arg == "kind"]
                stable = [kind.value in {"stable", "mergesort"} for kind in kinds if isinstance(kind, ast.Constant)]
                assert stable == [True], f'{where}: argsort without kind="stable"'

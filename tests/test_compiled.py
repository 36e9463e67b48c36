"""How inner loops are compiled: numbers and arrays handed from one to the next."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from graph._assign_kernels import assign
from graph.compiled import ONE, ZERO

ROOT = Path(__file__).parent.parent


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_a_number_handed_on_does_not_compile_the_next_function_for_itself() -> None:
    twice: Any = njit(lambda number: 2 * number)
    with_literal: Any = njit(lambda: twice(1))
    with_constants: Any = njit(lambda: twice(ONE) + twice(ZERO))

    assert with_constants() == 2
    assert len(twice.signatures) == 1
    with_literal()
    assert len(twice.signatures) == 2, "numba no longer does this: ONE and ZERO are not needed any more"


@pytest.mark.parametrize("shape", [(4,), (3, 2), (0,)])
def test_assign_copies_into_what_is_there(shape: tuple[int, ...]) -> None:
    values = np.arange(float(np.prod(shape))).reshape(shape)
    whole = np.full((2, *shape), -1.0)
    assign(whole[1], values)
    np.testing.assert_array_equal(whole, [np.full(shape, -1.0), values])


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_where_nothing_can_be_written_kernels_are_compiled_for_the_process_and_that_is_said_once() -> None:
    code = (
        "import numpy as np\n"
        "from frontends.logs._number_kernels import scan_numbers\n"
        "out = np.empty(2)\n"
        "assert scan_numbers(np.frombuffer(b'1.5 -2', np.uint8), 0, 6, out) == (2, 6)\n"
        "assert out.tolist() == [1.5, -2.0]\n"
    )
    elsewhere = {"NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator"}  # finds no folder outside of a notebook
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=os.environ | elsewhere)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("set NUMBA_CACHE_DIR") == 1


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_a_kernel_is_compiled_anew_where_one_has_changed_that_it_calls(tmp_path: Path) -> None:
    helper, caller = tmp_path / "_helper_kernels.py", tmp_path / "_caller_kernels.py"
    between = "from _helper_kernels import _times\nfrom graph.compiled import compiled\n@compiled\n"
    caller.write_text(between + "def called(x: int) -> int:\n    return _times(x)\n")
    code = "import sys, _caller_kernels as c; print(c.called(1), sum(c.called.stats.cache_hits.values()))"
    paths = {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}", "NUMBA_CACHE_DIR": str(tmp_path / "kept")}

    def run() -> str:
        words = [sys.executable, "-B", "-c", code]
        return subprocess.run(words, capture_output=True, text=True, check=True, env=os.environ | paths).stdout.strip()

    def write(factor: int) -> None:
        source = f"def _times(x: int) -> int:\n    return {factor} * x\n"
        helper.write_text("from graph.compiled import compiled\n@compiled\n" + source)

    write(2)
    assert run() == "2 0"
    assert run() == "2 1"
    write(30)
    assert run() == "30 0"


def test_what_only_kernels_call_is_not_called_from_python() -> None:
    """It has no entry for Python: that would end the process with a memory fault."""
    sources = [path for folder in ("graph", "frontends", "iceg", "tests") for path in (ROOT / folder).rglob("*.py")]
    kernels = [path for path in sources if path.name.endswith("_kernels.py")]
    private = {name for path in kernels for name in re.findall(r"@compiled\ndef (_\w+)", path.read_text("utf-8"))}
    assert "_fit_line" in private
    for path in set(sources) - set(kernels):
        text = path.read_text("utf-8")
        if "_kernels import" in text or re.search(r"import _\w*kernels", text):
            named = "|".join([r"\w*kernels", *re.findall(r"import _\w*kernels as (\w+)", text)])
            called = set(re.findall(rf"(?:{named})\.(_\w+)\(", text))
            called |= {
                name for line in re.findall(r"_kernels import (.*)", text) for name in re.findall(r"\b_\w+", line)
            }
            assert not called & private, f"{path}: call it through tests/kernels.py"


def test_what_is_for_python_alone_no_kernel_calls() -> None:
    """It is kept as machine code, which another compiled function cannot take in."""
    compiled, called = {}, set()
    for path in (path for folder in ("graph", "frontends", "iceg") for path in (ROOT / folder).rglob("*.py")):
        module, tree = ".".join(path.relative_to(ROOT).with_suffix("").parts), ast.parse(path.read_text("utf-8"))
        imported = {
            name.asname or name.name: f"{node.module}.{name.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for name in node.names
        }
        for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
            decorators = {ast.unparse(decorator) for decorator in function.decorator_list}
            if decorators & {"compiled", "compiled_aside", "compiled_for_both"}:
                compiled[f"{module}.{function.name}"] = decorators.pop()
                names = {ast.unparse(node.func) for node in ast.walk(function) if isinstance(node, ast.Call)}
                called |= {
                    ".".join([imported.get(first, f"{module}.{first}"), *others])
                    for first, *others in (name.split(".") for name in names)
                }
    public = {name for name in compiled if not name.rpartition(".")[2].startswith("_")}
    for_both = {name for name in public if compiled[name] == "compiled_for_both"}
    assert for_both >= {"graph._assign_kernels.assign"}
    assert called & public == for_both

"""What the command line leaves out when it starts, and that nothing misses it."""

import os
import subprocess
import sys

import numba
import pytest

from iceg.cli.quick_start import load_kernels_lightly

_KERNEL = (
    "import sys\n"
    "import numpy as np\n"
    "from iceg.cli.quick_start import load_numba_without_scipy\n"
    "load_numba_without_scipy()\n"
    "from frontends.logs._number_kernels import scan_numbers\n"
    "out = np.empty(2)\n"
    "read = scan_numbers(np.frombuffer(b'1.5 -2', np.uint8), 0, 6, out)\n"
    "assert (*read, *out) == (2, 6, 1.5, -2.0)\n"
    "assert 'scipy.linalg' not in sys.modules, 'SciPy was loaded'\n"
)


def run(code: str, **variables: str) -> None:
    words, env = [sys.executable, "-c", code], os.environ | variables
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables with which kernels are compiled and kept, whatever holds for the tests; that of `_CACHED` is there."""
    variables = {"NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("kernels")), "NUMBA_DISABLE_JIT": "0"}
    run(_CACHED, **variables)
    return variables


def test_a_kernel_runs_without_scipy_which_can_be_imported_all_the_same() -> None:
    run(f"{_KERNEL}import scipy.linalg\nassert scipy.linalg.norm([3.0, 4.0]) == 5.0\n")


def test_linear_algebra_still_compiles() -> None:
    run(
        f"{_KERNEL}"
        "from numba import njit\n"
        "product = njit(lambda A, b: A @ b)(np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([1.0, 2.0]))\n"
        "assert product.tolist() == [4.0, 7.0]\n"
    )


def test_scipy_that_is_there_already_stays() -> None:
    run(
        "import scipy.linalg, sys\n"
        "from iceg.cli.quick_start import load_numba_without_scipy\nload_numba_without_scipy()\n"
        "assert sys.modules['scipy.linalg'] is scipy.linalg\n"
    )


_CACHED = (
    "import numpy as np\n"
    "from iceg.cli.quick_start import load_kernels_lightly\n"
    "load_kernels_lightly()\n"
    "from frontends.logs._number_kernels import scan_numbers\n"
    "text, out = np.frombuffer(b'1.5 -2', np.uint8), np.empty(2)\n"
    "assert (*scan_numbers(text, 0, 6, out), *out) == (2, 6, 1.5, -2.0)\n"
    "[library] = [known.library for known in scan_numbers.overloads.values()]\n"
)


def test_a_kernel_loaded_from_its_cache_leaves_unread_what_only_others_need(kept: dict[str, str]) -> None:
    run(f"{_CACHED}assert library.unread\n", **kept)


def test_a_kernel_loaded_from_its_cache_can_be_built_into_others(kept: dict[str, str]) -> None:
    run(
        f"{_CACHED}"
        "from numba import njit\n"
        "@njit\n"
        "def twice(text, start, stop, out):\n"
        "    scan_numbers(text, start, stop, out)\n"
        "    return out * 2.0\n"
        "assert library.unread\n"
        "assert twice(text, 0, 6, out).tolist() == [3.0, -4.0]\n"
        "assert not library.unread\n",
        **kept,
    )


def test_what_is_compiled_after_it_runs_and_recurses(kept: dict[str, str]) -> None:
    run(
        f"{_CACHED}"
        "from numba import njit\n"
        "@njit\n"
        "def factorial(n):\n"
        "    return 1 if n < 2 else n * factorial(n - 1)\n"
        "assert factorial(5) == 120\n",
        **kept,
    )


def test_a_folder_of_kernels_is_tried_once() -> None:
    run(
        "import tempfile\n"
        "tried, make = [], tempfile.TemporaryFile\n"
        "def remember(dir):\n"
        "    tried.append(dir)\n"
        "    return make(dir=dir)\n"
        "tempfile.TemporaryFile = remember\n"
        f"{_CACHED}"
        "import iceg.slam.joint._wall_kernels\n"
        "assert tried\n"
        "assert len(tried) == len(set(tried)), tried\n"
    )


def test_a_numba_with_other_insides_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core.registry import cpu_target

    codegen = cpu_target.target_context.codegen()
    before = codegen._library_class
    monkeypatch.setattr(numba, "__version__", "1.0.0")
    load_kernels_lightly()
    assert codegen._library_class is before

"""How inner loops are compiled: what a process that runs one loads."""

import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from graph._assign_kernels import assign
from graph.compiled import ONE, ZERO

_KERNEL = (
    "import sys\n"
    "import numpy as np\n"
    "from frontends.logs._number_kernels import scan_numbers\n"
    "out = np.empty(2)\n"
    "read = scan_numbers(np.frombuffer(b'1.5 -2', np.uint8), 0, 6, out)\n"
    "assert (*read, *out) == (2, 6, 1.5, -2.0)\n"
    "assert 'scipy.linalg' not in sys.modules, 'SciPy was loaded'\n"
)


def run(code: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


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
    run("import scipy.linalg, sys\nimport graph.compiled\nassert sys.modules['scipy.linalg'] is scipy.linalg\n")


def test_a_number_handed_on_does_not_compile_the_next_function_for_itself() -> None:
    @njit
    def twice(number: int) -> int:
        return 2 * number

    @njit
    def with_literal() -> int:
        return int(twice(1))

    @njit
    def with_constants() -> int:
        return int(twice(ONE) + twice(ZERO))

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

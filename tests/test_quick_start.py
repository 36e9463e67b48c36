"""What the command line leaves out when it starts, and that nothing misses it."""

import subprocess
import sys

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
    run(
        "import scipy.linalg, sys\n"
        "from iceg.cli.quick_start import load_numba_without_scipy\nload_numba_without_scipy()\n"
        "assert sys.modules['scipy.linalg'] is scipy.linalg\n"
    )

"""What the command line, whose process is its own, leaves out when it starts."""

import sys


def load_numba_without_scipy() -> None:
    """Load now what numba loads with the first function, while SciPy's linear algebra cannot be found.

    It would load all of `scipy.linalg` only to learn whether BLAS is there for `np.convolve` and `np.correlate`, which
    take a plain loop without it: a sixth of a second of every start. Compiled `np.dot` and `np.linalg` look for BLAS
    and LAPACK again when they are used.
    """
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401
    except ImportError:
        pass  # not where numba asks any more
    finally:
        del sys.modules["scipy.linalg"]

"""How much memory this process has held, and giving back what it no longer needs."""

import ctypes
import sys
from pathlib import Path


def peak_memory_mb() -> float | None:
    """Largest resident memory of this process so far [MB]; None where the system does not tell."""
    try:
        # What the process itself held: getrusage counts what its parent held when it was started, too.
        status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines())
        return round(int(status["VmHWM"].split()[0]) * 1024 / 1e6, 1)
    except (OSError, KeyError, ValueError):
        pass
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6, 1)


def release_freed_memory() -> None:
    """Give memory that was freed back to the system, where the C library can (glibc); elsewhere it does so by itself.

    Between the stages of a run that need the most: else each stage's peak comes on top of what the one before left.
    """
    if sys.platform != "linux":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))

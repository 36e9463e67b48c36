"""A process that compiles kernels: each byte that comes in is a group of them, two that go out tell of a kernel."""

import gc
import os
import sys

from numba.core.errors import NumbaError

from iceg.kernels.groups import groups_of
from iceg.kernels.signatures import Kernel, listed_kernels


def main() -> None:
    """Compile group after group until none is left; all workers take from one pipe, and answer through one."""
    gc.disable()  # a sixth of the time to compile would go into looking for garbage; the process does not live long
    kernels = listed_kernels()
    groups = groups_of(kernels)
    tasks, answers = sys.stdin.fileno(), sys.stdout.fileno()
    while task := os.read(tasks, 1):
        for place in groups[task[0]]:
            os.write(answers, bytes([place, _is_compiled(kernels[place])]))


def _is_compiled(kernel: Kernel) -> bool:
    """Compile it; False where the list is of another version: the run compiles what it needs."""
    try:
        kernel.compile()
    except (AttributeError, TypeError, ValueError, NumbaError):
        return False
    return True


if __name__ == "__main__":
    main()

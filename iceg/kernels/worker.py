"""A process that compiles kernels: their places in the list come in, line by line; a word for each goes out."""

import gc
import json
import sys

from numba.core.errors import NumbaError

from iceg.kernels.signatures import listed_kernels


def main() -> None:
    """Compile what is asked for, until nobody asks any more."""
    gc.disable()  # a sixth of the time to compile would go into looking for garbage; the process does not live long
    kernels = listed_kernels()
    for line in sys.stdin:
        for k in json.loads(line):
            try:
                kernels[k].compile()
                done = "compiled"
            except (AttributeError, TypeError, ValueError, NumbaError):
                done = "unknown"  # of another version: the run compiles what it needs
            sys.stdout.write(f"{done}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()

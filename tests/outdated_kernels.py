"""A worker whose list names a kernel that is gone."""

from iceg.kernels import worker
from iceg.kernels.signatures import Kernel

if __name__ == "__main__":
    worker.listed_kernels = lambda: [Kernel("matching", "graph._dense_kernels", "no_such", ["float64"])]  # type: ignore
    worker.main()

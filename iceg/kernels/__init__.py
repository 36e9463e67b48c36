"""The compiled kernels a run needs: their list, and compiling them ahead in several processes."""

"""Stands for a process that compiles, and takes very long."""

import sys

for _ in sys.stdin:
    pass

"""How inner loops are compiled."""

from numba import njit

compiled = njit(cache=True, error_model="numpy")
"""Decorator of a compiled function: kept on disk for the next run; division by zero gives infinity or NaN, as in NumPy.

Python's check of every divisor would cost a tenth of the time to compile.
"""

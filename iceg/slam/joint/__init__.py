"""Poses and walls refined together, and how well they are known afterwards."""

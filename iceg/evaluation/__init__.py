"""Judging a trajectory: benchmark relations, absolute errors, honesty of the covariances."""

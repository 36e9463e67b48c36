"""DP-SLAM: a particle filter over whole maps that share what their particles have in common (Eliazar and Parr)."""

from frontends.dp_slam.config import ATRV_JR, DpSlamConfig, DpSlamError, MotionModel
from frontends.dp_slam.particle_filter import DpSlamResult, dp_slam

__all__ = ["ATRV_JR", "DpSlamConfig", "DpSlamError", "DpSlamResult", "MotionModel", "dp_slam"]

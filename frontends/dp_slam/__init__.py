"""DP-SLAM: a particle filter over whole maps that share what their particles have in common (Eliazar and Parr)."""

from typing import TYPE_CHECKING, Any

from frontends.dp_slam.config import ATRV_JR, DpSlamConfig, DpSlamError, MotionModel

if TYPE_CHECKING:
    from frontends.dp_slam.particle_filter import DpSlamResult, dp_slam

__all__ = ["ATRV_JR", "DpSlamConfig", "DpSlamError", "DpSlamResult", "MotionModel", "dp_slam"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """What needs the kernels, imported on first use (PEP 562): the settings are light."""
    if name in {"DpSlamResult", "dp_slam"}:
        from frontends.dp_slam import particle_filter

        return getattr(particle_filter, name)
    raise AttributeError(f"module 'frontends.dp_slam' has no attribute {name!r}")

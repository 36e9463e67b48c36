"""Settings in metres that follow the noise of the laser."""

from collections.abc import Mapping
from dataclasses import replace
from math import hypot
from typing import Any, TypeAlias

from iceg.config import Config

_Widths: TypeAlias = "Mapping[str, float | _Widths]"

_WIDTHS: _Widths = {
    "ice": {
        "segments": {
            # Neighbours on one surface differ by two errors: five σ are passed by one pair in two thousand.
            "gap": 5.0,
            # The direction of a wall is known where it is some σ long.
            "min_length": 2.0,
            "wall_length": 3.0,
        },
        "features": {"corner_gap": 4.0, "merge_radius": 1.0},
        "hypotheses": {
            "field_sigma": 1.0,
            # A scan of a hundred beams is matched to a quarter of σ, or worse along what is weak.
            "min_window": 0.75,
            "min_turn": 0.2,
            "trusted_window": 0.75,
        },
        # Points lie on the lines of their neighbours, off the wall by half a σ or less, beams do not.
        "refinement": {"scale": 1.2, "coarse_scale": 1.2, "margin": 3.0, "across": 3.0},
        "local_map": {"cell": 0.5, "coarse_cell": 0.5, "fine_radius": 1.5, "coarse_radius": 1.5, "sharpen": 0.5},
    },
    "front_end": {"tracking_distance": 0.2, "tracking_angle": 0.05},
    "finish": {
        "search_distance": 0.25,
        "joint": {"cell": 1.0, "half_length": 2.0, "half_width": 3.0, "scale": 2.4},
    },
    "feature_map": {"max_distance": 1.0, "occlusion_margin": 3.0},
}
"""Standard deviations of the noise that add to each setting, as independent errors do; radians per metre for angles."""


def widened(config: Config, noise: float) -> Config:
    """The settings for a laser whose ranges typically err by so much beyond what the settings allow for [m]."""
    if noise == 0.0:
        return config
    wider: Config = _widened(config, _WIDTHS, noise)
    # Odometry pulls as hard as before, while each point tells less.
    points = (wider.ice.refinement.scale / config.ice.refinement.scale) ** 2
    refinement = replace(wider.ice.refinement, tracking_prior=points * config.ice.refinement.tracking_prior)
    return replace(wider, ice=replace(wider.ice, refinement=refinement))


def _widened(settings: Any, widths: _Widths, noise: float) -> Any:  # noqa: ANN401
    wider = {}
    for name, sigmas in widths.items():
        value = getattr(settings, name)
        wider[name] = hypot(value, sigmas * noise) if isinstance(sigmas, float) else _widened(value, sigmas, noise)
    return replace(settings, **wider)

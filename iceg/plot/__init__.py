"""Pictures of a run, drawn by matplotlib on axes of yours, as vectors.

    figure, ax = plt.subplots()
    iceg.plot.map(result, ax)

What shows a run takes what `iceg.run` returns as well as what `iceg.read_run_folder` does. No global state is touched
and no display is needed: the axes decide. Nothing is loaded before its first use.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from iceg.plot.error_axes import curves, error_over_time, paths
    from iceg.plot.map_axes import map, path_on_grid  # noqa: A004
    from iceg.plot.matching import alignment, correlation_surface, covariance_ellipse, scan_features
    from iceg.plot.plan_axes import floor_plan
    from iceg.plot.studies import closures, scan_times, success
    from iceg.plot.trajectory_axes import trajectory, trajectory_figure
    from iceg.plot.uncertainty_axes import uncertainty, uncertainty_figure
    from iceg.show.map_image import known_box

__all__ = [
    "alignment",
    "closures",
    "correlation_surface",
    "covariance_ellipse",
    "curves",
    "error_over_time",
    "floor_plan",
    "known_box",
    "map",
    "path_on_grid",
    "paths",
    "scan_features",
    "scan_times",
    "success",
    "trajectory",
    "trajectory_figure",
    "uncertainty",
    "uncertainty_figure",
]

_HOMES = {
    "alignment": "iceg.plot.matching",
    "closures": "iceg.plot.studies",
    "correlation_surface": "iceg.plot.matching",
    "covariance_ellipse": "iceg.plot.matching",
    "curves": "iceg.plot.error_axes",
    "error_over_time": "iceg.plot.error_axes",
    "floor_plan": "iceg.plot.plan_axes",
    "known_box": "iceg.show.map_image",
    "map": "iceg.plot.map_axes",
    "path_on_grid": "iceg.plot.map_axes",
    "paths": "iceg.plot.error_axes",
    "scan_features": "iceg.plot.matching",
    "scan_times": "iceg.plot.studies",
    "success": "iceg.plot.studies",
    "trajectory": "iceg.plot.trajectory_axes",
    "trajectory_figure": "iceg.plot.trajectory_axes",
    "uncertainty": "iceg.plot.uncertainty_axes",
    "uncertainty_figure": "iceg.plot.uncertainty_axes",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """A public name, imported from its home on first use (PEP 562)."""
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'iceg.plot' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *__all__})

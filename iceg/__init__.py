"""2D laser SLAM for recorded logs: ICE matching, honest covariances, a GTSAM graph, maps."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frontends.scan import Log, Scan, ScanGeometry
    from graph.errors import IcegError
    from graph.measurement import NoMatch, RelativePose
    from iceg.config import Config
    from iceg.ice.features import Features
    from iceg.maps.grid import OccupancyGrid, render_grid
    from iceg.results import write_results

__version__ = "0.1.0"

__all__ = [
    "Config",
    "Features",
    "IcegError",
    "Log",
    "NoMatch",
    "OccupancyGrid",
    "RelativePose",
    "Scan",
    "ScanGeometry",
    "__version__",
    "render_grid",
    "write_results",
]

_HOMES = {
    "Config": "iceg.config",
    "Features": "iceg.ice.features",
    "IcegError": "graph.errors",
    "Log": "frontends.scan",
    "NoMatch": "graph.measurement",
    "OccupancyGrid": "iceg.maps.grid",
    "RelativePose": "graph.measurement",
    "Scan": "frontends.scan",
    "ScanGeometry": "frontends.scan",
    "render_grid": "iceg.maps.grid",
    "write_results": "iceg.results",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """A public name, imported from its home on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'iceg' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *__all__})

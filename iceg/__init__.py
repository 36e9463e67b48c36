"""2D laser SLAM for recorded logs: ICE matching, honest covariances, a GTSAM graph, maps."""

from __future__ import annotations

from iceg._shadowing import check_shadowing

TYPE_CHECKING = False  # nothing is loaded here that takes time: the command line handles signals right afterwards
if TYPE_CHECKING:
    from typing import Any

    from frontends.logs import describe_log, read_log
    from frontends.logs.writers import write_log
    from frontends.matcher import Matcher
    from frontends.scan import Log, Scan, ScanGeometry
    from graph.errors import IcegError
    from graph.measurement import NoMatch, RelativePose
    from graph.odometry import OdometryModel
    from graph.pose_graph import PoseGraph
    from iceg.config import Config, read_config
    from iceg.demo import demo_log_path, demo_truth_path
    from iceg.ice.config import IceConfig
    from iceg.ice.features import Features, extract_features
    from iceg.ice.matcher import IceMatcher
    from iceg.ice.segments import Segments, extract_segments
    from iceg.maps.feature_map import FeatureMap, Landmarks
    from iceg.maps.grid import OccupancyGrid, render_grid
    from iceg.resolving import resolve
    from iceg.results import write_results
    from iceg.run_folder import RunFolder, read_run_folder
    from iceg.slam.corrections.corrections import Corrections
    from iceg.slam.corrections.reading import read_corrections
    from iceg.slam.distance import Distance, Sighting
    from iceg.slam.manual_closures import ManualClosure
    from iceg.slam.pipeline import SlamResult, run

__version__ = "0.1.0"

__all__ = [
    "Config",
    "Corrections",
    "Distance",
    "FeatureMap",
    "Features",
    "IceConfig",
    "IceMatcher",
    "IcegError",
    "Landmarks",
    "Log",
    "ManualClosure",
    "Matcher",
    "NoMatch",
    "OccupancyGrid",
    "OdometryModel",
    "PoseGraph",
    "RelativePose",
    "RunFolder",
    "Scan",
    "ScanGeometry",
    "Segments",
    "Sighting",
    "SlamResult",
    "__version__",
    "demo_log_path",
    "demo_truth_path",
    "describe_log",
    "extract_features",
    "extract_segments",
    "read_config",
    "read_corrections",
    "read_log",
    "read_run_folder",
    "render_grid",
    "resolve",
    "run",
    "write_log",
    "write_results",
]

_HOMES = {
    "Config": "iceg.config",
    "Corrections": "iceg.slam.corrections.corrections",
    "Distance": "iceg.slam.distance",
    "FeatureMap": "iceg.maps.feature_map",
    "Features": "iceg.ice.features",
    "IceConfig": "iceg.ice.config",
    "IceMatcher": "iceg.ice.matcher",
    "IcegError": "graph.errors",
    "Landmarks": "iceg.maps.feature_map",
    "Log": "frontends.scan",
    "ManualClosure": "iceg.slam.manual_closures",
    "Matcher": "frontends.matcher",
    "NoMatch": "graph.measurement",
    "OccupancyGrid": "iceg.maps.grid",
    "OdometryModel": "graph.odometry",
    "PoseGraph": "graph.pose_graph",
    "RelativePose": "graph.measurement",
    "RunFolder": "iceg.run_folder",
    "Scan": "frontends.scan",
    "ScanGeometry": "frontends.scan",
    "Segments": "iceg.ice.segments",
    "Sighting": "iceg.slam.distance",
    "SlamResult": "iceg.slam.pipeline",
    "demo_log_path": "iceg.demo",
    "demo_truth_path": "iceg.demo",
    "describe_log": "frontends.logs",
    "extract_features": "iceg.ice.features",
    "extract_segments": "iceg.ice.segments",
    "read_config": "iceg.config",
    "read_corrections": "iceg.slam.corrections.reading",
    "read_log": "frontends.logs",
    "read_run_folder": "iceg.run_folder",
    "render_grid": "iceg.maps.grid",
    "resolve": "iceg.resolving",
    "run": "iceg.slam.pipeline",
    "write_log": "frontends.logs.writers",
    "write_results": "iceg.results",
}

check_shadowing()


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """A public name, imported from its home on first use (PEP 562)."""
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'iceg' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *__all__})

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
    from graph.factors import Factor
    from graph.gtsam_bridge import to_gtsam_graph, to_gtsam_values
    from graph.measurement import NoMatch, RelativePose
    from graph.odometry import OdometryModel
    from graph.pose_graph import PoseGraph
    from iceg import plot
    from iceg.config import Config, read_config
    from iceg.corrections.corrections import Corrections
    from iceg.corrections.manual_closures import ManualClosure, read_manual_closures
    from iceg.corrections.reading import read_corrections
    from iceg.demo import demo_log_path, demo_truth_path
    from iceg.evaluation.judge import judge_trajectory
    from iceg.export.formats import export_results
    from iceg.folder_tables import read_run_tables
    from iceg.ice.config import IceConfig
    from iceg.ice.features import Features, extract_features
    from iceg.ice.matcher import IceMatcher
    from iceg.ice.segments import Segments, extract_segments
    from iceg.mapper import Event, Mapper, MapperMap, MapperUpdate
    from iceg.maps.feature_map import FeatureMap, Landmarks
    from iceg.maps.grid import OccupancyGrid, render_grid
    from iceg.resolving import resolve
    from iceg.result_tables import RunTables
    from iceg.results import write_results
    from iceg.run_folder import RunFolder, read_run_folder
    from iceg.run_result.distance import Distance, Sighting
    from iceg.run_result.run_summary import RunSummary
    from iceg.run_result.slam_result import SlamResult
    from iceg.running import run
    from iceg.show.map_image import MapLayers
    from iceg.show.map_picture import save_map_png
    from iceg.slam.closures.attempt import Attempt
    from iceg.slam.closures.candidates import Candidate
    from iceg.slam.closures.closure import Closure
    from iceg.slam.stages import StageError, Stages
    from iceg.slam.track import KeyScan
    from iceg.stamps import repaired_stamps
    from iceg.tum import Trajectory, read_tum

__version__ = "0.1.0"

__all__ = [
    "Attempt",
    "Candidate",
    "Closure",
    "Config",
    "Corrections",
    "Distance",
    "Event",
    "Factor",
    "FeatureMap",
    "Features",
    "IceConfig",
    "IceMatcher",
    "IcegError",
    "KeyScan",
    "Landmarks",
    "Log",
    "ManualClosure",
    "MapLayers",
    "Mapper",
    "MapperMap",
    "MapperUpdate",
    "Matcher",
    "NoMatch",
    "OccupancyGrid",
    "OdometryModel",
    "PoseGraph",
    "RelativePose",
    "RunFolder",
    "RunSummary",
    "RunTables",
    "Scan",
    "ScanGeometry",
    "Segments",
    "Sighting",
    "SlamResult",
    "StageError",
    "Stages",
    "Trajectory",
    "__version__",
    "demo_log_path",
    "demo_truth_path",
    "describe_log",
    "export_results",
    "extract_features",
    "extract_segments",
    "judge_trajectory",
    "plot",
    "read_config",
    "read_corrections",
    "read_log",
    "read_manual_closures",
    "read_run_folder",
    "read_run_tables",
    "read_tum",
    "render_grid",
    "repaired_stamps",
    "resolve",
    "run",
    "save_map_png",
    "to_gtsam_graph",
    "to_gtsam_values",
    "write_log",
    "write_results",
]

_HOMES = {
    "Attempt": "iceg.slam.closures.attempt",
    "Candidate": "iceg.slam.closures.candidates",
    "Closure": "iceg.slam.closures.closure",
    "Config": "iceg.config",
    "Corrections": "iceg.corrections.corrections",
    "Distance": "iceg.run_result.distance",
    "Event": "iceg.mapper",
    "Factor": "graph.factors",
    "FeatureMap": "iceg.maps.feature_map",
    "Features": "iceg.ice.features",
    "IceConfig": "iceg.ice.config",
    "IceMatcher": "iceg.ice.matcher",
    "IcegError": "graph.errors",
    "KeyScan": "iceg.slam.track",
    "Landmarks": "iceg.maps.feature_map",
    "Log": "frontends.scan",
    "ManualClosure": "iceg.corrections.manual_closures",
    "MapLayers": "iceg.show.map_image",
    "Mapper": "iceg.mapper",
    "MapperMap": "iceg.mapper",
    "MapperUpdate": "iceg.mapper",
    "Matcher": "frontends.matcher",
    "NoMatch": "graph.measurement",
    "OccupancyGrid": "iceg.maps.grid",
    "OdometryModel": "graph.odometry",
    "PoseGraph": "graph.pose_graph",
    "RelativePose": "graph.measurement",
    "RunFolder": "iceg.run_folder",
    "RunSummary": "iceg.run_result.run_summary",
    "RunTables": "iceg.result_tables",
    "Scan": "frontends.scan",
    "ScanGeometry": "frontends.scan",
    "Segments": "iceg.ice.segments",
    "Sighting": "iceg.run_result.distance",
    "SlamResult": "iceg.run_result.slam_result",
    "StageError": "iceg.slam.stages",
    "Stages": "iceg.slam.stages",
    "Trajectory": "iceg.tum",
    "demo_log_path": "iceg.demo",
    "demo_truth_path": "iceg.demo",
    "describe_log": "frontends.logs",
    "export_results": "iceg.export.formats",
    "extract_features": "iceg.ice.features",
    "extract_segments": "iceg.ice.segments",
    "judge_trajectory": "iceg.evaluation.judge",
    "plot": "iceg.plot",
    "read_config": "iceg.config",
    "read_corrections": "iceg.corrections.reading",
    "read_log": "frontends.logs",
    "read_manual_closures": "iceg.corrections.manual_closures",
    "read_run_folder": "iceg.run_folder",
    "read_run_tables": "iceg.folder_tables",
    "read_tum": "iceg.tum",
    "render_grid": "iceg.maps.grid",
    "repaired_stamps": "iceg.stamps",
    "resolve": "iceg.resolving",
    "run": "iceg.running",
    "save_map_png": "iceg.show.map_picture",
    "to_gtsam_graph": "graph.gtsam_bridge",
    "to_gtsam_values": "graph.gtsam_bridge",
    "write_log": "frontends.logs.writers",
    "write_results": "iceg.results",
}

check_shadowing()


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """A public name, imported from its home on first use (PEP 562)."""
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'iceg' has no attribute {name!r}")
    home = import_module(_HOMES[name])
    value = home if home.__name__ == f"iceg.{name}" else getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, imported or not."""
    return sorted({*globals(), *__all__})

"""A run as a recording of Rerun, with its layout in it."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.elementary import cos_sin
from graph.errors import reason
from iceg.export.options import ExportError, ExportOptions
from iceg.export.recorded_run import RecordedRun, read_recorded_run
from iceg.maps.grid import OccupancyGrid

_GREYS = {-1: 205, 0: 255, 100: 0}
"""Of unknown, free and occupied cells, as in map.pgm."""
_COLOURS = {
    "odometry": (140, 140, 155),
    "ice": (90, 115, 190),
    "closure": (25, 165, 75),
    "accepted": (25, 165, 75),
    "rejected": (215, 75, 50),
    "removed": (230, 140, 25),
    "corner": (215, 50, 50),
    "end_of_wall": (230, 150, 25),
    "intersection": (140, 75, 205),
}
_DEVIATIONS = ("along_m", "across_m", "heading_rad")


def write_rerun(directory: Path, path: Path, options: ExportOptions) -> None:
    """Write a run as one file that `rerun FILE` opens.

    Rerun numbers its rows with the time of writing: the file's content is the same each time, its bytes are not.

    Args:
        directory: of the run.
        path: the file, written atomically.
        options: with the log, where the run has not kept its scans.

    Raises:
        IcegError: a file cannot be read or written, the log is not that of the run, or `rerun-sdk` is not installed.
    """
    try:
        import rerun
    except ImportError as err:
        raise ExportError(f"{path}: needs the package rerun-sdk: pip install 'iceg[rerun]'") from err

    run = read_recorded_run(directory, options)
    recording: Any = rerun.RecordingStream("iceg", recording_id=run.found.log_name or "run", send_properties=False)
    stream = recording.binary_stream()
    recording.send_blueprint(_layout(run.found.grid))
    _send_whole(recording, run)
    _send_over_time(recording, run)
    content = stream.read()
    if content is None:
        raise ExportError(f"{path}: Rerun's library has ended before all was written")
    try:
        write_atomically(path, content)
    except OSError as err:
        raise ExportError(f"{path}: cannot be written: {reason(err)}") from err


def _send_whole(recording: Any, run: RecordedRun) -> None:  # noqa: ANN401
    """What does not change while the recording plays."""
    import rerun

    found, cell = run.found, run.found.grid.resolution
    recording.log("map", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("map/grid", _grid(found.grid), static=True)
    recording.log("map/path", rerun.LineStrips3D([_raised(run.poses[:, :2])], colors=(150, 160, 175)), static=True)
    walls = rerun.LineStrips3D(list(_raised(found.walls.ends)), colors=(25, 25, 40), radii=0.25 * cell)
    recording.log("map/walls", walls, static=True)
    for name, positions in run.landmarks().items():
        dots = rerun.Points3D(_raised(positions), colors=_COLOURS[name], radii=1.5 * cell)
        recording.log(f"map/landmarks/{name}", dots, static=True)
    for folder, lines in (("graph", run.edges()), ("closures", run.closures())):
        _log_lines(recording, f"map/{folder}", lines)
    key_poses = rerun.Points3D(_raised(found.key_poses[:, :2]), colors=(60, 80, 140), radii=cell)
    recording.log("map/graph/key_poses", key_poses, static=True)
    if run.log is not None:
        recording.log("map/robot/laser", _transform(run.log.geometry.T_robot_laser), static=True)


def _log_lines(recording: Any, folder: str, lines: Mapping[str, NDArray[np.float64]]) -> None:  # noqa: ANN401
    import rerun

    for name, ends in lines.items():
        strips = rerun.LineStrips3D(list(_raised(ends)), colors=_COLOURS[name])
        recording.log(f"{folder}/{name}", strips, static=True)


def _send_over_time(recording: Any, run: RecordedRun) -> None:  # noqa: ANN401
    """The robot, what it sees, where it has been, and how sure its poses are; on the timelines scan and time."""
    import rerun

    n_scans, keys = len(run.poses), run.found.key_scans
    times = _timelines(run, np.arange(n_scans))
    half_cos, half_sin = cos_sin(0.5 * run.poses[:, 2])
    zero = np.zeros(n_scans)
    moves = rerun.Transform3D.columns(
        translation=_raised(run.poses[:, :2]), quaternion=np.column_stack([zero, zero, half_sin, half_cos])
    )
    recording.send_columns("map/robot", times, moves)
    recording.log("map/robot/body", rerun.Arrows3D(vectors=[[0.5, 0.0, 0.0]], colors=(20, 100, 190)), static=True)
    track = rerun.Points3D.columns(positions=_raised(run.poses[:, :2]))
    recording.send_columns("map/track", times, track.partition(np.ones(n_scans, dtype=np.int64)))
    recording.log("map/track", rerun.Points3D.from_fields(colors=(20, 100, 190)), static=True)
    for name, deviations in zip(_DEVIATIONS, run.deviations().T, strict=True):
        columns = rerun.Scalars.columns(scalars=deviations)
        recording.send_columns(f"deviations/{name}", _timelines(run, keys), columns)
    if run.log is not None:
        _send_scans(recording, run.log.ranges, run.log.geometry.bearings, times)


def _send_scans(
    recording: Any,  # noqa: ANN401
    ranges: NDArray[np.float32],
    bearings: NDArray[np.float64],
    times: Any,  # noqa: ANN401
) -> None:
    import rerun

    hit = np.isfinite(ranges)
    directions = np.column_stack(cos_sin(bearings))
    scans, beams = np.nonzero(hit)
    points = ranges[scans, beams, None] * directions[beams]
    columns = rerun.Points3D.columns(positions=_raised(points)).partition(hit.sum(axis=1))
    recording.send_columns("map/robot/laser/scan", times, columns)
    look = rerun.Points3D.from_fields(colors=(225, 65, 30), radii=-2.0)  # negative: in points of the screen
    recording.log("map/robot/laser/scan", look, static=True)


def _timelines(run: RecordedRun, scans: NDArray[np.int64]) -> list[Any]:
    import rerun

    seconds = run.stamps[scans] - run.stamps[0]
    return [rerun.TimeColumn("scan", sequence=scans), rerun.TimeColumn("time", duration=seconds)]


def _grid(grid: OccupancyGrid) -> Any:  # noqa: ANN401
    """A rectangle in the plane with the picture of the grid on it, its first row at the top."""
    import rerun

    classes = grid.classes()[::-1]
    picture = np.full((*classes.shape, 3), _GREYS[-1], dtype=np.uint8)
    for value, grey in _GREYS.items():
        picture[classes == value] = grey
    x_min, x_max, y_min, y_max = grid.extent
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    return rerun.Mesh3D(
        vertex_positions=_raised(corners, -0.01),
        vertex_texcoords=[[0, 1], [1, 1], [1, 0], [0, 0]],
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        albedo_texture=picture,
    )


def _transform(pose: NDArray[np.float64]) -> Any:  # noqa: ANN401
    import rerun

    x, y, heading = pose.tolist()
    turn = rerun.Quaternion(xyzw=[0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading)])
    return rerun.Transform3D(translation=[x, y, 0.0], quaternion=turn)


def _raised(points: NDArray[np.float64], height: float = 0.0) -> NDArray[np.float64]:
    """Points (..., 2) in the plane as points (..., 3) at a height [m]."""
    return np.concatenate([points, np.full((*points.shape[:-1], 1), height)], axis=-1)


def _layout(grid: OccupancyGrid) -> Any:  # noqa: ANN401
    """The map from above, the standard deviations below it; the track is shown up to the cursor."""
    import rerun
    import rerun.blueprint as layout

    x_min, x_max, y_min, y_max = grid.extent
    centre, size = (0.5 * (x_min + x_max), 0.5 * (y_min + y_max)), max(x_max - x_min, y_max - y_min)
    so_far = rerun.VisibleTimeRange(
        "scan", start=rerun.TimeRangeBoundary.infinite(), end=rerun.TimeRangeBoundary.cursor_relative()
    )
    above = layout.Spatial3DView(
        origin="map",
        name="Map",
        background=[255, 255, 255],
        line_grid=False,
        eye_controls=layout.EyeControls3D(
            position=[*centre, 1.2 * size], look_target=[*centre, 0.0], eye_up=[0.0, 1.0, 0.0]
        ),
        overrides={
            "map/track": [layout.VisibleTimeRanges([so_far])],
            "map/path": [layout.EntityBehavior(visible=False)],
            "map/graph": [layout.EntityBehavior(visible=False)],
            "map/closures/rejected": [layout.EntityBehavior(visible=False)],
        },
    )
    curves = layout.TimeSeriesView(origin="deviations", name="Standard deviations of the key poses")
    return layout.Blueprint(
        layout.Vertical(above, curves, row_shares=[3, 1]),
        layout.TimePanel(timeline="scan", state="collapsed"),
        collapse_panels=False,
    )

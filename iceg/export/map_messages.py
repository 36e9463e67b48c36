"""What a run has found as messages of ROS that viewers draw: grid, paths, poses with covariances, markers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.bags.planar_messages import PlanarMessages
from graph.dense import congruence
from graph.elementary import cos_sin
from iceg.maps.grid import OccupancyGrid

MAP = "map"
Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity in [0, 1]."""
_LINE_LIST, _SPHERE_LIST = 5, 7  # of visualization_msgs/Marker


def grid_message(make: PlanarMessages, stamp: float, grid: OccupancyGrid, frame: str = MAP) -> Any:  # noqa: ANN401
    """OccupancyGrid: -1 unknown, 0 free, 100 occupied."""
    rows, cols = grid.shape
    header = make.header(stamp, frame)
    origin = make.pose(np.array([*grid.origin, 0.0]))
    info = make.types["nav_msgs/msg/MapMetaData"](header.stamp, grid.resolution, cols, rows, origin)
    return make.types["nav_msgs/msg/OccupancyGrid"](header, info, grid.classes().ravel())


def path_message(
    make: PlanarMessages, stamps: NDArray[np.float64], poses: NDArray[np.float64], frame: str = MAP
) -> Any:  # noqa: ANN401
    """Path of poses (n, 3) at stamps (n,), itself with the last one's stamp."""
    stamped = [make.stamped_pose(stamp, frame, pose) for stamp, pose in zip(stamps.tolist(), poses, strict=True)]
    return make.types["nav_msgs/msg/Path"](make.header(float(stamps[-1]), frame), stamped)


def pose_message(make: PlanarMessages, stamp: float, pose: NDArray[np.float64], covariance: NDArray[np.float64]) -> Any:  # noqa: ANN401
    """PoseWithCovarianceStamped: the covariance (3, 3) is given at the pose, and turned to the axes of the map."""
    (cos,), (sin,) = cos_sin(pose[2:])
    R = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    in_map = np.zeros((6, 6))
    in_map[np.ix_([0, 1, 5], [0, 1, 5])] = congruence(R, covariance)
    stated = make.types["geometry_msgs/msg/PoseWithCovariance"](make.pose(pose), in_map.ravel())
    return make.types["geometry_msgs/msg/PoseWithCovarianceStamped"](make.header(stamp, MAP), stated)


def lines_message(
    make: PlanarMessages,
    stamp: float,
    lines: Mapping[str, NDArray[np.float64]],
    colours: Mapping[str, Colour],
    width: float,
) -> Any:  # noqa: ANN401
    """MarkerArray of lines (m, 2, 2) [m], each kind a namespace that a viewer can switch off; width [m]."""
    points = {name: ends.reshape(-1, 2) for name, ends in lines.items()}
    return _markers(make, stamp, _LINE_LIST, points, colours, width)


def dots_message(
    make: PlanarMessages,
    stamp: float,
    dots: Mapping[str, NDArray[np.float64]],
    colours: Mapping[str, Colour],
    diameter: float,
) -> Any:  # noqa: ANN401
    """MarkerArray of dots (m, 2) [m], each kind a namespace that a viewer can switch off; diameter [m]."""
    return _markers(make, stamp, _SPHERE_LIST, dots, colours, diameter)


def _markers(
    make: PlanarMessages,
    stamp: float,
    shape: int,
    points: Mapping[str, NDArray[np.float64]],
    colours: Mapping[str, Colour],
    size: float,
) -> Any:  # noqa: ANN401
    kinds = make.types
    time, still = kinds["builtin_interfaces/msg/Time"](0, 0), make.pose(np.zeros(3))
    no_texture = kinds["sensor_msgs/msg/CompressedImage"](make.header(0.0, ""), "", np.zeros(0, dtype=np.uint8))
    no_mesh = kinds["visualization_msgs/msg/MeshFile"]("", np.zeros(0, dtype=np.uint8))
    forever = kinds["builtin_interfaces/msg/Duration"](time.sec, 0)
    markers = [
        kinds["visualization_msgs/msg/Marker"](
            make.header(stamp, MAP),
            name,
            0,
            shape,
            0,
            still,
            make.vector(size, size, size),
            kinds["std_msgs/msg/ColorRGBA"](*colours[name]),
            forever,
            False,
            [make.point(x, y) for x, y in places.tolist()],
            [],
            "",
            no_texture,
            [],
            "",
            "",
            no_mesh,
            False,
        )
        for name, places in points.items()
        if len(places)
    ]
    return kinds["visualization_msgs/msg/MarkerArray"](markers)

"""Point clouds as sweeps: of each the slice that a planar laser at the height of its origin would see.

Source: the definition of sensor_msgs/PointCloud2, the same in ROS 1 and ROS 2.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from frontends.bags.errors import MalformedMessageError
from frontends.bags.messages import LaserScan
from frontends.bags.wire import Wire
from frontends.logs.beams import place_on_bearings
from graph.elementary import arctan2

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_LOWEST, _HIGHEST = -0.006, 0.021
"""Height over distance of the points that count: from a third of a degree below the horizon, where no floor is met for
long, to 1.2° above it, so that a laser of sixteen rings two degrees apart has one there."""
_FLAT, _FEWEST_FLAT = 0.02, 20
"""So many points that lie no higher one than another [m] are a planar laser's, in whatever frame they are given."""
_STEP = math.radians(0.5)
_BEARINGS: NDArray[np.float64] = _STEP * (np.arange(round(2.0 * math.pi / _STEP), dtype=np.float64) + 0.5) - math.pi
_SETTING = (float(_BEARINGS[0]), float(_BEARINGS[-1]), _STEP, 0.0, 0.0, 0.0, 0.0)
_FORMATS = {7: "f4", 8: "f8"}
_MOST_FIELDS, _MOST_POINTS = 100, 10_000_000


class _Layout(NamedTuple):
    """How the points of a cloud lie in its bytes.

    Attributes:
        rows: of points …
        columns: … and points of each.
        fields: where x, y and z are in a point, and of what type, by name.
    """

    rows: int
    columns: int
    fields: dict[str, tuple[int, int]]


def point_cloud(wire: Wire) -> LaserScan:
    """sensor_msgs/PointCloud2: the horizontal distance in each direction, NaN where no point of the slice lies.

    Of several points in one direction the one nearest to its middle counts.
    """
    stamp, frame = wire.header()
    rows, columns = wire.count(), wire.count()
    n_fields = wire.count()
    if n_fields > _MOST_FIELDS or rows * columns > _MOST_POINTS:
        raise MalformedMessageError(f"found {n_fields} fields of {rows} × {columns} points, expected fewer")
    fields = {}
    for _ in range(n_fields):
        name, offset, kind, _ = wire.string(), wire.count(), wire.byte(), wire.count()
        fields[name] = (offset, kind)
    points = _points(wire, _Layout(rows, columns, fields))
    with np.errstate(invalid="ignore", over="ignore"):
        distances = np.sqrt(points[0] ** 2 + points[1] ** 2)
        heights = points[2, np.isfinite(points).all(axis=0)]
        if len(heights) >= _FEWEST_FLAT and float(np.ptp(heights)) < _FLAT:
            points[2] = 0.0
        is_level = (points[2] >= _LOWEST * distances) & (points[2] <= _HIGHEST * distances) & (distances > 0.0)
    x, y = points[:2, is_level & np.isfinite(distances)]
    bearings = arctan2(y, x)
    order = np.argsort(bearings, kind="stable")
    distances = np.sqrt(x**2 + y**2)[order].astype(np.float32)
    return LaserScan(stamp, frame, _SETTING, place_on_bearings(distances, bearings[order], _BEARINGS))


def _points(wire: Wire, layout: _Layout) -> NDArray[np.float64]:
    """(3, n) x, y and z."""
    order = ">" if wire.byte() else "<"
    point_step, row_step = wire.count(), wire.count()
    data = wire.raw(wire.count())
    rows, columns, fields = layout
    formats, offsets = [], []
    for name in "xyz":
        offset, kind = fields.get(name, (0, 0))
        if kind not in _FORMATS or offset + (4 if kind == 7 else 8) > point_step:
            raise MalformedMessageError(f"found points with the fields {', '.join(fields)[:80]}, expected x, y and z")
        formats.append(f"{order}{_FORMATS[kind]}")
        offsets.append(offset)
    if row_step < columns * point_step or rows * row_step > len(data):
        raise MalformedMessageError(f"found {len(data)} bytes, expected {rows} rows of {columns} points")
    packed = np.frombuffer(data, np.uint8, rows * row_step).reshape(rows, row_step)[:, : columns * point_step]
    dtype = np.dtype({"names": ["x", "y", "z"], "formats": formats, "offsets": offsets, "itemsize": point_step})
    records = np.ascontiguousarray(packed).reshape(-1).view(dtype)
    return np.array([records[name] for name in "xyz"], dtype=np.float64)

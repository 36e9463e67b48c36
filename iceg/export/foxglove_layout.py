"""How Foxglove is to lay out the recording of a run: the map from above, and how sure the poses are below it."""

from typing import Any

_SHOWN: dict[str, dict[str, Any]] = {
    "/map": {"visible": True, "colorMode": "map", "alpha": 1.0},
    "/scan": {"visible": True, "pointSize": 4, "colorMode": "flat", "flatColor": "#e0421f"},
    "/path": {"visible": False, "type": "line", "lineWidth": 0.03, "gradient": ["#9aa4b2", "#9aa4b2"]},
    "/path_so_far": {"visible": True, "type": "line", "lineWidth": 0.06, "gradient": ["#1565c0", "#1565c0"]},
    "/pose": {"visible": True, "showCovariance": True, "covarianceColor": "#1565c066"},
    "/graph": {"visible": False},
    "/closures": {"visible": True, "namespaces": {"rejected": {"visible": False}}},
    "/landmarks": {"visible": True},
    "/walls": {"visible": True},
}
_DEVIATIONS = (
    ("/deviations.vector.x", "along the heading, m", "#1565c0"),
    ("/deviations.vector.y", "across, m", "#2e9d5b"),
    ("/deviations.vector.z", "heading, rad", "#e0421f"),
)
_MARGIN = 1.1
_VIEW_ANGLE = 45.0
"""Of the camera [degrees]; from above, in parallel projection, the distance tells how much is seen."""


def foxglove_layout(extent: tuple[float, float, float, float]) -> dict[str, Any]:
    """A layout as Foxglove imports it.

    Args:
        extent: x_min, x_max, y_min, y_max of the map [m], all of which is to be seen.
    """
    x_min, x_max, y_min, y_max = extent
    camera = {
        "perspective": False,
        "distance": _MARGIN * max(x_max - x_min, y_max - y_min),
        "phi": 0.0,
        "thetaOffset": 0.0,
        "fovy": _VIEW_ANGLE,
        "near": 0.5,
        "far": 5000.0,
        "target": [0.0, 0.0, 0.0],
        "targetOffset": [0.5 * (x_min + x_max), 0.5 * (y_min + y_max), 0.0],
        "targetOrientation": [0.0, 0.0, 0.0, 1.0],
    }
    scene = {"cameraState": camera, "followMode": "follow-none", "followTf": "map", "topics": _SHOWN}
    lines = [
        {"value": value, "label": label, "color": colour, "enabled": True, "timestampMethod": "receiveTime"}
        for value, label, colour in _DEVIATIONS
    ]
    plot = {"title": "Standard deviations of the key poses", "paths": lines, "xAxisVal": "timestamp", "isSynced": True}
    return {
        "configById": {"3D!map": scene, "Plot!deviations": plot},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 5},
        "layout": {"direction": "column", "first": "3D!map", "second": "Plot!deviations", "splitPercentage": 75},
    }

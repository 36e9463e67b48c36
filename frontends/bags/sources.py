"""What a topic's name and frames say of the poses on it: the robot's odometry, the truth, or another program's map."""

import re

from frontends.bags import messages
from frontends.bags.records import PoseSource

_TRUTH = re.compile(r"truth|(^|[/_])gt([/_]|$)|mocap|vicon|optitrack|vrpn|qualisys|natnet|motive", re.IGNORECASE)
_ESTIMATE = re.compile(
    r"slam|amcl|rf2o|icp|carto|gmapping|hector|scan_match|/mapping/|(lidar|laser)_?odo"
    r"|(^|[/_])(lidar|laser|map|goal)([/_]|$)",  # whole words: a robot may be called lidarbot
    re.IGNORECASE,
)
_FIXED_FRAMES = {"map", "world", "earth", "mocap", "vicon", "optitrack"}


def is_truth(source: PoseSource) -> bool:
    """Whether a topic's name says that its poses are the truth."""
    return _TRUTH.search(source.topic) is not None


def is_estimate(source: PoseSource) -> bool:
    """Whether a topic's name or frame says that another program made its poses of scans."""
    return _ESTIMATE.search(source.topic) is not None or is_fixed_frame(source.parent)


def is_odometry(source: PoseSource) -> bool:
    """Whether a topic may hold the robot's own odometry: neither the truth nor what another program made of scans."""
    return source.type == messages.ODOMETRY and not is_truth(source) and not is_estimate(source)


def is_odometry_frame(frame: str) -> bool:
    """Whether a frame is the one that odometry is given in."""
    return "odom" in last_word(frame)


def is_fixed_frame(frame: str) -> bool:
    """Whether a frame is another program's map, or the world."""
    return last_word(frame) in _FIXED_FRAMES


def last_word(frame: str) -> str:
    """A frame's name without the robot's."""
    return frame.rsplit("/", 1)[-1].lower()

"""Reading a bag: what a person may overrule, and what is loaded only then."""

from collections.abc import Callable
from pathlib import Path

from frontends.scan import Log


def read_bag(
    path: Path | str,
    *,
    laser: str = "front",
    scan_topic: str | None = None,
    scan_frame: str | None = None,
    odometry_topic: str | None = None,
    base_frame: str | None = None,
    range_min: float | None = None,
    range_max: float | None = None,
    skip_bad_lines: bool = False,  # noqa: ARG001  (malformed messages are always passed over, counted and told)
    progress: Callable[[int, int], None] | None = None,
) -> Log:
    """Read a bag of ROS 1, or of ROS 2 as sqlite3 or MCAP: a file, or a folder of files that continue each other.

    One laser is used (`choose_laser`), told apart by topic and frame; where there is no scan, the level slice of a
    point cloud (`frontends.bags.point_clouds`). Scans are put in the order of their own stamps. Odometry is a
    nav_msgs/Odometry topic, else the transform from odom to the robot, brought to the time of each scan; poses that
    another program made of the scans (map → odom), and the truth, are never taken for it. The laser's place comes from
    the transforms, else from the robot's description. `Log.choices` says what was chosen and why.

    Readings at `range_max` of the messages and beyond, below `range_min`, zero, NaN and infinite ones are no returns.

    Args:
        path: the bag.
        laser: "front" to choose, else the same as `scan_topic`.
        scan_topic: topic of the laser.
        scan_frame: frame of the laser, where several share a topic.
        odometry_topic: topic of the odometry, whatever it is.
        base_frame: the robot's frame: the one that the odometry moves, or one that sits on it.
        range_min: shortest return [m]; None for what the messages state.
        range_max: longest return [m]; None for what the messages state, at most 40 m.
        skip_bad_lines: makes no difference: malformed messages are passed over, counted and told.
        progress: called with how many messages are read, and how many there are.

    Raises:
        BagError: the bag cannot be read, or holds no scan.
    """
    from frontends.bags.assembly import BagOptions, read_bag_as_log  # loads the rosbags library

    options = BagOptions(
        scan_topic=scan_topic if laser == "front" or scan_topic is not None else laser,
        scan_frame=scan_frame,
        odometry_topic=odometry_topic,
        base_frame=base_frame,
        range_min=range_min,
        range_max=range_max,
    )
    return read_bag_as_log(Path(path), options, progress)

"""One pass through a USARSim log: scans, poses, and what it says about its lasers."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.budget import Budget
from frontends.logs.errors import MalformedLineError
from frontends.logs.line_loop import LineTroubles, read_lines
from frontends.logs.number_fields import checked_pose
from frontends.logs.sensor_poses import SensorPoses
from frontends.logs.text import Line
from frontends.logs.usarsim_messages import Message, parse_message, parse_sensors
from graph.limits import LIMITS

LASER = "rangescanner"
_FARTHEST_MOUNT = 100.0  # m: no robot is larger
POSES = {"odometry": "Odometry", "ins": "INS", "groundtruth": "GroundTruth"}
"""The types of messages that hold a pose, as they are looked up and as they are called."""


@dataclass(slots=True, kw_only=True)
class Sweeps:
    """The scans of one range scanner, row by row as they stand in the file."""

    ranges: list[NDArray[np.float32]] = field(default_factory=list)
    setups: list[tuple[int, float, float]] = field(default_factory=list)  # beams, FOV and resolution [rad]
    stamps: list[float] = field(default_factory=list)
    places: list[int] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class Records:
    """What the lines of a log held. Places count all messages from the beginning of the file.

    Attributes:
        sweeps: by name of the range scanner.
        poses: by type of message.
        limits: MinRange, MaxRange and Fov that CONF says, by name of the range scanner.
        mounts: x, y, roll and yaw that GEO says, likewise.
        counts: messages by kind.
        troubles: lines passed over, and what else a person should know.
    """

    sweeps: dict[str, Sweeps] = field(default_factory=dict)
    poses: dict[str, SensorPoses] = field(default_factory=lambda: {name: SensorPoses() for name in POSES})
    limits: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    mounts: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    troubles: LineTroubles = field(default_factory=LineTroubles)


def collect(path: Path, *, skip_bad_lines: bool) -> Records:
    """Go through the log once."""
    records = Records()
    budget = Budget(path)
    now = 0.0

    def read(line: Line) -> None:
        nonlocal now
        message = parse_message(line)
        if message is not None:
            now = message.number("time", now)
            _record(records, message, line, now, budget)

    read_lines(path, read, records.troubles, skip_bad_lines=skip_bad_lines)
    return records


def _record(records: Records, message: Message, line: Line, now: float, budget: Budget) -> None:
    place = records.counts.total()
    kind, of_type = message.kind, message.type
    if kind == "SEN" and not of_type:
        raise MalformedLineError("a SEN message without {Type}", "the type of its sensor")
    if kind == "SEN" and of_type == LASER:
        for sensor in parse_sensors(line) if line.text.lower().count(b"range") > 2 else [message]:
            _record_sweep(records, sensor, now, place, budget)
    elif kind == "SEN" and of_type in POSES:
        records.poses[of_type].add(_pose(message), message.number("time"), place)
    elif kind in {"CONF", "GEO"} and of_type == LASER:
        for sensor in parse_sensors(line):
            if kind == "CONF":
                limits = [sensor.number(key) for key in ("minrange", "maxrange", "fov")]
                records.limits[sensor.text("name")] = (limits[0], limits[1], limits[2])
            else:
                records.mounts[sensor.text("name")] = _mount(records, sensor)
    records.counts[f"{kind} {message.text('type')}".strip()] += 1


def _record_sweep(records: Records, sensor: Message, now: float, place: int, budget: Budget) -> None:
    ranges = sensor.numbers("range")
    if len(ranges) > LIMITS.beams:
        raise MalformedLineError(f"{len(ranges)} readings", f"at most {LIMITS.beams}")
    budget.take(len(ranges))
    setup = (len(ranges), sensor.number("fov"), sensor.number("resolution"))
    sweeps = records.sweeps.setdefault(sensor.text("name"), Sweeps())
    sweeps.ranges.append(ranges.astype(np.float32))
    sweeps.setups.append(setup)
    sweeps.stamps.append(now)
    sweeps.places.append(place)


def _pose(message: Message) -> tuple[float, float, float]:
    """x, y [m] and heading [rad] as recorded."""
    if "pose" in message.fields:
        x, y, heading = message.numbers("pose", 3).tolist()
    else:
        (x, y, _), (_, _, heading) = (message.numbers(key, 3).tolist() for key in ("location", "orientation"))
    return checked_pose(x, y, heading)


def _mount(records: Records, sensor: Message) -> tuple[float, float, float, float]:
    (x, y, _), (roll, _, yaw) = (sensor.numbers(key, 3).tolist() for key in ("location", "orientation"))
    if not (max(abs(x), abs(y)) <= _FARTHEST_MOUNT and max(abs(roll), abs(yaw)) <= LIMITS.heading):
        raise MalformedLineError(
            f"{x} {y} {roll} {yaw}", f"a finite mounting within {_FARTHEST_MOUNT:g} m of the robot"
        )
    base = sensor.text("mount")
    if base.lower() not in {"", "hard", "platform", "robot"}:
        sentence = f"the laser {sensor.text('name')} is mounted on '{base}', whose own place on the robot is left out"
        if sentence not in records.troubles.warnings:  # logs repeat where the laser sits
            records.troubles.warnings.append(sentence)
    return x, y, roll, yaw

"""What a scan costs that `iceg.Mapper` takes, over the length of a log, and how far off its pose is at once."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from iceg.config import Config
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.trajectory import trajectory_errors
from iceg.mapper import Event, Mapper
from iceg.pipeline import run

SCENE, SCENE_SCANS = "endless", 17_000
"""Of the scene that `growth` takes, as many scans as the longest of the classic logs has."""
BOUND_MS = 20.0
"""Processor time within which a scan is to be done [ms]."""
_SHARES = (0.5, 0.99, 0.999, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedLog:
    """What a mapper made of a log, scan by scan.

    Attributes:
        name: of the log.
        cpu_ms: (n,) processor time of each scan [ms].
        poses: (n, 3) where it said that the robot is, when it came.
        events: how often each happened.
        trajectory: (n, 3) the same in the end, without the finish.
        key_poses: in the end.
    """

    name: str
    cpu_ms: NDArray[np.float64]
    poses: NDArray[np.float64]
    events: Counter[Event]
    trajectory: NDArray[np.float64]
    key_poses: int


def mapper_rows(logs: list[BenchLog]) -> Iterator[Row]:
    """A row a log: processor time a scan, and the poses given at once against those of `iceg.run`."""
    from frontends.simulator.simulation import simulate

    for log in logs:
        yield mapper_row(replace(read_log(log.path), path=log.path.with_name(log.name)))
    yield mapper_row(simulate(SCENE).log.select(slice(SCENE_SCANS)))


def mapper_row(log: Log) -> Row:
    """The row of one log."""
    mapped_log(log.select(slice(0, 300)))  # compiles what is not compiled yet
    mapped = mapped_log(log)
    finished = run(log, Config()).trajectory
    at_once, in_the_end = (trajectory_errors(poses, finished) for poses in (mapped.poses, mapped.trajectory))
    return {
        "log": mapped.name,
        "scans": len(log),
        "key poses": mapped.key_poses,
        "mean [ms]": float(mapped.cpu_ms.mean()),
        **{f"{100.0 * share:g} % [ms]": float(np.quantile(mapped.cpu_ms, share)) for share in _SHARES},
        f"over {BOUND_MS:g} ms": int(np.count_nonzero(mapped.cpu_ms > BOUND_MS)),
        "last third, 99 % [ms]": float(np.quantile(mapped.cpu_ms[-len(log) // 3 :], 0.99)),
        **{event.value: mapped.events[event] for event in (Event.LOOP_CLOSED, Event.CARRIED, Event.LOST)},
        "off the run's, at once [m]": at_once.ate_rmse,
        "in the end [m]": in_the_end.ate_rmse,
        "at most [m]": in_the_end.ate_max,
    }


def mapped_log(log: Log) -> MappedLog:
    """Give a mapper one scan of a log after the other."""
    mapper = Mapper(log.geometry, name=log.path.name)
    cpu_ms, poses = np.empty(len(log)), np.empty((len(log), 3))
    events: Counter[Event] = Counter()
    key_poses = 0
    for scan in range(len(log)):
        odometry = log.odometry[scan] if log.has_odometry else None
        began = time.process_time_ns()
        update = mapper.add(log.ranges[scan], odometry, float(log.stamps[scan]))
        cpu_ms[scan] = 1e-6 * (time.process_time_ns() - began)
        poses[scan] = update.pose
        events[update.event] += 1
        key_poses += update.is_key_scan
    return MappedLog(
        name=log.path.name,
        cpu_ms=cpu_ms,
        poses=poses,
        events=events,
        trajectory=mapper.result().trajectory,
        key_poses=key_poses,
    )

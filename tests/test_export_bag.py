"""`iceg export --to bag`: a copy of the recording in which rosbags finds the run, and else what was recorded."""

import bisect
import math
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from rosbags.interfaces import QosDurability

import iceg
from frontends.bags.rosbags_files import bag_reader
from frontends.bags.storage import open_bag
from graph.se2 import between, compose, wrap_angle
from iceg.cli import main
from iceg.evaluation.truth import read_truth
from iceg.run_folder import read_run_folder
from tests import bags

N_SCANS = 60
MOUNT = np.array([0.1, 0.0, 0.2])
KINDS = ("ros1-lz4", "sqlite3", "sqlite3-messages", "mcap-zstd")


class Recorded(NamedTuple):
    """A message as a bag holds it."""

    topic: str
    type: str
    recorded: int
    data: bytes


def said() -> Iterator[bags.Said]:
    """A robot whose odometry comes ten times a second, between the scans, and another program's map → odom."""
    log = iceg.read_log(iceg.demo_log_path()).select(slice(0, N_SCANS))
    stamps = 1.6e9 + 0.25 * np.arange(N_SCANS)
    yield bags.transform(1.6e9 - 1.0, "base_link", "laser", MOUNT, topic="/tf_static")
    yield bags.transform(1.6e9 - 1.0, "map", "dock", [1.0, 2.0, 0.0], topic="/tf_static")
    for stamp, pose, ranges in zip(stamps, log.odometry, log.ranges, strict=True):
        laser = bags.scan(stamp, np.where(np.isfinite(ranges), ranges, np.inf), limits=(0.02, 81.0))
        yield laser._replace(recorded=stamp + 0.02)
        yield bags.transform(stamp - 0.05, "odom", "base_link", pose)
        yield bags.transform(stamp - 0.04, "map", "odom", [5.0, 5.0, 1.0])
        yield bags.unknown(stamp + 0.03)
    yield bags.transform(float(stamps[-1]) + 0.2, "odom", "base_link", log.odometry[-1])
    yield bags.text(1.6e9, "/map_metadata", "of another map")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bags.write_bag(tmp_path_factory.mktemp("bags"), said())


@pytest.fixture(scope="module")
def run(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["run", str(recording), "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module", params=KINDS)
def pair(request: pytest.FixtureRequest, run: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The recording in a container, and its corrected copy."""
    room = tmp_path_factory.mktemp(request.param)
    recording = bags.write_bag(room, said(), request.param)
    assert main(["export", str(run), "--to", "bag", "--log", str(recording), "-o", str(room / "copy")]) == 0
    return recording, room / "copy"


def messages_of(path: Path) -> list[Recorded]:
    """All that a bag holds."""
    found = []
    with open_bag(path) as bag:
        for file in bag.files:
            reader = bag_reader(file.path, file.container)
            reader.open()
            for connection, recorded, data in reader.messages(reader.connections):
                whole = bags.unpacked(bytes(data))
                found.append(Recorded(connection.topic, connection.msgtype, recorded, whole))
            reader.close()
    return found


def decoded(path: Path, topic: str) -> list[Any]:
    is_ros1 = next(iter(path.glob("*.bag")), None) is not None
    types = bags.store(is_ros1=is_ros1)
    unpack = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    return [unpack(message.data, message.type) for message in messages_of(path) if message.topic == topic]


def edges(path: Path) -> dict[tuple[str, str], list[tuple[float, np.ndarray]]]:
    """Stamps and poses of the transforms by parent and child."""
    found: dict[tuple[str, str], list[tuple[float, np.ndarray]]] = {}
    for message in decoded(path, "/tf") + decoded(path, "/tf_static"):
        for transform in message.transforms:
            place, turn = transform.transform.translation, transform.transform.rotation
            pose = np.array([place.x, place.y, 2.0 * math.atan2(turn.z, turn.w)])
            edge = transform.header.frame_id, transform.child_frame_id
            found.setdefault(edge, []).append((seconds(transform.header), pose))
    return found


def seconds(header: Any) -> float:
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)


def looked_up(transforms: list[tuple[float, np.ndarray]], stamp: float) -> np.ndarray:
    """As tf2 does: linear between two transforms; the heading, too, as about one axis slerp is."""
    transforms = sorted(transforms, key=lambda one: one[0])
    k = bisect.bisect_right([at for at, _ in transforms], stamp)
    assert 0 < k < len(transforms)
    (before, a), (after, b) = transforms[k - 1 : k + 1]
    share = (stamp - before) / (after - before)
    step = b - a
    step[2] = wrap_angle(step[2])
    return np.asarray(a + share * step)


def test_from_map_to_base_is_the_path_at_each_scan(pair: tuple[Path, Path], run: Path) -> None:
    found, trajectory = edges(pair[1]), read_run_folder(run).trajectory
    assert sorted(found) == [("base_link", "laser"), ("map", "odom"), ("odom", "base_link")]
    poses = np.array(
        [
            compose(looked_up(found["map", "odom"], stamp), looked_up(found["odom", "base_link"], stamp))
            for stamp in trajectory.stamps.tolist()
        ]
    )
    offsets = between(trajectory.poses, poses)
    np.testing.assert_allclose(offsets, 0.0, atol=1e-6)  # the stamps of a bag, as float64, are known to 0.2 µs


def test_all_else_is_byte_for_byte(pair: tuple[Path, Path]) -> None:
    replaced = ("/map", "/map_metadata", "/path")
    for topic in ("/scan", "/bump", "/tf"):
        before = Counter(message for message in messages_of(pair[0]) if message.topic == topic)
        after = Counter(message for message in messages_of(pair[1]) if message.topic == topic)
        gone, added = before - after, after - before
        assert (len(gone), len(added)) == ((N_SCANS, N_SCANS + 2) if topic == "/tf" else (0, 0))
    topics = Counter(message.topic for message in messages_of(pair[1]))
    assert [topics[topic] for topic in replaced] == [1, 0, 1]
    assert topics["/tf_static"] == 1


def test_who_subscribes_late_gets_map_and_path(pair: tuple[Path, Path], run: Path) -> None:
    found = read_run_folder(run)
    ((grid,), (path,)) = decoded(pair[1], "/map"), decoded(pair[1], "/path")
    np.testing.assert_array_equal(grid.data.reshape(found.grid.shape), found.grid.classes())
    origin = grid.info.origin.position
    np.testing.assert_allclose([origin.x, origin.y, grid.info.resolution], [*found.grid.origin, found.grid.resolution])
    assert (grid.header.frame_id, path.header.frame_id, len(path.poses)) == ("map", "map", N_SCANS)
    with open_bag(pair[1]) as bag:
        reader = bag_reader(bag.files[0].path, bag.files[0].container)
        reader.open()
        for connection in reader.connections:
            if connection.topic in ("/map", "/path"):
                if bag.files[0].container == "ros1":
                    assert connection.ext.latching == 1
                else:
                    (quality,) = connection.ext.offered_qos_profiles
                    assert quality.durability == QosDurability.TRANSIENT_LOCAL
        reader.close()


def test_iceg_reads_the_same_log_from_the_copy(pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    before, after = iceg.read_log(pair[0]), iceg.read_log(pair[1])
    for name in ("ranges", "odometry", "stamps"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_array_equal(after.geometry.T_robot_laser, before.geometry.T_robot_laser)
    assert after.has_odometry
    assert main(["info", str(pair[1])]) == 0
    assert "/map (nav_msgs/msg/OccupancyGrid)" in capsys.readouterr().out


def test_the_path_in_the_copy_is_the_truth_of_the_run(
    run: Path, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(run), "--to", "bag", "--log", str(recording), "-o", str(tmp_path / "copy")]) == 0
    assert capsys.readouterr().err == (
        f"added: map → odom at {N_SCANS} scans on /tf, /map, /path; replaced: 1 transforms map → dock, "
        f"{N_SCANS} transforms map → odom, 1 messages on /map_metadata; all other messages are as recorded\n"
    )
    (path,) = decoded(tmp_path / "copy", "/path")
    lines = [
        f"{one.header.stamp.sec}.{one.header.stamp.nanosec:09d} {one.pose.position.x!r} {one.pose.position.y!r} 0 0 0 "
        f"{one.pose.orientation.z!r} {one.pose.orientation.w!r}"
        for one in path.poses
    ]
    (tmp_path / "path.tum").write_text("\n".join(lines) + "\n")
    trajectory, truth = read_run_folder(run).trajectory, read_truth(tmp_path / "path.tum")
    np.testing.assert_allclose(between(truth.poses, trajectory.poses), 0.0, atol=1e-9)
    assert truth.stamps is not None
    np.testing.assert_allclose(truth.stamps, trajectory.stamps, atol=1e-6)


def test_the_same_run_gives_the_same_copy_and_a_copy_can_be_copied(run: Path, recording: Path, tmp_path: Path) -> None:
    for log, name in ((recording, "a"), (recording, "b"), (tmp_path / "a", "c")):
        assert main(["export", str(run), "--to", "bag", "--log", str(log), "-o", str(tmp_path / name)]) == 0
    first = (tmp_path / "a" / "corrected.bag").read_bytes()
    assert (tmp_path / "b" / "corrected.bag").read_bytes() == first
    assert sorted(messages_of(tmp_path / "c")) == sorted(messages_of(tmp_path / "a"))


def test_without_odometry_the_map_carries_the_robot_itself(tmp_path: Path, run: Path) -> None:
    mine = tmp_path / "run"
    shutil.copytree(run, mine)
    only = [each for each in said() if each.topic == "/scan" or each.fields.get("child_frame_id") == "laser"]
    recording = bags.write_bag(tmp_path, only, "mcap")
    assert main(["export", str(mine), "--to", "bag", "--log", str(recording)]) == 0
    found, trajectory = edges(mine / "bag"), read_run_folder(mine).trajectory
    assert sorted(found) == [("base_link", "laser"), ("map", "base_link")]
    poses = np.array([looked_up(found["map", "base_link"], stamp) for stamp in trajectory.stamps.tolist()])
    np.testing.assert_allclose(between(trajectory.poses, poses), 0.0, atol=1e-6)


def test_what_is_no_bag_of_the_run_is_refused(
    run: Path, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = bags.write_bag(tmp_path, list(said())[:150], name="short")
    cut = tmp_path / "cut.bag"
    cut.write_bytes(recording.read_bytes()[:-3000])
    own = tmp_path / "bag"
    own.mkdir()
    shutil.copy(recording, own / "corrected.bag")
    for log, out, words in (
        (short, tmp_path / "out", "expected the log of the run"),
        (cut, tmp_path / "out", "cut.bag: damaged ("),
        (iceg.demo_log_path(), tmp_path / "out", "found a log of the format carmen, expected a bag"),
        (own, own, "holds the recorded log itself"),
        (own / "corrected.bag", own, "holds the recorded log itself"),
        (tmp_path / "missing.bag", tmp_path / "out", "missing.bag: cannot be read as a log: No such file or directory"),
    ):
        capsys.readouterr()
        assert main(["export", str(run), "--to", "bag", "--log", str(log), "-o", str(out)]) == 1
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
        assert not (tmp_path / "out").exists()

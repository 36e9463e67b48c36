"""`iceg export --to mcap` and `--to rerun`: the viewers' own readers find in the recordings what the run found."""

import gzip
import itertools
import json
import shutil
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

import iceg
from graph.se2 import compose
from iceg.cli import main
from iceg.run_folder import RunFolder, read_run_folder

N_SCANS = 120
VERDICTS = ("accepted", "rejected", "removed")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "short.clf"
    with gzip.open(iceg.demo_log_path(), "rt", encoding="ascii") as lines:
        scans = (line for line in lines if line.startswith("FLASER"))
        path.write_text("".join(itertools.islice(scans, N_SCANS)), encoding="ascii")
    return path


@pytest.fixture(scope="module")
def run(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run, with a closure of each verdict, and a stamp that steps back."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["run", str(log), "-o", str(folder)]) == 0
    closures = (folder / "closures.csv").read_text().splitlines()[:1]
    closures += [f"{10 * k},{100 + k},1,2,0.5,0.9,100,0.8,{verdict},why" for k, verdict in enumerate(VERDICTS)]
    (folder / "closures.csv").write_text("\n".join(closures) + "\n")
    lines = (folder / "trajectory.tum").read_text().splitlines()
    stamps, poses = zip(*(line.split(" ", 1) for line in lines), strict=True)
    swapped = [*stamps[:50], stamps[51], stamps[50], *stamps[52:]]
    (folder / "trajectory.tum").write_text("".join(f"{s} {pose}\n" for s, pose in zip(swapped, poses, strict=True)))
    summary = json.loads((folder / "summary.json").read_text())
    del summary["files"]  # their digests
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


@pytest.fixture(scope="module")
def found(run: Path) -> RunFolder:
    return read_run_folder(run)


@pytest.fixture(scope="module")
def bag(run: Path, log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags") / "bag"
    assert main(["export", str(run), "--to", "mcap", "--log", str(log), "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def messages(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """What Foxglove sees: each topic's times and messages, decoded by the definitions in the file."""
    return read_mcap(bag / "run.mcap")


def read_mcap(path: Path) -> dict[str, list[tuple[int, Any]]]:
    topics: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            topics[channel.topic].append((message.log_time, content))
    return topics


def planar(pose: Any) -> np.ndarray:
    place = getattr(pose, "translation", None) or pose.position
    turn = getattr(pose, "rotation", None) or pose.orientation
    return np.array([place.x, place.y, 2.0 * np.arctan2(turn.z, turn.w)])


def markers(message: Any) -> dict[str, np.ndarray]:
    return {marker.ns: np.array([(p.x, p.y) for p in marker.points]) for marker in message.markers}


def close(found: np.ndarray, expected: np.ndarray) -> None:
    difference = np.asarray(found) - expected
    difference[..., 2:] = np.angle(np.exp(1j * difference[..., 2:]))
    np.testing.assert_allclose(difference, 0.0, atol=1e-6)


def test_transforms_lead_from_the_map_over_odometry_to_the_laser(
    messages: dict[str, list[tuple[int, Any]]], found: RunFolder, log: Path
) -> None:
    times = [time for time, _ in messages["/tf"]]
    assert len(times) == N_SCANS
    assert np.diff(times).min() > 0
    chains = [{t.child_frame_id: planar(t.transform) for t in message.transforms} for _, message in messages["/tf"]]
    poses = np.array([compose(chain["odom"], chain["base_link"]) for chain in chains])
    close(poses, found.trajectory.poses)
    recorded = iceg.read_log(log)
    close(np.array([chain["base_link"] for chain in chains]), recorded.odometry)
    ((_, mount),) = messages["/tf_static"]
    assert mount.transforms[0].child_frame_id == "laser"
    close(planar(mount.transforms[0].transform), recorded.geometry.T_robot_laser)


def test_scans_are_those_of_the_log(messages: dict[str, list[tuple[int, Any]]], log: Path) -> None:
    recorded = iceg.read_log(log)
    ranges = np.array([message.ranges for _, message in messages["/scan"]])
    np.testing.assert_array_equal(np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32), recorded.ranges)
    assert [time for time, _ in messages["/scan"]] == [time for time, _ in messages["/tf"]]


def test_the_map_and_what_lies_on_it(messages: dict[str, list[tuple[int, Any]]], found: RunFolder) -> None:
    ((_, grid),) = messages["/map"]
    cells = np.array(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
    np.testing.assert_array_equal(cells, found.grid.classes())
    np.testing.assert_allclose(planar(grid.info.origin)[:2], found.grid.origin)
    assert grid.info.resolution == pytest.approx(found.grid.resolution)
    landmarks = markers(messages["/landmarks"][0][1])
    assert sum(map(len, landmarks.values())) == len(found.landmarks.settled()) > 0
    np.testing.assert_allclose(markers(messages["/walls"][0][1])["walls"], found.walls.ends.reshape(-1, 2))


def test_the_path_grows_and_ends_as_the_whole(messages: dict[str, list[tuple[int, Any]]], found: RunFolder) -> None:
    ((_, whole),) = messages["/path"]
    close(np.array([planar(pose.pose) for pose in whole.poses]), found.trajectory.poses)
    so_far = [[planar(pose.pose) for pose in message.poses] for _, message in messages["/path_so_far"]]
    assert [len(path) for path in so_far] == list(range(1, len(found.key_scans) + 1))
    close(np.array(so_far[-1]), found.key_poses)
    assert [time for time, _ in messages["/path_so_far"]] == [time for time, _ in messages["/pose"]]


def test_the_graph_and_the_closures_join_the_right_places(
    messages: dict[str, list[tuple[int, Any]]], found: RunFolder
) -> None:
    closures = markers(messages["/closures"][0][1])
    assert set(closures) == set(VERDICTS)
    for k, verdict in enumerate(VERDICTS):
        np.testing.assert_allclose(closures[verdict], found.trajectory.poses[[10 * k, 100 + k], :2])
    edges = markers(messages["/graph"][0][1])
    assert sum(map(len, edges.values())) >= 2 * (len(found.key_poses) - 1)
    ends = np.unique(np.concatenate(list(edges.values())).round(6), axis=0)
    np.testing.assert_allclose(ends, np.unique(found.key_poses[:, :2].round(6), axis=0), atol=1e-5)


def test_covariances_are_given_in_the_axes_of_the_map(
    messages: dict[str, list[tuple[int, Any]]], found: RunFolder
) -> None:
    for (_, message), pose, covariance in zip(messages["/pose"], found.key_poses, found.covariances, strict=True):
        close(planar(message.pose.pose), pose)
        R = np.eye(3)
        R[:2, :2] = [[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]]
        stated = np.array(message.pose.covariance).reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        np.testing.assert_allclose(stated, R @ covariance @ R.T, atol=1e-12)


def test_the_layout_shows_what_the_recording_has(bag: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    layout = json.loads((bag / "foxglove-layout.json").read_text())
    scene, plot = layout["configById"]["3D!map"], layout["configById"]["Plot!deviations"]
    plotted = {"/" + path["value"].split("/")[1].split(".")[0] for path in plot["paths"]}
    assert set(scene["topics"]) | plotted <= set(messages)
    assert {layout["layout"]["first"], layout["layout"]["second"]} == set(layout["configById"])


def test_the_bag_is_a_log_that_iceg_reads(bag: Path, log: Path) -> None:
    again, recorded = iceg.read_log(bag), iceg.read_log(log)
    np.testing.assert_array_equal(again.ranges, recorded.ranges)
    close(again.odometry, recorded.odometry)
    np.testing.assert_allclose(again.geometry.bearings, recorded.geometry.bearings, atol=1e-6)


def test_the_same_run_gives_the_same_bag_byte_for_byte(bag: Path, run: Path, log: Path, tmp_path: Path) -> None:
    assert main(["export", str(run), "--to", "mcap", "--log", str(log), "-o", str(tmp_path / "again")]) == 0
    content = {path.name: path.read_bytes() for path in bag.iterdir()}
    assert {path.name: path.read_bytes() for path in (tmp_path / "again").iterdir()} == content
    assert sorted(content) == ["foxglove-layout.json", "metadata.yaml", "run.mcap"]


def test_the_scans_that_the_run_has_kept_are_as_good_as_the_log(bag: Path, run: Path, tmp_path: Path) -> None:
    assert main(["export", str(run), "--to", "mcap", "-o", str(tmp_path / "bag")]) == 0
    assert (tmp_path / "bag" / "run.mcap").read_bytes() == (bag / "run.mcap").read_bytes()


@pytest.mark.parametrize("to", ["mcap", "rerun"])
def test_without_any_log_all_but_the_scans_is_there(
    to: str, run: Path, found: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(run, bare)
    (bare / "run.npz").unlink()
    assert main(["export", str(bare), "--to", to, "-o", str(tmp_path / "out")]) == 0
    assert "has not kept its scans" in capsys.readouterr().err
    if to == "rerun":
        assert "/map/robot/laser/scan" not in rerun_rows(tmp_path / "out")
        return
    topics = read_mcap(tmp_path / "out" / "run.mcap")
    assert not topics["/scan"]
    poses = np.array([planar(message.transforms[0].transform) for _, message in topics["/tf"]])
    close(poses, found.trajectory.poses)


def rerun_rows(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Values of each entity by component, those of all times one after the other."""
    rows: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(path).stream().to_chunks():
        table = chunk.to_record_batch().to_pydict()
        for name, values in table.items():
            rows[chunk.entity_path][name.rpartition(":")[2]] += [value for value in values if value is not None]
    return rows


def test_rerun_finds_the_run_in_its_recording(run: Path, log: Path, found: RunFolder, tmp_path: Path) -> None:
    assert main(["export", str(run), "--to", "rerun", "--log", str(log), "-o", str(tmp_path / "a.rrd")]) == 0
    rows = rerun_rows(tmp_path / "a.rrd")
    robot = rows["/map/robot"]
    np.testing.assert_allclose(np.array(robot["translation"])[:, 0, :2], found.trajectory.poses[:, :2], atol=1e-5)
    assert robot["scan"] == list(range(N_SCANS))
    recorded = iceg.read_log(log)
    points = rows["/map/robot/laser/scan"]["positions"]
    assert [len(scan) for scan in points] == np.isfinite(recorded.ranges).sum(axis=1).tolist()
    usable = recorded.ranges[7][np.isfinite(recorded.ranges[7])]
    np.testing.assert_allclose(np.hypot(*np.array(points[7])[:, :2].T), usable, atol=1e-5)
    assert [len(rows[f"/map/closures/{verdict}"]["strips"][0]) for verdict in VERDICTS] == [1, 1, 1]
    dots = [rows[f"/map/landmarks/{kind}"]["positions"] for kind in ("corner", "end_of_wall", "intersection")]
    assert sum(len(places[0]) for places in dots) == len(found.landmarks.settled())
    np.testing.assert_allclose(
        np.array(rows["/deviations/along_m"]["scalars"])[:, 0], np.sqrt(found.covariances[:, 0, 0])
    )
    assert len(rows["/map/walls"]["strips"][0]) == len(found.walls)
    assert rows["/map/grid"]["albedo_texture_buffer"]
    assert RrdReader(tmp_path / "a.rrd").blueprints()


def test_rerun_that_is_not_installed_is_asked_for(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["export", str(run), "--to", "rerun", "-o", str(tmp_path / "a.rrd")]) == 1
    assert "pip install 'iceg[rerun]'" in capsys.readouterr().err


def test_what_is_no_run_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for to in ("mcap", "rerun"):
        assert main(["export", str(tmp_path / "nowhere"), "--to", to]) == 1
        error = capsys.readouterr().err
        assert "nowhere: is no folder, expected one that a run has written" in error
        assert error.count("\n") == 1


def test_a_log_that_is_not_the_runs_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", str(run), "--to", "mcap", "--log", str(iceg.demo_log_path()), "-o", str(tmp_path / "bag")]
    assert main(words) == 1
    assert "holds 1848 scans, the trajectory 120" in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("source", ["run.npz", "--log"])
def test_of_a_run_that_was_cut_afterwards_the_scans_left_are_there(source: str, log: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.toml").write_text("[cut]\nkeep = [[20, 99]]\n")
    whole, resolved = tmp_path / "whole", tmp_path / "resolved"
    assert main(["run", str(log), "-o", str(whole), "--no-report"]) == 0
    assert main(["resolve", str(whole), "--corrections", str(tmp_path / "cut.toml"), "-o", str(resolved)]) == 0
    words = ["--log", str(log)] if source == "--log" else []
    assert main(["export", str(resolved), "--to", "mcap", "-o", str(tmp_path / "bag"), *words]) == 0
    ranges = [message.ranges for _, message in read_mcap(tmp_path / "bag" / "run.mcap")["/scan"]]
    finite = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
    np.testing.assert_array_equal(finite, iceg.read_log(log).ranges[20:100])

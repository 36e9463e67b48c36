"""Whole simulations: determinism, what each scene is for, scan pairs, files, and the embedded log."""

import errno
import gzip
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs.carmen import read_carmen
from frontends.scan import ScanGeometry
from frontends.simulator import world as shapes
from frontends.simulator.laser import Laser, cast, sick_lms200
from frontends.simulator.output import write_simulation
from frontends.simulator.robot import Driving, Route, Waypoint, drive
from frontends.simulator.scene import Scene, load_scene
from frontends.simulator.simulation import Simulation, scan_pairs, simulate
from frontends.simulator.world import SimulatorError, World
from graph import se2
from iceg.cli import main
from iceg.demo import demo_log_path, demo_truth_path
from iceg.demo.make import simulate_demo, write_demo

EXACT = Laser(range_std=0.0, range_std_per_metre=0.0, quantisation=0.0, mixed_share=0.0)

simulated = cache(simulate)


def test_the_same_seed_gives_the_same_log_and_another_seed_another() -> None:
    first, again, other = simulate("room", 3), simulate("room", 3), simulate("room", 4)
    for a, b in zip(_arrays(first), _arrays(again), strict=True):
        assert a.tobytes() == b.tobytes()
    assert not np.array_equal(first.truth[:300], other.truth[:300])
    assert not np.array_equal(first.log.odometry[:300], other.log.odometry[:300])


def test_noise_of_the_laser_does_not_change_the_drive() -> None:
    noisy, exact = simulated("room", 3), simulate("room", 3, laser=EXACT)
    np.testing.assert_array_equal(noisy.truth, exact.truth)
    np.testing.assert_array_equal(noisy.log.odometry, exact.log.odometry)
    assert np.nanmedian(np.abs(noisy.log.ranges - exact.log.ranges)) < 0.02


def test_log_and_truth_have_one_row_per_scan_from_the_start_on() -> None:
    simulation = simulated("office", 1)
    n = len(simulation.log)
    assert simulation.log.ranges.shape == (n, 181)
    assert simulation.log.ranges.dtype == np.float32
    assert simulation.truth.shape == simulation.log.odometry.shape == (n, 3)
    np.testing.assert_allclose(np.diff(simulation.log.stamps), 0.2)
    np.testing.assert_array_equal(simulation.truth[0], 0.0)
    np.testing.assert_array_equal(simulation.log.odometry[0], 0.0)


def test_the_office_is_long_enough_has_a_loop_and_bad_odometry() -> None:
    simulation = simulated("office", 1)
    way = np.hypot(*np.diff(simulation.truth[:, :2], axis=0).T)
    assert 1500 <= len(simulation.log) <= 2000
    assert 120 <= way.sum() <= 180
    gone = np.cumsum(way)
    near_start = np.hypot(simulation.truth[1:, 0], simulation.truth[1:, 1]) < 1.0
    assert np.any(near_start & (gone > 60) & (gone < 110))
    error = np.hypot(*(simulation.log.odometry - simulation.truth)[:, :2].T)
    assert 1.0 < np.sqrt(np.mean(error**2)) < 8.0


def test_in_the_middle_of_the_long_corridor_its_long_direction_leaves_no_trace() -> None:
    scene = load_scene("long_corridor")
    here, further = (cast(scene.world, [(x, 0.2, 0.0)], sick_lms200().bearings, 20.0) for x in (25.0, 31.0))
    np.testing.assert_allclose(here, further)
    truth = simulated("long_corridor", 0).truth
    assert np.sum((truth[:, 0] > 17) & (truth[:, 0] < 57)) > 300


def test_the_wall_vanishes_unseen_and_the_robot_looks_at_its_place_again() -> None:
    simulation = simulated("vanishing_wall", 0)
    world, stamps = simulation.scene.world, simulation.log.stamps
    gone_at = float(np.min(world.visible_to))
    wall = replace(
        world,
        visible_from=np.full(len(world.segments), -np.inf),
        visible_to=np.where(np.isfinite(world.visible_to), np.inf, world.visible_to),
    )
    without = replace(world, visible_from=np.where(np.isfinite(world.visible_to), np.inf, -np.inf))
    T_map_laser = se2.compose(simulation.truth, simulation.log.geometry.T_robot_laser)
    bearings = simulation.log.geometry.bearings
    differs = np.any(cast(wall, T_map_laser, bearings, 20.0) != cast(without, T_map_laser, bearings, 20.0), axis=1)
    assert differs[stamps < gone_at].sum() > 30
    assert differs[stamps >= gone_at].sum() > 100
    assert not differs[np.abs(stamps - gone_at) < 1.0].any()


def test_the_command_line_writes_them_too_and_says_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "room", "-o", str(tmp_path / "a"), "--seed", "3"]) == 0
    assert "371 scans in 74.0 s of 'room'" in capsys.readouterr().out
    write_simulation(tmp_path / "b", simulated("room", 3))
    for name in ("log.clf", "log.usarsim", "truth.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    (tmp_path / "file").write_text("")
    assert main(["simulate", "room", "-o", str(tmp_path / "file")]) == 1
    before = (tmp_path / "a" / "log.clf").read_bytes()
    assert main(["simulate", "room", "-o", str(tmp_path / "a"), "--seed", "4"]) == 1
    assert "is not empty" in capsys.readouterr().err
    assert (tmp_path / "a" / "log.clf").read_bytes() == before
    assert main(["simulate", "room", "-o", str(tmp_path / "a"), "--seed", "4", "--overwrite"]) == 0
    assert (tmp_path / "a" / "log.clf").read_bytes() != before
    assert main(["simulate", "nowhere", "-o", str(tmp_path / "c")]) == 1
    assert "no scene 'nowhere'" in capsys.readouterr().err


def test_a_scene_has_its_own_laser_and_wheels() -> None:
    scene, quiet = load_scene("noisy"), load_scene("building")
    assert scene.laser.range_std > quiet.laser.range_std
    assert scene.laser.sweep_time > 0
    assert scene.odometry.drift_std > quiet.odometry.drift_std
    short = replace(scene, route=replace(scene.route, duration=8.0))
    noisy, exact = simulate(short, 1), simulate(short, 1, laser=EXACT)
    assert np.nanstd(noisy.log.ranges - exact.log.ranges) > 0.02
    np.testing.assert_array_equal(noisy.truth, exact.truth)


def test_an_endless_drive_comes_round_again_and_again() -> None:
    scene = load_scene("endless")
    assert scene.route.duration == pytest.approx(99_999 * 0.2)
    two_laps = drive(replace(scene.route, laps=2, duration=None), Driving(), 0.2, np.random.default_rng(0))
    assert scene.route.laps * len(two_laps) / 2 > 100_000
    near_start = np.hypot(*two_laps[:, :2].T) < 1.0
    assert np.sum(np.diff(near_start.astype(int)) == 1) >= 2


def test_scan_pairs_are_exact_reproducible_and_keep_their_distance() -> None:
    pairs = scan_pairs("room", 60, 5, max_translation=0.4, max_rotation=0.3, laser=EXACT)
    again = scan_pairs("room", 60, 5, max_translation=0.4, max_rotation=0.3, laser=EXACT)
    assert pairs.current.tobytes() == again.current.tobytes()
    assert pairs.reference.shape == pairs.current.shape == (60, 181)
    distance = np.hypot(pairs.T_ref_cur[:, 0], pairs.T_ref_cur[:, 1])
    assert distance.max() <= 0.4
    assert distance.max() > 0.3
    assert np.abs(pairs.T_ref_cur[:, 2]).max() <= 0.3
    world = load_scene("room").world
    T_map_cur = se2.compose(pairs.T_map_ref, pairs.T_ref_cur)
    for poses, ranges in ((pairs.T_map_ref, pairs.reference), (T_map_cur, pairs.current)):
        assert world.clearance(poses[:, :2]).min() > 0.3
        for pose, scan in zip(poses, ranges, strict=True):
            assert world.clearance(_points(pose, scan, pairs.geometry)).max() < 1e-5


def test_a_scene_without_room_for_pairs_says_so() -> None:
    world = World.empty().with_segments(shapes.rectangle(1, 0, 4, 0.5))
    narrow = Scene(name="slot", world=world, route=Route(start=(0, 0, 0), waypoints=(Waypoint(x=1, y=0),)))
    with pytest.raises(SimulatorError, match="'slot'"):
        scan_pairs(narrow, 3)


def test_written_log_reads_back_as_it_was_simulated(tmp_path: Path) -> None:
    simulation = simulated("room", 3)
    write_simulation(tmp_path / "out", simulation)
    log = read_carmen(tmp_path / "out" / "log.clf")
    np.testing.assert_array_equal(log.ranges, simulation.log.ranges)
    np.testing.assert_allclose(log.odometry, simulation.log.odometry, atol=1e-6)
    np.testing.assert_allclose(log.stamps, simulation.log.stamps, atol=1e-6)
    np.testing.assert_allclose(log.geometry.bearings, simulation.log.geometry.bearings)
    np.testing.assert_allclose(log.geometry.T_robot_laser, simulation.log.geometry.T_robot_laser, atol=1e-5)
    text = (tmp_path / "out" / "truth.csv").read_text()
    assert text.startswith("t_s,x_m,y_m,theta_rad\n")
    table = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)
    np.testing.assert_allclose(table, np.column_stack([simulation.log.stamps, simulation.truth]), atol=1e-6)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["log.clf", "log.usarsim", "truth.csv"]


def test_an_interrupted_simulation_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_simulation(tmp_path / "old", simulated("room", 3))
    before = {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()}

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("frontends.simulator.output.write_usarsim", interrupted)
    for folder in ("old", "new"):
        with pytest.raises(KeyboardInterrupt):
            write_simulation(tmp_path / folder, simulated("room", 4))
    assert {path.name: path.read_bytes() for path in (tmp_path / "old").iterdir()} == before
    assert not (tmp_path / "new").exists()


def test_a_simulation_that_cannot_be_written_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, _simulation: Simulation) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("frontends.simulator.output.write_truth", full)
    with pytest.raises(SimulatorError, match=r"/new: the simulation cannot be written \(No space left on device\)$"):
        write_simulation(tmp_path / "new", simulated("room", 3))


def test_the_embedded_log_is_what_the_simulator_makes(tmp_path: Path) -> None:
    write_demo(tmp_path)
    made, embedded = tmp_path / demo_log_path().name, demo_log_path()
    assert gzip.decompress(made.read_bytes()) == gzip.decompress(embedded.read_bytes())
    # No name and no time in either; how tightly the rest is packed is up to the machine's zlib.
    assert made.read_bytes()[:8] == embedded.read_bytes()[:8] == b"\x1f\x8b\x08" + bytes(5)
    assert (tmp_path / demo_truth_path().name).read_bytes() == demo_truth_path().read_bytes()


def test_the_embedded_log_is_small_and_reads_as_simulated() -> None:
    assert demo_log_path().stat().st_size < 700_000
    log, simulation = read_carmen(demo_log_path()), simulate_demo()
    np.testing.assert_array_equal(log.ranges, simulation.log.ranges)
    truth = np.loadtxt(demo_truth_path(), delimiter=",", skiprows=1)
    assert len(truth) == len(log)
    np.testing.assert_allclose(truth[:, 1:], simulation.truth, atol=1e-6)


@pytest.mark.parametrize("sweep_time", [0.0, 0.02])
def test_a_period_of_no_whole_number_of_ticks_is_refused(sweep_time: float) -> None:
    laser = Laser(period=0.025, sweep_time=sweep_time)
    with pytest.raises(SimulatorError, match=r"multiple of 0.02 s, found 0.025 s"):
        simulate("office", laser=laser)


def _arrays(simulation: Simulation) -> tuple[NDArray[np.floating], ...]:
    return (simulation.log.ranges, simulation.log.odometry, simulation.log.stamps, simulation.truth)


def _points(pose: NDArray[np.float64], scan: NDArray[np.float32], geometry: ScanGeometry) -> NDArray[np.float64]:
    hit = np.isfinite(scan)
    p = geometry.origin_robot + scan[hit, None] * geometry.directions_robot[hit]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    placed: NDArray[np.float64] = p @ np.array([(c, s), (-s, c)]) + pose[:2]
    return placed

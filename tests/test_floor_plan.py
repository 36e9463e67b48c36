"""Floor plans: straight walls out of pieces, corners, and how they compare with true walls."""

import itertools
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from frontends.simulator.simulation import simulate
from graph.se2 import transform_points
from iceg.cli import main
from iceg.evaluation.floor_plan import FloorPlanErrors, floor_plan_errors, true_hits
from iceg.evaluation.trajectory import align
from iceg.export.formats import FORMATS, export_results
from iceg.floor_plan.plan import FloorPlan, floor_plan
from iceg.results import write_results
from iceg.run_folder import read_run_folder
from iceg.slam.joint.wall_pieces import WallPieces

F64 = NDArray[np.float64]
SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def pieces(lines: list[tuple[tuple[float, float], tuple[float, float]]], off: float = 0.0, seed: int = 0) -> WallPieces:
    """Pieces of 0.4 m of each line, which stop 6 cm before its ends and scatter across it."""
    rng = np.random.default_rng(seed)
    ends = []
    for first, second in lines:
        start, vector = np.array(first), np.subtract(second, first)
        length = float(np.hypot(*vector))
        along = vector / length
        left = np.array([-along[1], along[0]])
        places = np.arange(0.06, length - 0.1, 0.4)
        for place, stop in zip(places, [*places[1:], length - 0.06], strict=True):
            shift = off * rng.normal() * left
            ends.append([start + place * along + shift, start + stop * along + shift])
    n = len(ends)
    return WallPieces(
        ends=np.array(ends), points=np.full(n, 100), deviations=np.full(n, 0.005), key_poses=np.full(n, 10)
    )


def sides(corners: list[tuple[float, float]]) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def test_a_room_has_four_walls_that_meet_at_its_corners() -> None:
    plan = floor_plan(pieces(sides(SQUARE), off=0.004))
    assert plan.is_sure.tolist() == [True] * 4
    ends = plan.walls.reshape(-1, 2)
    for corner in SQUARE:
        assert (np.hypot(*(ends - corner).T) < 0.01).sum() == 2
    assert len(np.unique(ends.round(9), axis=0)) == 4  # both walls of a corner end at the very same place


def test_a_wall_between_rooms_ends_on_the_wall_it_meets() -> None:
    plan = floor_plan(pieces([((0.0, 0.0), (4.0, 0.0)), ((2.0, 3.0), (2.0, 0.0))]))
    long, short = sorted(plan.walls, key=lambda wall: -float(np.hypot(*(wall[1] - wall[0]))))
    np.testing.assert_allclose(np.sort(long[:, 0]), [0.06, 3.94], atol=1e-9)
    np.testing.assert_allclose(short[np.argmin(short[:, 1])], [2.0, 0.0], atol=1e-9)


def test_a_door_stays_open_and_a_missing_beam_does_not() -> None:
    door = floor_plan(pieces([((0.0, 0.0), (2.0, 0.0)), ((2.8, 0.0), (5.0, 0.0))]))
    beam = floor_plan(pieces([((0.0, 0.0), (2.0, 0.0)), ((2.05, 0.0), (5.0, 0.0))]))
    assert (len(door.walls), len(beam.walls)) == (2, 1)


def test_faces_of_a_thick_wall_stay_two_and_of_a_thin_one_become_one() -> None:
    def faces(thickness: float) -> WallPieces:
        return pieces([((0.0, 0.0), (3.0, 0.0)), ((3.0, thickness), (0.0, thickness))])

    assert len(floor_plan(faces(0.1)).walls) == 2
    (thin,) = floor_plan(faces(0.02)).walls
    np.testing.assert_allclose(thin[:, 1], 0.01, atol=1e-9)


def test_a_round_wall_becomes_a_chain_near_it() -> None:
    angles = np.linspace(0.0, math.pi, 40)
    corners = [(4.0 * math.cos(angle), 4.0 * math.sin(angle)) for angle in angles]
    ends = np.array(list(itertools.pairwise(corners)))
    n = len(ends)
    plan = floor_plan(
        WallPieces(ends=ends, points=np.full(n, 50), deviations=np.full(n, 0.01), key_poses=np.full(n, 9))
    )
    assert 3 < len(plan.walls) < 20
    assert len(np.unique(plan.walls.reshape(-1, 2).round(9), axis=0)) == len(plan.walls) + 1
    assert np.abs(np.hypot(*plan.walls.reshape(-1, 2).T) - 4.0).max() < 0.08


def test_what_was_seen_once_or_thinly_is_in_doubt() -> None:
    whole = pieces([((0.0, 0.0), (3.0, 0.0)), ((0.0, 2.0), (3.0, 2.0)), ((0.0, 4.0), (3.0, 4.0))])
    rows = whole.ends[:, 0, 1].round().astype(int)
    once = WallPieces(
        ends=whole.ends,
        points=np.where(rows == 4, 3, whole.points),
        deviations=whole.deviations,
        key_poses=np.where(rows == 2, 1, whole.key_poses),
    )
    plan = floor_plan(once)
    assert dict(zip(plan.walls[:, 0, 1].round().tolist(), plan.is_sure.tolist(), strict=True)) == {
        0.0: True,
        2.0: False,
        4.0: False,
    }


def test_errors_count_what_lacks_and_what_is_too_much() -> None:
    truth = np.array([[[0.0, 0.0], [10.0, 0.0]], [[0.0, 5.0], [10.0, 5.0]], [[50.0, 0.0], [60.0, 0.0]]])
    hits = np.concatenate([np.column_stack([np.repeat(np.arange(0, 10, 0.01), 2), np.full(2000, y)]) for y in (0, 5)])
    plan = np.array([[[0.0, 0.02], [10.0, 0.02]], [[0.0, 5.0], [5.0, 5.0]], [[3.0, 1.0], [5.0, 1.0]]])
    errors = floor_plan_errors(plan, truth, hits)
    assert errors.seen == pytest.approx(20.0)  # the third wall was never seen
    assert errors.found == pytest.approx(0.75, abs=0.005)
    assert (errors.drawn, errors.spurious) == pytest.approx((17.0, 2.0))
    assert errors.mean_error == pytest.approx(0.02 * 10 / 15)
    nothing = floor_plan_errors(np.empty((0, 2, 2)), truth, hits)
    assert (nothing.found, nothing.drawn) == (0.0, 0.0)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FloorPlanErrors]:
    """The folder of a run in a simulated home, and its floor plan's errors."""
    simulation = simulate("home")
    result = iceg.run(simulation.log)
    folder = tmp_path_factory.mktemp("home") / "run"
    write_results(result, folder)
    T_world_map = align(result.trajectory, simulation.truth)
    walls = transform_points(T_world_map, floor_plan(result.walls).sure)
    true_walls = simulation.scene.world.segments.reshape(-1, 2, 2)
    return folder, floor_plan_errors(walls, true_walls, true_hits(simulation.log, simulation.truth))


def test_the_walls_of_a_simulated_home_are_found_where_they_are(home: tuple[Path, FloorPlanErrors]) -> None:
    errors = home[1]
    assert errors.found > 0.9
    assert errors.spurious < 0.01 * errors.drawn
    assert errors.mean_error < 0.003
    assert errors.largest_error < 0.006


def test_every_format_holds_the_same_walls_in_metres(home: tuple[Path, FloorPlanErrors], tmp_path: Path) -> None:
    run = read_run_folder(home[0])
    plan = floor_plan(run.walls, name=run.log_name)
    drawing = ET.parse(export_results(home[0], "floorplan.svg", tmp_path / "plan.svg")).getroot()
    layers = {group.get("id"): len(group) for group in drawing.iter("{http://www.w3.org/2000/svg}g")}
    assert (layers["walls"], layers["walls-in-doubt"]) == (len(plan.sure), len(plan.doubtful))
    document = ezdxf.readfile(export_results(home[0], "floorplan.dxf", tmp_path / "plan.dxf"))
    assert document.units == 6  # metres
    lines = [line for line in document.modelspace().query("LINE") if line.dxf.layer == "WALLS"]
    drawn = np.array([[line.dxf.start.vec2, line.dxf.end.vec2] for line in lines])
    np.testing.assert_allclose(drawn, plan.sure, atol=1e-6)
    assert export_results(home[0], "floorplan.pdf", tmp_path / "plan.pdf").read_bytes().startswith(b"%PDF")


def test_a_plan_is_the_same_bytes_each_time(home: tuple[Path, FloorPlanErrors], tmp_path: Path) -> None:
    for name in (name for name in FORMATS if name.startswith("floorplan")):
        first, second = (export_results(home[0], name, tmp_path / f"{turn}-{name}").read_bytes() for turn in "ab")
        assert first == second, name


def test_the_command_names_the_file_and_a_run_without_walls_is_refused(
    home: tuple[Path, FloorPlanErrors], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "plan.svg"
    assert main(["export", str(home[0]), "--to", "floorplan.svg", "-o", str(output)]) == 0
    assert capsys.readouterr().out == f"{output}\n"
    older = tmp_path / "older"
    older.mkdir()
    for file in home[0].iterdir():
        if file.name != "walls.csv":
            (older / file.name).write_bytes(file.read_bytes())
    assert main(["export", str(older), "--to", "floorplan.svg"]) == 1
    assert "walls.csv: tells of no walls" in capsys.readouterr().err


def test_an_empty_plan_has_no_walls() -> None:
    plan = floor_plan(WallPieces.none())
    assert isinstance(plan, FloorPlan)
    assert len(plan.sure) == len(plan.doubtful) == 0
    assert plan.box == (0.0, 0.0, 0.0, 0.0)

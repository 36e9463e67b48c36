"""Worlds, their shapes and their text format."""

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontends.simulator import world as shapes
from frontends.simulator.laser import Laser
from frontends.simulator.people import Person
from frontends.simulator.robot import OdometryModel, Route, Waypoint
from frontends.simulator.scene import SCENES, Scene, load_scene, parse_scene, read_scene, write_scene
from frontends.simulator.world import SimulatorError, World

ROUTE = "start 0 0 0\ngoto 1 0\n"
WHERE = Path("some.world")

coordinates = st.floats(-1e3, 1e3, allow_subnormal=False)


def test_clearance_to_the_side_beyond_the_ends_and_of_nothing() -> None:
    world = World.empty().with_segments(shapes.polyline([(0, 0), (10, 0)]))
    points = [(5, 2), (-3, 4), (13, -4), (7, 0)]
    np.testing.assert_allclose(world.clearance(points), [2, 5, 5, 0], atol=1e-12)
    assert np.isinf(World.empty().clearance(points)).all()


def test_what_vanishes_stands_until_then() -> None:
    wall = shapes.polyline([(0, 0), (1, 0)])
    world = World.empty().with_segments(wall, start=10.0, end=20.0)
    assert [len(world.at(t)) for t in (9.9, 10.0, 19.9, 20.0)] == [0, 1, 1, 0]
    assert np.isinf(world.clearance([(0, 1)], 25.0)[0])


def test_rectangle_turned_by_a_right_angle_swaps_its_sides() -> None:
    flat = shapes.rectangle(1, 2, 4, 2)
    upright = shapes.rectangle(1, 2, 2, 4, math.pi / 2)
    assert sorted(map(tuple, _points(flat).round(9))) == sorted(map(tuple, _points(upright).round(9)))


def test_table_stands_on_four_legs_inside_its_outline() -> None:
    legs = shapes.table(0, 0, 2.0, 1.0, leg=0.1)
    assert len(legs) == 16
    np.testing.assert_allclose(np.abs(_points(legs)).max(axis=0), [1.0, 0.5])
    np.testing.assert_allclose(np.abs(_points(legs)).min(axis=0), [0.9, 0.4])


def test_arc_lies_on_its_circle_and_closes() -> None:
    circle = shapes.arc(1, -1, 0.5)
    np.testing.assert_allclose(np.linalg.norm(_points(circle) - (1, -1), axis=1), 0.5)
    np.testing.assert_allclose(circle[0, :2], circle[-1, 2:], atol=1e-12)


def test_thick_wall_has_two_faces_and_closes_its_corner() -> None:
    wall = World.empty().with_segments(shapes.thick_wall([(0, 0), (4, 0), (4, 3)], 0.2))
    np.testing.assert_allclose(wall.clearance([(2, 1.0), (2, -1.0)]), 0.9)
    np.testing.assert_allclose(wall.clearance([(4.1, -0.1)]), 0.0, atol=1e-12)


def test_segments_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(SimulatorError, match=r"\(n, 4\).*\(2, 3\)"):
        World(segments=np.zeros((2, 3)), visible_from=np.zeros(2), visible_to=np.zeros(2))
    with pytest.raises(SimulatorError, match="as many times"):
        World(segments=np.zeros((2, 4)), visible_from=np.zeros(1), visible_to=np.zeros(2))


def test_parse_every_statement() -> None:
    text = """
    # a comment
    wall 0 0 5 0 5 5          # two legs
    wall 0 2 3 2 thick=0.1 appears=1 vanishes=9.5
    box 1 1 0.5 0.5 turn=45
    table 2 2 1 0.6 leg=0.05
    arc 3 3 0.4 from=0 to=90 pieces=4
    start 1 2 90
    goto 3 4
    goto 5 6 pause=2.5
    laps 3
    lasts 120.5
    person 0 0 4 0 4 4 speed=0.8 appears=10
    laser range_std=0.02 beam_width=1
    odometry drift_std=2 slip_std=0.1
    """
    scene = parse_scene(text, WHERE)
    assert scene.people == (Person(path=((0, 0), (4, 0), (4, 4)), speed=0.8, appears=10.0),)
    assert (scene.laser.range_std, scene.laser.beam_width) == (0.02, math.radians(1))
    assert (scene.odometry.drift_std, scene.odometry.slip_std) == (math.radians(2), 0.1)
    assert scene.odometry.translation_std == OdometryModel().translation_std
    assert len(scene.world.segments) == 2 + 4 + 4 + 16 + 4
    assert len(scene.world.at(0.0)) == len(scene.world.segments) - 4
    assert scene.route == Route(
        start=(1.0, 2.0, math.radians(90)),
        waypoints=(Waypoint(x=3, y=4), Waypoint(x=5, y=6, pause=2.5)),
        laps=3,
        duration=120.5,
    )


def test_what_things_are_made_of() -> None:
    scene = parse_scene("wall 0 0 1 0\nwall 0 1 1 1 glass=0.8\nbox 3 3 1 1 dark=0.5\n" + ROUTE, WHERE)
    assert scene.world.glass is not None
    assert scene.world.dark is not None
    np.testing.assert_array_equal(scene.world.glass, [0, 0.8, 0, 0, 0, 0])
    np.testing.assert_array_equal(scene.world.dark, [0, 0, 0.5, 0.5, 0.5, 0.5])
    through = scene.world.without_glass()
    assert len(through.at(0.0)) == 5
    assert parse_scene("wall 0 0 1 0\n" + ROUTE, WHERE).world.glass is None
    with pytest.raises(SimulatorError, match=r"shares of 'glass' in \[0, 1\]"):
        World.empty().with_segments(shapes.rectangle(0, 0, 1, 1), glass=1.5)


def test_a_scene_includes_what_stands_and_walks_in_another_but_not_its_route(tmp_path: Path) -> None:
    (tmp_path / "house.world").write_text("wall 0 0 9 0\nperson 0 0 1 1\nstart 5 5 5\ngoto 6 6\nlasts 3\nlaps 9\n")
    (tmp_path / "town.world").write_text("include house.world\nbox 1 1 1 1\n")
    scene = parse_scene("include town.world\n" + ROUTE, tmp_path / "here.world")
    assert len(scene.world.segments) == 5
    assert len(scene.people) == 1
    assert scene.route == Route(start=(0, 0, 0), waypoints=(Waypoint(x=1, y=0),))
    (tmp_path / "house.world").write_text("include town.world\n")
    with pytest.raises(SimulatorError, match=r"house\.world:1: found 'town\.world' again"):
        read_scene(tmp_path / "town.world")
    with pytest.raises(SimulatorError, match=r"none\.world"):
        parse_scene("include none.world\n" + ROUTE, tmp_path / "here.world")


@pytest.mark.parametrize(
    ("line", "found", "expected"),
    [
        ("wal 0 0 1 1", "'wal'", "wall"),
        ("wall 0 0 1", "3 numbers", "two a point"),
        ("wall 0 0 1 one", "'one'", "a number"),
        ("wall 0 0 1 nan", "'nan'", "a number"),
        ("wall 0 0 1 1 thick=", "''", "a number"),
        ("box 0 0 1", "3 numbers", "box X Y WIDTH DEPTH"),
        ("box 0 0 1 1 turned=3", "'turned='", "turn="),
        ("arc 0 0 1 pieces=2.5", "pieces=2.5", "whole number"),
        ("arc 0 0 1 pieces=0", "pieces=0", "at least 1"),
        ("start 1 1 1", "second 'start'", "one start"),
        ("goto 1 1 1", "3 numbers", "goto X Y"),
        ("goto 1 1 vanishes=3", "'vanishes='", "pause="),
        ("laps 2.5", "'2.5' laps", "whole number"),
        ("laps 0", "'0' laps", "at least 1"),
        ("lasts -1", "'-1' seconds", "a time"),
        ("wall 0 0 1 1 glass=2", "glass=2", "share"),
        ("laser strength=3", "'strength='", "range_std="),
        ("odometry 3", "1 numbers", "drift_std="),
        ("person 1 1", "2 numbers", "two a point"),
        ("include", "0 words", "include FILE"),
    ],
)
def test_a_malformed_line_is_named(line: str, found: str, expected: str) -> None:
    with pytest.raises(SimulatorError) as caught:
        parse_scene(ROUTE + line, WHERE)
    message = str(caught.value)
    assert message.startswith("some.world:3: found ")
    what, want = message.split("expected", maxsplit=1)
    assert found in what
    assert expected in want


@pytest.mark.parametrize("line", ["laser mixed_share=2", "person 1 1 1 1", "person 0 0 1 1 speed=-1", "plan none.svg"])
def test_what_cannot_be_is_named_with_its_line(line: str) -> None:
    with pytest.raises(SimulatorError, match=r"^some\.world:3: "):
        parse_scene(ROUTE + line, WHERE)


@pytest.mark.parametrize("text", ["", "wall 0 0 1 1", "start 0 0 0", "goto 1 1"])
def test_a_scene_needs_a_route(text: str) -> None:
    with pytest.raises(SimulatorError, match=r"some\.world: .*route"):
        parse_scene(text, WHERE)


def test_files_that_are_not_there_or_not_text(tmp_path: Path) -> None:
    with pytest.raises(SimulatorError, match=r"none\.world"):
        read_scene(tmp_path / "none.world")
    (tmp_path / "bytes.world").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SimulatorError, match=r"bytes\.world"):
        load_scene(str(tmp_path / "bytes.world"))
    with pytest.raises(SimulatorError, match=r"no scene 'ofice'.*office"):
        load_scene("ofice")


@given(text=st.text(alphabet="wal boxtrcgs0123456789.-=#\n", max_size=200))
def test_any_text_is_a_scene_or_a_simulator_error(text: str) -> None:
    with suppress(SimulatorError):
        assert parse_scene(text, WHERE).route.waypoints


shares = st.just(0.0) | st.floats(0, 1)


@given(
    segments=st.lists(
        st.tuples(coordinates, coordinates, coordinates, coordinates, coordinates | st.just(math.inf), shares, shares),
        max_size=5,
    ),
    people=st.lists(
        st.builds(
            Person,
            path=st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=4, unique=True).map(tuple),
            speed=st.floats(0.1, 3),
            vanishes=coordinates | st.just(math.inf),
        ),
        max_size=2,
    ),
    laps=st.integers(1, 9),
    duration=st.none() | st.floats(0, 1e5),
    settings=st.tuples(st.floats(0, 1), st.floats(0, 0.2), st.floats(-1, 1)),
    start=st.tuples(coordinates, coordinates, st.floats(-math.pi, math.pi, allow_subnormal=False)),
    waypoints=st.lists(st.builds(Waypoint, x=coordinates, y=coordinates, pause=st.floats(0, 99)), min_size=1),
)
def test_written_and_read_back_is_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    segments: list[tuple[float, float, float, float, float, float, float]],
    people: list[Person],
    laps: int,
    duration: float | None,
    settings: tuple[float, float, float],
    start: tuple[float, float, float],
    waypoints: list[Waypoint],
) -> None:
    world = World.empty()
    for *segment, vanishes, glass, dark in segments:
        world = world.with_segments(np.array([segment]), end=vanishes, glass=glass, dark=dark)
    mixed, sweep, drift = settings
    scene = Scene(
        name="there",
        world=world,
        route=Route(start=start, waypoints=tuple(waypoints), laps=laps, duration=duration),
        people=tuple(people),
        laser=Laser(mixed_share=mixed, sweep_time=sweep),
        odometry=OdometryModel(heading_drift=drift),
    )
    path = tmp_path_factory.mktemp("worlds") / "there.world"
    write_scene(path, scene)
    back = read_scene(path)
    np.testing.assert_array_equal(back.world.segments, world.segments)
    np.testing.assert_array_equal(back.world.visible_from, world.visible_from)
    np.testing.assert_array_equal(back.world.visible_to, world.visible_to)
    for share, written in ((back.world.glass, world.glass), (back.world.dark, world.dark)):
        np.testing.assert_array_equal(0 if share is None else share, 0 if written is None else written)
    assert back.people == scene.people
    assert (back.laser.mixed_share, back.laser.sweep_time) == (mixed, sweep)
    assert back.odometry.heading_drift == pytest.approx(drift, rel=1e-15, abs=1e-300)
    assert (back.route.waypoints, back.route.laps, back.route.duration) == (scene.route.waypoints, laps, duration)
    assert back.route.start == pytest.approx(start, rel=1e-15, abs=1e-300)
    assert back.name == "there"


@pytest.mark.parametrize("name", SCENES)
def test_scenes_of_the_package_survive_writing(name: str, tmp_path: Path) -> None:
    scene = load_scene(name)
    write_scene(tmp_path / f"{name}.world", scene)
    back = load_scene(str(tmp_path / f"{name}.world"))
    np.testing.assert_array_equal(back.world.segments, scene.world.segments)
    np.testing.assert_array_equal(back.world.visible_to, scene.world.visible_to)
    assert (back.name, back.route) == (scene.name, scene.route)
    assert scene.route.start == (0.0, 0.0, 0.0)


def _points(segments: shapes.Segments) -> shapes.Segments:
    return segments[:, :2]

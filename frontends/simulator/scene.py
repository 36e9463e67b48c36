"""A scene: a world, who walks in it and the route through it, read from and written to the `.world` text format.

One statement a line, `#` starts a comment, lengths in metres, angles in degrees, times in seconds::

    wall  X0 Y0 X1 Y1 ...  [thick=T]                 a polyline; with a thickness it has two faces
    box   X Y WIDTH DEPTH  [turn=A]                  cupboard, crate, pillar
    table X Y WIDTH DEPTH  [turn=A] [leg=L]          four legs
    arc   X Y RADIUS       [from=A] [to=A] [pieces=N]
    plan  FILE [metres=M] [x=X] [y=Y]                the walls of a floor plan, SVG or image, M metres a unit or pixel
    person X0 Y0 X1 Y1 ... [speed=V]                 walks to and fro, or round where the path ends at its start
    include FILE                                     all that stands and walks in another .world file
    start X Y HEADING                                where the robot starts, once
    goto  X Y              [pause=T]                 a waypoint
    laps  N                                          how often the waypoints are driven to
    lasts T                                          when the drive ends, whatever the operator does
    laser    [NAME] [range_std=S] [sweep_time=T] ... which laser of `LASERS` (sick), and what it does otherwise, by
                                                     the fields of `Laser`
    odometry [drift_std=S] [slip_std=S] ...          how wrong its wheels are, by the fields of `OdometryModel`

Whatever stands can stand for a time only, `appears=T`, `vanishes=T`, and be of `glass=P`, which lets the share P of
the slanting beams pass, or `dark=P`, which swallows the share P of the beams. People come and go, too. Files are
looked up beside the one that names them.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from frontends.simulator import world as shapes
from frontends.simulator.floor_plan import read_plan
from frontends.simulator.laser import Laser
from frontends.simulator.lasers import LASERS, like_which
from frontends.simulator.people import Person
from frontends.simulator.robot import OdometryModel, Route, Waypoint
from frontends.simulator.statements import Statement, statements
from frontends.simulator.world import Segments, SimulatorError, World
from graph.atomic import write_atomically
from graph.files import read_text
from graph.limits import LIMITS, at_most


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A world and the route through it.

    Attributes:
        name: of the scene.
        world: what stands in it.
        route: of the robot.
        people: who walks in it.
        laser: of the robot.
        odometry: how wrong the robot's wheels are.
    """

    name: str
    world: World
    route: Route
    people: tuple[Person, ...] = ()
    laser: Laser = field(default_factory=Laser)
    odometry: OdometryModel = field(default_factory=OdometryModel)


SCENES = (
    "aisles",
    "alike",
    "arena",
    "building",
    "campus",
    "corridor",
    "endless",
    "home",
    "long_corridor",
    "mall",
    "noisy",
    "office",
    "park",
    "pillars",
    "ring",
    "room",
    "rooms",
    "supermarket",
    "vanishing_wall",
)
"""The scenes that come with the package."""

_LASER_OPTIONS = (
    "period",
    "range_std",
    "range_std_per_metre",
    "quantisation",
    "beam_width",
    "edge_step",
    "mixed_share",
    "sweep_time",
)
_ODOMETRY_OPTIONS = tuple(option.name for option in dataclasses.fields(OdometryModel))
_ANGLES = ("beam_width", "heading_drift", "drift_std")
_FOR_EVER = {"appears": -math.inf, "vanishes": math.inf}


def load_scene(name: str) -> Scene:
    """One of the scenes that come with the package, or the scene of a `.world` file.

    Args:
        name: a name of `SCENES`, or the path of a file that ends in `.world`.

    Returns:
        The scene.

    Raises:
        SimulatorError: no such scene, or a malformed file.
    """
    if name.endswith(".world"):
        return read_scene(Path(name))
    if name not in SCENES:
        raise SimulatorError(f"no scene '{name}'; expected one of {', '.join(SCENES)} or the path of a .world file")
    return read_scene(Path(str(resources.files("frontends.simulator") / "scenes" / f"{name}.world")))


def read_scene(path: Path) -> Scene:
    """Read a `.world` file.

    Args:
        path: the file.

    Returns:
        The scene, named after the file.

    Raises:
        SimulatorError: the file is missing or a line is malformed; the message says path:line, what was found and
            what was expected.
    """
    return parse_scene(_text(path), path)


def parse_scene(text: str, path: Path) -> Scene:
    """The scene that a `.world` text describes; `path` names it and its lines in errors."""
    draft = _Draft()
    _draw(draft, text, path, ())
    if draft.start is None or not draft.waypoints:
        raise SimulatorError(f"{path}: found no 'start' or no 'goto', expected a route for the robot")
    route = Route(start=draft.start, waypoints=tuple(draft.waypoints), laps=draft.laps, duration=draft.duration)
    return Scene(
        name=path.stem,
        world=World.joined(draft.standing),
        route=route,
        people=tuple(draft.people),
        laser=draft.laser,
        odometry=draft.odometry,
    )


def write_scene(path: Path, scene: Scene) -> None:
    """Write a scene as a `.world` file, its furniture taken apart into walls.

    Args:
        path: the file; replaced whole if it exists.
        scene: what to write; reading it back gives the same segments, times, people, settings and route. The
            geometry of a laser that is none of `LASERS` is not kept.
    """
    x, y, heading = scene.route.start
    lines = [f"start {x!r} {y!r} {_exact_degrees(heading)!r}"]
    lines += [f"goto {w.x!r} {w.y!r}" + (f" pause={w.pause!r}" if w.pause else "") for w in scene.route.waypoints]
    lines += [f"laps {scene.route.laps}"] if scene.route.laps > 1 else []
    lines += [f"lasts {scene.route.duration!r}"] if scene.route.duration is not None else []
    lines += _laser_line(scene.laser)
    lines += _changed("odometry", scene.odometry, OdometryModel(), _ODOMETRY_OPTIONS)
    for person in scene.people:
        path_words = " ".join(f"{x!r} {y!r}" for x, y in person.path)
        times = _unless(_FOR_EVER, appears=person.appears, vanishes=person.vanishes)
        lines.append(f"person {path_words} speed={person.speed!r}{times}")
    lines += _wall_lines(scene.world)
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def _wall_lines(world: World) -> list[str]:
    n = len(world.segments)
    glass, dark = ([0.0] * n if share is None else share.tolist() for share in (world.glass, world.dark))
    columns = (world.segments.tolist(), world.visible_from.tolist(), world.visible_to.tolist(), glass, dark)
    return [
        "wall "
        + " ".join(repr(value) for value in segment)
        + _unless(_FOR_EVER | {"glass": 0.0, "dark": 0.0}, appears=start, vanishes=end, glass=passing, dark=swallowing)
        for segment, start, end, passing, swallowing in zip(*columns, strict=True)
    ]


def _laser_line(laser: Laser) -> list[str]:
    """The statement of a laser: its name, and what it does otherwise; none for the usual one."""
    name, named = like_which(laser)
    if name == "sick":
        return _changed("laser", laser, named, _LASER_OPTIONS)
    return _changed(f"laser {name}", laser, named, _LASER_OPTIONS) or [f"laser {name}"]


def _changed(
    keyword: str, settings: Laser | OdometryModel, usual: Laser | OdometryModel, names: tuple[str, ...]
) -> list[str]:
    """The statement of the settings that are not the usual ones, none where all are."""
    words = []
    for name in names:
        value = getattr(settings, name)
        if value != getattr(usual, name):
            words.append(f"{name}={_exact_degrees(value) if name in _ANGLES else value!r}")
    return [" ".join([keyword, *words])] if words else []


def _unless(usual: dict[str, float], **values: float) -> str:
    return "".join(f" {name}={value!r}" for name, value in values.items() if value != usual[name])


def _exact_degrees(radians: float) -> float:
    """Degrees that `math.radians` turns back into exactly the same number."""
    degrees = math.degrees(radians)
    for candidate in (degrees, math.nextafter(degrees, math.inf), math.nextafter(degrees, -math.inf)):
        if math.radians(candidate) == radians:
            return candidate
    return degrees


@dataclass(slots=True)
class _Draft:
    """What has been read of a scene so far."""

    standing: list[World] = field(default_factory=list)
    walls: int = 0
    includes: int = 0
    people: list[Person] = field(default_factory=list)
    start: tuple[float, float, float] | None = None
    waypoints: list[Waypoint] = field(default_factory=list)
    laps: int = 1
    duration: float | None = None
    laser: Laser = field(default_factory=Laser)
    odometry: OdometryModel = field(default_factory=OdometryModel)


def _draw(draft: _Draft, text: str, path: Path, including: tuple[Path, ...]) -> None:
    """Add what a text says; of a file that others include only what stands and walks."""
    for statement in statements(text, path):
        if statement.keyword in _SHAPES:
            _add(draft, statement, _standing(statement))
        elif statement.keyword == "plan":
            _add(draft, statement, _plan(statement, path))
        elif statement.keyword == "person":
            draft.people.append(_person(statement))
            if len(draft.people) > LIMITS.people:
                raise statement.error("one more person", at_most("people"))
        elif statement.keyword == "include":
            _include(draft, statement, path, including)
        elif statement.keyword not in _ROUTE:
            known = ", ".join([*_ROUTE, *_SHAPES, "plan", "person", "include"])
            raise statement.error(f"'{statement.keyword[:80]}'", f"one of {known}")
        elif not including:
            _ROUTE[statement.keyword](draft, statement)


def _add(draft: _Draft, statement: Statement, world: World) -> None:
    draft.standing.append(world)
    draft.walls += len(world.segments)
    if draft.walls > LIMITS.walls:
        raise statement.error(f"{draft.walls} pieces of wall", at_most("walls"))


def _text(path: Path) -> str:
    return read_text(path, "drawing_bytes", SimulatorError, "a .world text file", "utf-8")


def _include(draft: _Draft, statement: Statement, path: Path, including: tuple[Path, ...]) -> None:
    statement.options()
    other = path.parent / statement.word("FILE")
    text = _text(other)
    if other.resolve() in [file.resolve() for file in (*including, path)]:
        raise statement.error(f"'{other.name}' again", "no file that includes itself")
    draft.includes += 1
    if draft.includes > LIMITS.includes:
        raise statement.error("one more file to include", at_most("includes"))
    _draw(draft, text, other, (*including, path))


def _start(draft: _Draft, statement: Statement) -> None:
    if draft.start is not None:
        raise statement.error("a second 'start'", "one start a file")
    x, y, heading = statement.numbers(3, "X Y HEADING")
    statement.options()
    draft.start = (x, y, math.radians(heading))


def _goto(draft: _Draft, statement: Statement) -> None:
    x, y = statement.numbers(2, "X Y")
    draft.waypoints.append(Waypoint(x=x, y=y, pause=statement.options(pause=0.0)["pause"]))


def _laps(draft: _Draft, statement: Statement) -> None:
    (laps,) = statement.numbers(1, "N")
    statement.options()
    if laps < 1 or laps != round(laps):
        raise statement.error(f"'{laps:g}' laps", "a whole number, at least 1")
    draft.laps = round(laps)


def _lasts(draft: _Draft, statement: Statement) -> None:
    (duration,) = statement.numbers(1, "T")
    statement.options()
    if duration < 0:
        raise statement.error(f"'{duration:g}' seconds", "a time, not before the start")
    draft.duration = duration


def _laser(draft: _Draft, statement: Statement) -> None:
    if statement.words:
        name = statement.word("[NAME]")
        if name not in LASERS:
            raise statement.error(f"a laser '{name}'", f"one of {', '.join(LASERS)}")
        draft.laser = LASERS[name]()
    changed = _settings(statement, draft.laser, _LASER_OPTIONS)
    try:
        draft.laser = dataclasses.replace(draft.laser, **changed)
    except SimulatorError as error:
        raise SimulatorError(f"{statement.where}: {error}") from error


def _odometry(draft: _Draft, statement: Statement) -> None:
    statement.numbers(0, " ".join(f"[{name}=]" for name in _ODOMETRY_OPTIONS))
    changed = _settings(statement, draft.odometry, _ODOMETRY_OPTIONS)
    try:
        draft.odometry = dataclasses.replace(draft.odometry, **changed)
    except SimulatorError as error:
        raise SimulatorError(f"{statement.where}: {error}") from error


def _settings(statement: Statement, now: Laser | OdometryModel, names: tuple[str, ...]) -> dict[str, Any]:
    given = statement.options(**{name: float(getattr(now, name)) for name in names})
    return {name: math.radians(given[name]) if name in _ANGLES else given[name] for name in statement.named}


_ROUTE: dict[str, Callable[[_Draft, Statement], None]] = {
    "start": _start,
    "goto": _goto,
    "laps": _laps,
    "lasts": _lasts,
    "laser": _laser,
    "odometry": _odometry,
}


def _standing(statement: Statement) -> World:
    """One piece of the world, with its times and what it is made of."""
    shape, own = _SHAPES[statement.keyword]
    options = statement.options(**_FOR_EVER, glass=0.0, dark=0.0, **own)
    segments = shape(statement, options)
    for share in ("glass", "dark"):
        if not 0 <= options[share] <= 1:
            raise statement.error(f"{share}={options[share]:g}", "a share in [0, 1]")
    return World.empty().with_segments(
        segments,
        start=options["appears"],
        end=options["vanishes"],
        glass=options["glass"],
        dark=options["dark"],
    )


def _wall(statement: Statement, options: dict[str, float]) -> Segments:
    points, thick = statement.points(), options["thick"]
    return shapes.thick_wall(points, thick) if thick > 0 else shapes.polyline(points)


def _box(statement: Statement, options: dict[str, float]) -> Segments:
    x, y, width, depth = statement.numbers(4, "X Y WIDTH DEPTH")
    return shapes.rectangle(x, y, width, depth, math.radians(options["turn"]))


def _table(statement: Statement, options: dict[str, float]) -> Segments:
    x, y, width, depth = statement.numbers(4, "X Y WIDTH DEPTH")
    return shapes.table(x, y, width, depth, math.radians(options["turn"]), options["leg"])


def _arc(statement: Statement, options: dict[str, float]) -> Segments:
    x, y, radius = statement.numbers(3, "X Y RADIUS")
    pieces = options["pieces"]
    if not 1 <= pieces <= LIMITS.walls or pieces != round(pieces):
        raise statement.error(f"pieces={pieces:g}", f"a whole number of pieces, at least 1, {at_most('walls')}")
    return shapes.arc(x, y, radius, math.radians(options["from"]), math.radians(options["to"]), round(pieces))


_SHAPES: dict[str, tuple[Callable[[Statement, dict[str, float]], Segments], dict[str, float]]] = {
    "wall": (_wall, {"thick": 0.0}),
    "box": (_box, {"turn": 0.0}),
    "table": (_table, {"turn": 0.0, "leg": 0.06}),
    "arc": (_arc, {"from": 0.0, "to": 360.0, "pieces": 16.0}),
}


def _plan(statement: Statement, path: Path) -> World:
    file = path.parent / statement.word("FILE")
    options = statement.options(metres=1.0 if file.suffix.lower() == ".svg" else 0.05, x=0.0, y=0.0)
    try:
        segments = read_plan(file, metres=options["metres"])
    except SimulatorError as error:
        raise SimulatorError(f"{statement.where}: {error}") from error
    return World.empty().with_segments(segments + (options["x"], options["y"]) * 2)


def _person(statement: Statement) -> Person:
    path, options = statement.points(), statement.options(speed=1.2, **_FOR_EVER)
    try:
        return Person(path=path, **options)
    except SimulatorError as error:
        raise SimulatorError(f"{statement.where}: {error}") from error

"""A scene: a world and the route through it, read from and written to the `.world` text format.

One statement a line, `#` starts a comment, lengths in metres, angles in degrees, times in seconds::

    wall  X0 Y0 X1 Y1 ...  [thick=T]                 a polyline; with a thickness it has two faces
    box   X Y WIDTH DEPTH  [turn=A]                  cupboard, crate, pillar
    table X Y WIDTH DEPTH  [turn=A] [leg=L]          four legs
    arc   X Y RADIUS       [from=A] [to=A] [pieces=N]
    start X Y HEADING                                where the robot starts, once
    goto  X Y              [pause=T]                 a waypoint

Whatever stands can stand for a time only: `appears=T`, `vanishes=T`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from frontends.simulator import world as shapes
from frontends.simulator.files import write_atomically
from frontends.simulator.robot import Route, Waypoint
from frontends.simulator.world import Segments, SimulatorError, World


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A world and the route through it."""

    name: str
    world: World
    route: Route


SCENES = ("corridor", "office", "room", "vanishing_wall")
"""The scenes that come with the package."""


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
    with resources.as_file(resources.files("frontends.simulator") / "scenes" / f"{name}.world") as path:
        return read_scene(path)


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
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SimulatorError(f"{path}: cannot be read as a .world text file: {error}") from error
    return parse_scene(text, path)


def parse_scene(text: str, path: Path) -> Scene:
    """The scene that a `.world` text describes; `path` names it and its lines in errors."""
    world = World.empty()
    start: tuple[float, float, float] | None = None
    waypoints: list[Waypoint] = []
    for statement in _statements(text, path):
        if statement.keyword == "start":
            if start is not None:
                raise statement.error("a second 'start'", "one start a file")
            x, y, heading = statement.numbers(3, "X Y HEADING")
            statement.options()
            start = (x, y, math.radians(heading))
        elif statement.keyword == "goto":
            x, y = statement.numbers(2, "X Y")
            waypoints.append(Waypoint(x=x, y=y, pause=statement.options(pause=0.0)["pause"]))
        elif statement.keyword in _SHAPES:
            segments, appears, vanishes = _SHAPES[statement.keyword](statement)
            world = world.with_segments(segments, start=appears, end=vanishes)
        else:
            raise statement.error(f"'{statement.keyword}'", f"one of start, goto, {', '.join(_SHAPES)}")
    if start is None or not waypoints:
        raise SimulatorError(f"{path}: found no 'start' or no 'goto', expected a route for the robot")
    return Scene(name=path.stem, world=world, route=Route(start=start, waypoints=tuple(waypoints)))


def write_scene(path: Path, scene: Scene) -> None:
    """Write a scene as a `.world` file, its furniture taken apart into walls.

    Args:
        path: the file; replaced whole if it exists.
        scene: what to write; reading it back gives the same segments, times and route.
    """
    x, y, heading = scene.route.start
    lines = [f"start {x!r} {y!r} {_exact_degrees(heading)!r}"]
    lines += [f"goto {w.x!r} {w.y!r}" + (f" pause={w.pause!r}" if w.pause else "") for w in scene.route.waypoints]
    world = scene.world
    rows = zip(world.segments.tolist(), world.visible_from.tolist(), world.visible_to.tolist(), strict=True)
    for segment, appears, vanishes in rows:
        times = ("" if appears == -math.inf else f" appears={appears!r}") + (
            "" if vanishes == math.inf else f" vanishes={vanishes!r}"
        )
        lines.append("wall " + " ".join(repr(value) for value in segment) + times)
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def _exact_degrees(radians: float) -> float:
    """Degrees that `math.radians` turns back into exactly the same number."""
    degrees = math.degrees(radians)
    for candidate in (degrees, math.nextafter(degrees, math.inf), math.nextafter(degrees, -math.inf)):
        if math.radians(candidate) == radians:
            return candidate
    return degrees


@dataclass(frozen=True, kw_only=True)
class _Statement:
    """One line, taken apart."""

    where: str
    keyword: str
    words: tuple[str, ...]
    named: dict[str, str]

    def error(self, found: str, expected: str) -> SimulatorError:
        return SimulatorError(f"{self.where}: found {found}, expected {expected}")

    def numbers(self, count: int | None, usage: str) -> list[float]:
        if count is not None and len(self.words) != count:
            raise self.error(f"{len(self.words)} numbers after '{self.keyword}'", f"{self.keyword} {usage}")
        return [self._number(word) for word in self.words]

    def options(self, **defaults: float) -> dict[str, float]:
        unknown = next((key for key in self.named if key not in defaults), None)
        if unknown is not None:
            known = ", ".join(f"{key}=" for key in defaults) or "no options"
            raise self.error(f"'{unknown}='", f"{known} after '{self.keyword}'")
        return defaults | {key: self._number(word) for key, word in self.named.items()}

    def standing(self, **defaults: float) -> dict[str, float]:
        return self.options(appears=-math.inf, vanishes=math.inf, **defaults)

    def _number(self, word: str) -> float:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(f"'{word}'", "a number")
        return value


def _statements(text: str, path: Path) -> Iterator[_Statement]:
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", maxsplit=1)[0].split()
        if not words:
            continue
        pairs = [word.split("=", maxsplit=1) for word in words[1:] if "=" in word]
        yield _Statement(
            where=f"{path}:{number}",
            keyword=words[0],
            words=tuple(word for word in words[1:] if "=" not in word),
            named=dict(pairs),
        )


_Standing = tuple[Segments, float, float]


def _wall(statement: _Statement) -> _Standing:
    numbers = statement.numbers(None, "")
    options = statement.standing(thick=0.0)
    if len(numbers) < 4 or len(numbers) % 2:
        raise statement.error(f"{len(numbers)} numbers after 'wall'", "X0 Y0 X1 Y1 and so on, two a point")
    points = [(numbers[i], numbers[i + 1]) for i in range(0, len(numbers), 2)]
    thick = options["thick"]
    segments = shapes.thick_wall(points, thick) if thick > 0 else shapes.polyline(points)
    return segments, options["appears"], options["vanishes"]


def _box(statement: _Statement) -> _Standing:
    x, y, width, depth = statement.numbers(4, "X Y WIDTH DEPTH")
    o = statement.standing(turn=0.0)
    return shapes.rectangle(x, y, width, depth, math.radians(o["turn"])), o["appears"], o["vanishes"]


def _table(statement: _Statement) -> _Standing:
    x, y, width, depth = statement.numbers(4, "X Y WIDTH DEPTH")
    o = statement.standing(turn=0.0, leg=0.06)
    return shapes.table(x, y, width, depth, math.radians(o["turn"]), o["leg"]), o["appears"], o["vanishes"]


def _arc(statement: _Statement) -> _Standing:
    x, y, radius = statement.numbers(3, "X Y RADIUS")
    o = statement.standing(**{"from": 0.0, "to": 360.0, "pieces": 16.0})
    if o["pieces"] < 1 or o["pieces"] != round(o["pieces"]):
        raise statement.error(f"pieces={o['pieces']:g}", "a whole number of pieces, at least 1")
    start, end = math.radians(o["from"]), math.radians(o["to"])
    return shapes.arc(x, y, radius, start, end, round(o["pieces"])), o["appears"], o["vanishes"]


_SHAPES: dict[str, Callable[[_Statement], _Standing]] = {"wall": _wall, "box": _box, "table": _table, "arc": _arc}

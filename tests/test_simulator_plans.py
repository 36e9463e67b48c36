"""Floor plans: drawings and images become walls."""

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.image import imsave
from numpy.typing import NDArray

from frontends.simulator.floor_plan import outlines, read_plan
from frontends.simulator.scene import parse_scene
from frontends.simulator.world import SimulatorError, World
from graph.limits import LIMITS

Walls = NDArray[np.float64]


def drawing(folder: Path, body: str, head: str = 'viewBox="0 0 10 8"') -> Path:
    path = folder / "plan.svg"
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    path.write_text(f"<svg {spaces} {head}>{body}</svg>")
    return path


def walls(folder: Path, body: str, metres: float = 1.0) -> Walls:
    return read_plan(drawing(folder, body), metres=metres)


def as_set(segments: Walls) -> set[tuple[tuple[float, ...], ...]]:
    ends = segments.reshape(-1, 2, 2).round(6) + 0.0
    return {tuple(sorted(tuple(end) for end in pair)) for pair in ends.tolist()}


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<line x1="1" y1="2" x2="4" y2="2"/>', [(1, 6, 4, 6)]),
        ('<polyline points="0,0 3,0 3,2"/>', [(0, 8, 3, 8), (3, 8, 3, 6)]),
        ('<polygon points="0,0 3,0 3,2"/>', [(0, 8, 3, 8), (3, 8, 3, 6), (3, 6, 0, 8)]),
        ('<rect x="1" y="1" width="2" height="3"/>', [(1, 7, 3, 7), (3, 7, 3, 4), (3, 4, 1, 4), (1, 4, 1, 7)]),
        ('<path d="M1 1 L4 1 l0 2"/>', [(1, 7, 4, 7), (4, 7, 4, 5)]),
        ('<path d="m1,1 3,0 0,2z"/>', [(1, 7, 4, 7), (4, 7, 4, 5), (4, 5, 1, 7)]),
        ('<path d="M1 1H4V3h-1v1"/>', [(1, 7, 4, 7), (4, 7, 4, 5), (4, 5, 3, 5), (3, 5, 3, 4)]),
        ('<path d="M0 0L1 0M2 0L3 0"/>', [(0, 8, 1, 8), (2, 8, 3, 8)]),
        ('<path d="M0-1L1-1.5e0"/>', [(0, 9, 1, 9.5)]),
        ('<g transform="translate(1,2)"><line x1="0" y1="0" x2="1" y2="0"/></g>', [(1, 6, 2, 6)]),
        ('<line transform="rotate(90)" x1="1" y1="0" x2="2" y2="0"/>', [(0, 7, 0, 6)]),
        ('<line transform="rotate(90 1 0)" x1="1" y1="0" x2="2" y2="0"/>', [(1, 8, 1, 7)]),
        ('<g transform="scale(2)"><line transform="translate(1 1)" x2="1"/></g>', [(2, 6, 4, 6)]),
        ('<line transform="matrix(0 1 -1 0 3 0)" x1="1" y1="0" x2="2" y2="0"/>', [(3, 7, 3, 6)]),
        ('<line x1="25.4mm" y1="1in" x2="5.08cm" y2="72pt"/>', [(96, -88, 192, -88)]),
        ('<line x1="50%" y1="25%" x2="100%" y2="6pc"/>', [(5, 6, 10, -88)]),
        (
            '<g transform="translate(1 1)"><use href="#a" x="2" y="1"/></g><defs><line id="a" x2="1"/></defs>',
            [(3, 6, 4, 6)],
        ),
        ('<line id="b" x2="1"/><use xlink:href="#b" transform="rotate(90)"/>', [(0, 8, 1, 8), (0, 8, 0, 7)]),
        (
            '<g id="c"><line id="d" x2="1"/></g><use href="#c" y="1"/><use href="#d" y="2"/>',
            [(0, 8 - k, 1, 8 - k) for k in range(3)],
        ),
        (
            '<symbol id="e" viewBox="0 0 2 2"><line x2="2"/></symbol><use href="#e" x="1" width="4" height="4"/>',
            [(1, 8, 5, 8)],
        ),
        (
            '<svg x="1" y="2" width="6" height="4" viewBox="1 1 2 2"><line x1="1" y1="1" x2="3" y2="1"/></svg>',
            [(2, 6, 6, 6)],
        ),
        ('<svg width="6" height="4"><line x2="50%"/></svg>', [(0, 8, 3, 8)]),
        (
            '<marker><line x2="1"/></marker><mask><line x2="1"/></mask><symbol><line x2="1"/></symbol><line y2="2"/>',
            [(0, 8, 0, 6)],
        ),
        ('<defs><line x2="1"/></defs><line x2="1" style="display:none"/><line y2="2"/>', [(0, 8, 0, 6)]),
    ],
)
def test_every_kind_of_line(tmp_path: Path, body: str, expected: list[tuple[float, ...]]) -> None:
    assert as_set(walls(tmp_path, body)) == as_set(np.array(expected, dtype=np.float64))


def test_circles_ellipses_and_arcs_lie_on_their_curves(tmp_path: Path) -> None:
    circle = walls(tmp_path, '<circle cx="5" cy="4" r="2"/>')[:, :2]
    np.testing.assert_allclose(np.hypot(*(circle - (5, 4)).T), 2.0)
    ellipse = walls(tmp_path, '<ellipse cx="5" cy="4" rx="3" ry="1"/>')[:, :2] - (5, 4)
    np.testing.assert_allclose((ellipse[:, 0] / 3) ** 2 + ellipse[:, 1] ** 2, 1.0)


@pytest.mark.parametrize(("large", "sweep", "centre"), [(0, 0, (5, 4)), (0, 1, (7, 6)), (1, 0, (7, 6)), (1, 1, (5, 4))])
def test_arcs_go_round_the_right_centre_by_the_right_way(
    tmp_path: Path, large: int, sweep: int, centre: tuple[float, float]
) -> None:
    for flags in (f"{large} {sweep} ", f"{large}{sweep}"):
        arc = walls(tmp_path, f'<path d="M7 4 A2 2 0 {flags}5 2"/>')
        np.testing.assert_allclose(np.hypot(*(arc[:, :2] - centre).T), 2.0, atol=1e-9)
        length = np.hypot(*(arc[:, 2:] - arc[:, :2]).T).sum()
        assert length == pytest.approx(2.0 * math.pi * (1.5 if large else 0.5), rel=0.02)
        np.testing.assert_allclose([arc[0, :2], arc[-1, 2:]], [(7, 4), (5, 6)], atol=1e-9)


def test_an_arc_too_small_for_its_ends_grows_and_one_without_radius_is_straight(tmp_path: Path) -> None:
    grown = walls(tmp_path, '<path d="M1 4 A1 1 0 0 1 5 4"/>')
    np.testing.assert_allclose(np.hypot(*(grown[:, :2] - (3, 4)).T), 2.0)
    assert as_set(walls(tmp_path, '<path d="M1 4 A0 1 0 0 1 5 4"/>')) == as_set(np.array([(1.0, 4, 5, 4)]))


def test_bezier_curves_and_their_smooth_continuation(tmp_path: Path) -> None:
    cubic = walls(tmp_path, '<path d="M0 8 C0 4 4 4 4 8"/>')
    assert cubic[:, 3].max() == pytest.approx(3.0)
    np.testing.assert_allclose(cubic[6, :2], [2.0, 3.0])
    smooth = walls(tmp_path, '<path d="M0 8 C0 4 4 4 4 8 S8 12 8 8"/>')
    np.testing.assert_allclose(smooth[12:, :2] - (4, 0), cubic[:, :2] * (1, -1), atol=1e-9)
    quadratic = walls(tmp_path, '<path d="M0 8 Q2 4 4 8 T8 8"/>')
    np.testing.assert_allclose(quadratic[6, :2], [2.0, 2.0])
    np.testing.assert_allclose(quadratic[18, :2], [6.0, -2.0])


def test_metres_and_the_corner_of_the_view(tmp_path: Path) -> None:
    path = drawing(tmp_path, '<line x1="100" y1="300" x2="300" y2="300"/>', 'viewBox="100 100 400 200"')
    assert as_set(read_plan(path, metres=0.01)) == as_set(np.array([(0.0, 0, 2, 0)]))
    path = drawing(tmp_path, '<line x1="0" y1="0" x2="3" y2="0"/>', 'width="10px" height="8px"')
    assert as_set(read_plan(path, metres=1.0)) == as_set(np.array([(0.0, 8, 3, 8)]))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('<path d="M1 1 L4"/>', "1 numbers after 'L'"),
        ('<path d="M1 1 X4 5"/>', "'X'"),
        ('<polyline points="1 2 3"/>', "3 numbers"),
        ('<line transform="spin(3)" x2="1"/>', "spin"),
        ('<line x2="wide"/>', "x2='wide'"),
        ('<line x2="3em"/>', "x2='3em'"),
        ('<line transform="scale()" x2="1"/>', r"scale\(\)"),
        ('<use href="other.svg#a"/>', "a <use> of 'other.svg#a', expected '#' and the id"),
        ('<use href="#a"/>', "a <use> of '#a', expected '#' and the id"),
        ('<g id="a"><use href="#a"/></g>', "a <use> of '#a' inside what it uses"),
        ('<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>', "inside what it uses"),
        ('<svg viewBox="0 0 0 1"><line x2="1"/></svg>', "viewBox='0 0 0 1'"),
        ("<text>no wall</text>", "no wall"),
        ("<line", "SVG drawing"),
    ],
)
def test_a_drawing_that_cannot_be_understood_is_named(tmp_path: Path, body: str, said: str) -> None:
    with pytest.raises(SimulatorError, match=said) as caught:
        walls(tmp_path, body)
    assert "plan.svg" in str(caught.value)


def test_a_rectangle_with_round_corners(tmp_path: Path) -> None:
    rounded = walls(tmp_path, '<rect x="1" y="1" width="6" height="4" rx="1"/>')
    assert {(2.0, 7.0), (6.0, 7.0), (7.0, 6.0), (7.0, 4.0)} <= {end for pair in as_set(rounded) for end in pair}
    length = np.hypot(*(rounded[:, 2:] - rounded[:, :2]).T).sum()
    assert length == pytest.approx(4.0 + 4.0 + 2.0 + 2.0 + 2.0 * math.pi, rel=0.002)


def test_uses_of_uses_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frontends.simulator.svg.LIMITS", replace(LIMITS, walls=5000))
    levels = "".join(f'<g id="u{k + 1}">{f"""<use href="#u{k}"/>""" * 10}</g>' for k in range(9))
    with pytest.raises(SimulatorError, match=r"plan\.svg: found \d+ elements or more, those of <use> counted"):
        walls(tmp_path, f'<defs><g id="u0"/>{levels}</defs><use href="#u9"/>')


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (f'<line x1="{"1" * 200_000}z"/>', "found x1='1111"),
        (f'<line x1="{"1" * 200_000}.{"1" * 200_000}z"/>', "found x1='1111"),
        (f'<line transform="translate({"1 " * 200_000}" x2="1"/>', "found the transform translate"),
        (f'<line transform="translate{" " * 200_000}" x2="1"/>', "found the transform translate"),
        (
            "".join(f'<g id="u{k}"><use href="#u{k + 1}"/></g>' for k in range(10_000)) + '<g id="u10000"/>',
            r"found a <use> of '#u\d+' inside 500 others, expected fewer",
        ),
    ],
)
def test_a_drawing_made_to_keep_the_program_busy_is_refused_at_once(tmp_path: Path, body: str, said: str) -> None:
    began = time.process_time()
    with pytest.raises(SimulatorError, match=said):
        walls(tmp_path, body)
    assert time.process_time() - began < 5.0


def test_uses_inside_each_other_are_drawn(tmp_path: Path) -> None:
    chain = "".join(f'<g id="u{k}"><use href="#u{k + 1}" x="1"/></g>' for k in range(400))
    drawn = walls(tmp_path, f'<defs>{chain}<line id="u400" x2="1"/></defs><use href="#u0"/>')
    assert as_set(drawn) == as_set(np.array([(400.0, 8, 401, 8)]))


def test_files_that_are_no_plans(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("no image")
    (tmp_path / "short.pgm").write_bytes(b"P5 4 4 255\n1234")
    (tmp_path / "other.svg").write_text("<html/>")
    (tmp_path / "white.pgm").write_text("P2 2 1 255 255 255")
    for name in ("text.png", "short.pgm", "other.svg", "white.pgm", "missing.svg", "missing.png"):
        with pytest.raises(SimulatorError, match=name):
            read_plan(tmp_path / name, metres=1.0)
    with pytest.raises(SimulatorError, match="scale of 0"):
        read_plan(tmp_path / "white.pgm", metres=0.0)


CELLS = np.array([[0, 0, 0, 0], [0, 1, 1, 0], [0, 1, 0, 0]], dtype=bool)
AROUND = [(1, 2, 3, 2), (1, 0, 2, 0), (2, 1, 3, 1), (1, 0, 1, 2), (2, 0, 2, 1), (3, 1, 3, 2)]


def test_black_cells_are_outlined_with_joined_edges() -> None:
    assert as_set(outlines(CELLS, 1.0)) == as_set(np.array(AROUND, dtype=np.float64))
    np.testing.assert_allclose(outlines(CELLS, 0.05), outlines(CELLS, 1.0) * 0.05)


@pytest.mark.parametrize("kind", ["P2", "P5", "P5 16 bit", "grey.png", "colour.png", "transparent.png"])
def test_images_of_every_kind_give_the_same_walls(tmp_path: Path, kind: str) -> None:
    grey = np.where(CELLS, 20, 230).astype(np.uint8)
    path = tmp_path / ("plan.pgm" if kind.startswith("P") else kind)
    if kind == "P2":
        path.write_text("P2\n# a comment\n4 3\n255\n" + " ".join(map(str, grey.ravel())))
    elif kind == "P5":
        path.write_bytes(b"P5\n# a comment\n4 3 255\n" + grey.tobytes())
    elif kind == "P5 16 bit":
        path.write_bytes(b"P5 4 3 65535\n" + (grey.astype(">u2") * 257).tobytes())
    elif kind == "grey.png":
        imsave(path, grey, cmap="gray", vmin=0, vmax=255)
    elif kind == "colour.png":
        imsave(path, np.repeat(grey[..., None], 3, axis=2))
    else:
        imsave(path, np.dstack([grey * 0, grey * 0, grey * 0, np.where(CELLS, 255, 0).astype(np.uint8)]))
    np.testing.assert_array_equal(read_plan(path, metres=0.5), outlines(CELLS, 0.5))


@given(cells=arrays(np.bool_, st.tuples(st.integers(1, 8), st.integers(1, 8))))
def test_outlines_against_a_slow_twin(cells: NDArray[np.bool_]) -> None:
    edges = set()
    rows, columns = cells.shape
    for i in range(-1, rows + 1):
        for j in range(-1, columns + 1):
            for di, dj in ((1, 0), (0, 1)):
                here, there = (
                    0 <= r < rows and 0 <= c < columns and bool(cells[r, c]) for r, c in ((i, j), (i + di, j + dj))
                )
                if here != there:
                    start = (j + dj, rows - i - di)
                    edges.add((start, (start[0] + di, start[1] - dj) if di else (start[0], start[1] - 1)))
    taken = set()
    for x0, y0, x1, y1 in outlines(cells, 1.0).tolist():
        length = round(abs(x1 - x0) + abs(y1 - y0))
        for k in range(length):
            a = (x0 + (x1 - x0) * k / length, y0 + (y1 - y0) * k / length)
            b = (x0 + (x1 - x0) * (k + 1) / length, y0 + (y1 - y0) * (k + 1) / length)
            assert (a, b) not in taken
            taken.add((a, b))
    assert taken == edges


def test_a_scene_takes_its_walls_from_a_plan_beside_it(tmp_path: Path) -> None:
    drawing(tmp_path, '<rect x="0" y="0" width="10" height="8"/>')
    text = "plan plan.svg metres=0.5 x=-1 y=-2\nstart 0 0 0\ngoto 1 0\n"
    world = parse_scene(text, tmp_path / "house.world").world
    assert as_set(world.segments) == as_set(
        np.array([(-1.0, -2, 4, -2), (4, -2, 4, 2), (4, 2, -1, 2), (-1, 2, -1, -2)])
    )
    assert isinstance(world, World)
    with pytest.raises(SimulatorError, match=r"house\.world:1: .*nothing\.svg"):
        parse_scene(text.replace("plan.svg", "nothing.svg"), tmp_path / "house.world")

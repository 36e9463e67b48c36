"""Pictures: that they are made, headless, and show what they should."""

import io
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Scan, ScanGeometry
from iceg import plot
from iceg.demo import demo_log_path
from iceg.ice.features import Features
from iceg.maps.feature_map import Landmarks
from iceg.maps.grid import OccupancyGrid
from iceg.show import map_picture
from iceg.show.canvas import Canvas
from iceg.show.map_image import MapLayers, known_box, map_image, scaled
from iceg.show.map_picture import save_map_png

F64 = NDArray[np.float64]


@pytest.fixture
def ax() -> Axes:
    figure = Figure()
    FigureCanvasAgg(figure)
    return figure.add_subplot()


def painted(ax: Axes) -> NDArray[np.uint8]:
    """The figure as (height, width, 3) colours."""
    content = io.BytesIO()
    assert isinstance(ax.figure, Figure)
    ax.figure.savefig(content, format="png", dpi="figure")
    content.seek(0)
    return np.asarray(imread(content)[:, :, :3] * 255).round().astype(np.uint8)


def room_grid() -> OccupancyGrid:
    """A room of 8 m x 5 m, free inside, walls around, nothing known outside."""
    log_odds = np.zeros((140, 220), np.float32)
    log_odds[20:120, 30:190] = -3.0
    log_odds[[20, 119], 30:190] = 3.0
    log_odds[20:120, [30, 189]] = 3.0
    return OccupancyGrid(log_odds=log_odds, origin=np.array([-1.5, -1.0]), resolution=0.05)


def path() -> F64:
    t = np.linspace(0, 2 * np.pi, 300)
    return np.stack([4 + 2.5 * np.cos(t), 2.5 + 1.5 * np.sin(t), t], axis=1)


def landmarks(n: int = 6) -> Landmarks:
    whole = np.arange(n, dtype=np.int64)
    kinds = (whole % 3).astype(np.int8)
    directions = np.stack([np.zeros(n), np.where(kinds == 1, np.nan, 1.5)], axis=1)
    return Landmarks(
        ids=whole,
        kinds=kinds,
        positions=np.stack([1.0 + whole, np.full(n, 1.0)], axis=1),
        directions=directions,
        covariances=np.tile(1e-4 * np.eye(2), (n, 1, 1)),
        direction_variances=np.full((n, 2), 1e-3),
        distances=np.ones(n),
        anchors=whole,
        first_seen=whole,
        last_seen=whole,
        seen=whole,
        missed=whole * 0,
        expired_at=whole * 0 - 1,
    )


def features() -> Features:
    return Features(
        kinds=np.array([0, 1, 2], np.int8),
        positions=np.array([[2.0, 1.0], [3.0, 0.0], [2.0, -1.0]]),
        directions=np.array([[0.0, 1.5], [math.nan, 1.0], [0.0, 1.0]]),
        covariances=np.tile(1e-4 * np.eye(2), (3, 1, 1)),
        direction_variances=np.full(3, 1e-3),
        distances=np.full(3, 2.0),
        real=np.array([True, False, True]),
    )


def room(closures: NDArray[np.int64] | None = None) -> MapLayers:
    return MapLayers(
        grid=room_grid(), trajectory=path(), key_poses=path()[::20], landmarks=landmarks(), closures=closures
    )


def test_the_picture_of_a_map(tmp_path: Path) -> None:
    file = tmp_path / "map.png"
    save_map_png(file, room(closures=np.array([[0, 150]])), title="room")
    image = imread(file)[:, :, :3]
    assert 1500 < max(image.shape) < 3000
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.png"]
    colours = {tuple(colour) for colour in (image[::3, ::3].reshape(-1, 3) * 255).round().astype(int)}
    assert {(255, 255, 255), (20, 20, 20), (232, 232, 232)} <= colours  # free, occupied, unknown
    assert len(colours) > 100  # the trajectory's


def test_a_picture_of_the_grid_alone_and_one_pose(tmp_path: Path) -> None:
    save_map_png(tmp_path / "grid.png", MapLayers(grid=room_grid()))
    one = path()[:1]
    layers = MapLayers(grid=room_grid(), trajectory=one, key_poses=one, landmarks=landmarks(0))
    save_map_png(tmp_path / "pose.png", layers)
    nothing = OccupancyGrid(log_odds=np.zeros((4, 4), np.float32), origin=np.zeros(2), resolution=0.05)
    save_map_png(tmp_path / "nothing.png", MapLayers(grid=nothing))
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("grid.png", "pose.png", "nothing.png"))


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        save_map_png(tmp_path / name, room())
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_picture_is_cropped_to_what_is_known() -> None:
    grid = room_grid()
    assert known_box(grid, margin=0.0) == pytest.approx((0.0, 8.0, 0.0, 5.0))
    far = path()
    far[0, 0] = 20.0
    assert known_box(grid, far, margin=0.5) == pytest.approx((-0.5, 20.5, -0.5, 5.5))
    grid.log_odds[130, 215] = 3.0  # one return through a window
    assert known_box(grid, margin=0.0) == pytest.approx((0.0, 8.0, 0.0, 5.0), abs=0.05)


def test_walls_are_drawn_where_they_are(ax: Axes) -> None:
    plot.map(MapLayers(grid=room_grid()), ax)
    image = painted(ax)
    height = image.shape[0]
    for x, y, grey in ((0.02, 2.5, 20), (4.0, 4.97, 20), (4.0, 2.5, 255), (-0.4, 2.5, 232)):
        column, row = ax.transData.transform((x, y))
        assert abs(int(image[height - 1 - int(row), int(column), 0]) - grey) <= 2


def test_rarely_seen_landmarks_are_left_out(ax: Axes) -> None:
    plot.map(MapLayers(grid=room_grid(), landmarks=landmarks()), ax, min_seen=3)
    image = painted(ax).astype(int)
    height = image.shape[0]
    coloured = []
    for x, y in landmarks().positions:
        column, row = (int(value) for value in ax.transData.transform((x, y)))
        patch = image[height - 3 - row : height + 2 - row, column - 2 : column + 3]
        coloured.append(bool((patch.min(axis=2) < 250).any()))
    assert coloured == [False, False, False, True, True, True]  # seen 0 to 5 times


def test_what_lies_on_the_map_is_painted_where_it_is() -> None:
    grid, box = room_grid(), (0.0, 8.0, 0.0, 5.0)
    straight = np.stack([np.linspace(1.0, 7.0, 50), np.ones(50), np.zeros(50)], axis=1)
    ends = np.array([[1.0, 4.0, 0.0], [7.0, 2.0, 0.0]])
    layers = MapLayers(grid=grid, trajectory=straight, key_poses=ends, landmarks=landmarks())
    image = map_image(layers, box=box, long_side=800).astype(int)
    assert image.shape == (500, 800, 3)

    def colour(x: float, y: float) -> list[int]:
        patch = image[round(500 - 100 * y) - 1 : round(500 - 100 * y) + 1, round(100 * x) - 1 : round(100 * x) + 1]
        return [round(value) for value in patch.mean(axis=(0, 1))]

    start, finish = colour(1.2, 1.0), colour(6.8, 1.0)
    assert start[0] > 200 > start[2]  # orange …
    assert finish[2] > 100 > finish[0]  # … to blue
    assert max(colour(1.0, 4.0)) < 120  # a key pose
    assert colour(4.0, 3.0) == [255, 255, 255]
    two = MapLayers(grid=grid, trajectory=ends, closures=np.array([[0, 1]]))
    joined = map_image(two, box=box, long_side=800)
    assert joined[200, 400].tolist() != [255, 255, 255]


def test_what_covers_part_of_a_pixel_is_mixed_with_its_grey() -> None:
    canvas = Canvas((10, 20), (0.0, 20.0, 0.0, 10.0), 1.0)
    canvas.squares(np.array([[5.0, 5.0]]), "#ff0000", 4.0)
    canvas.strokes(np.array([[[12.0, 0.0], [12.0, 10.0]]]), "#000000", 4.0, opacity=0.25)
    shades = np.full((10, 20), 200, dtype=np.uint8)
    shades[:, 12] = 100
    picture = canvas.over(shades)
    assert picture[5, 5].tolist() == [255, 0, 0]
    assert picture[5, 12].tolist() == [75, 75, 75]
    assert picture[0, 0].tolist() == [200, 200, 200]
    edge = picture[5, 7].tolist()  # the square ends inside this pixel, or at its border
    assert edge[1] == edge[2]
    assert edge[0] == pytest.approx(255 - 55 * edge[1] / 200, abs=1)
    assert 0 < edge[1] < 200


def test_a_picture_of_many_rows_has_no_seams() -> None:
    canvas = Canvas((1000, 20), (0.0, 20.0, 0.0, 1000.0), 1.0)
    canvas.strokes(np.array([[[7.3, -10.0], [7.3, 1010.0]]]), "#cc4411", 3.0, opacity=0.6)
    shades = np.broadcast_to(np.arange(100, 120, dtype=np.uint8), (1000, 20))
    picture = canvas.over(shades)
    assert (picture == picture[0]).all()
    assert (picture[0, 7] != 107).any()


def test_a_scan_with_its_features(ax: Axes) -> None:
    geometry = ScanGeometry(bearings=np.linspace(-1.5, 1.5, 91), range_min=0.05, range_max=20.0)
    plot.scan_features(Scan(ranges=np.full(91, 3.0, np.float32), geometry=geometry), features(), ax)
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["corner", "end of wall (weak)", "intersection"]
    assert len(np.unique(painted(ax).reshape(-1, 3), axis=0)) > 10


def test_an_ellipse_is_where_the_covariance_says(ax: Axes) -> None:
    angle, sigmas = 0.6, 3.0
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    covariance = np.eye(3)
    covariance[:2, :2] = rotation @ np.diag([0.25, 0.04]) @ rotation.T
    ellipse = plot.covariance_ellipse([1.0, 2.0, 0.3], covariance, ax, sigmas)
    # Any point of the outline lies `sigmas` away in the Mahalanobis sense.
    outline = ellipse.get_patch_transform().transform(np.array([[1.0, 0.0], [0.0, 1.0], [-0.6, 0.8]]))
    offset = outline - [1.0, 2.0]
    np.testing.assert_allclose(
        np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance[:2, :2]), offset), sigmas**2, rtol=1e-9
    )


def test_a_correlation_surface_with_its_covariance(ax: Axes) -> None:
    xs, ys = np.linspace(-0.3, 0.3, 31), np.linspace(-0.2, 0.2, 21)
    scores = np.exp(-(xs[None] ** 2) / 0.02 - ys[:, None] ** 2 / 0.005)
    plot.correlation_surface(xs, ys, scores, ax, best=(0.0, 0.0, 0.1), covariance=np.diag([0.01, 0.0025, 1.0]))
    assert ax.images[0].get_extent() == pytest.approx((-0.31, 0.31, -0.21, 0.21))
    assert len(ax.patches) == 1


def test_a_scan_on_its_reference_where_it_was_expected_and_matched(ax: Axes) -> None:
    scan = Scan.from_ranges(np.full(5, 2.0), field_of_view=math.pi)
    plot.alignment(np.zeros((3, 2)), scan, np.array([1.0, 0.0, math.pi / 2]), np.zeros(3), ax)
    reference, expected, nose, matched, _ = (np.asarray(line.get_xydata()) for line in ax.lines)
    assert len(reference) == 3
    np.testing.assert_allclose(expected[0], [3.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(nose[:, 1], [0.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(matched[0], [0.0, -2.0], atol=1e-6)


@pytest.mark.parametrize(("sheet", "beside"), [(2000, True), (1000, False), (250, False)])
def test_the_legend_goes_below_the_scale_bar_where_it_would_overlap_it(sheet: int, beside: bool) -> None:
    widths = [110.0, 230.0, 190.0, 120.0, 260.0]
    rows = map_picture._rows(widths, sheet, 280.0)
    assert (rows is None) == beside
    if rows is not None:
        assert [width for row in rows for width in widths[row]] == widths
        assert all(sum(widths[row]) <= sheet or len(widths[row]) == 1 for row in rows)


def test_a_long_name_is_cut_where_the_sheet_ends(tmp_path: Path) -> None:
    short, long = (replace(room(), name=name) for name in ("room.clf", 60 * "room " + ".clf"))
    for layers, name in ((short, "short.png"), (long, "long.png")):
        save_map_png(tmp_path / name, layers)
    first, second = (imread(tmp_path / name)[:, :, :3] for name in ("short.png", "long.png"))
    assert first.shape[1] == second.shape[1]
    assert (second[:, -20:] == 1.0).all(axis=2)[-60:].all()


def test_errors_beside_what_was_claimed(ax: Axes) -> None:
    time = np.linspace(0, 10, 50)
    plot.error_over_time(time, np.sin(time), ax, np.full(50, 0.5), label="heading error [rad]")
    low, high = ax.get_ylim()
    assert (low, high) == pytest.approx((-1.65, 1.65))
    plot.error_over_time(time, np.abs(np.sin(time)), ax)
    assert ax.get_xlabel() == "time [s]"


def test_drawing_needs_no_display_and_no_global_state() -> None:
    drawn = "iceg.plot.map, iceg.plot.success, iceg.plot.alignment"
    code = f"import sys, iceg; {drawn}; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_picture_of_a_run_does_not_load_a_plotting_library() -> None:
    code = "import sys, iceg.show.map_picture, iceg.show.run_plots; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(("cells", "pixels"), [((40, 20), (200, 100)), ((150, 90), (150, 90)), ((900, 7), (300, 3))])
def test_a_cell_is_a_whole_number_of_pixels_or_the_reverse(cells: tuple[int, int], pixels: tuple[int, int]) -> None:
    image = np.full(cells, 255, np.uint8)
    image[3, 2] = 20
    pixelwise = scaled(image, long_side=200)
    assert pixelwise.shape == pixels
    assert pixelwise.min() == 20


def test_a_long_narrow_map_leaves_room_for_its_legend(tmp_path: Path) -> None:
    corridor = OccupancyGrid(log_odds=np.full((800, 40), -3.0, np.float32), origin=np.zeros(2), resolution=0.05)
    save_map_png(tmp_path / "map.png", replace(room(), grid=corridor))
    height, width = imread(tmp_path / "map.png").shape[:2]
    assert width >= 1000
    assert height > width


def test_arguments_of_another_type_are_told(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="layers: found str, expected"):
        save_map_png(tmp_path / "map.png", "result")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="range_max: found str, expected a number"):
        read_log(demo_log_path(), range_max="10")

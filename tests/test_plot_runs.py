"""Pictures of whole runs on axes and as files: the same of a result and of its folder, vectors, the command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import iceg
from graph.se2 import wrap_angle
from iceg import plot
from iceg.cli import main
from iceg.results import write_results
from iceg.run_folder import RunFolder, read_run_folder
from iceg.run_result.slam_result import SlamResult
from iceg.show.map_image import MapLayers
from iceg.show.run_plots import plot_results
from iceg.slam.closures.attempt import Verdict
from iceg.tum import Trajectory
from tests.test_compare import closure, run, written
from tests.test_plots import path, room_grid


@pytest.fixture(scope="module")
def result() -> SlamResult:
    log = iceg.read_log(iceg.demo_log_path())
    first = replace(log, ranges=log.ranges[:250], odometry=log.odometry[:250], stamps=log.stamps[:250])
    return iceg.run(first)


@pytest.fixture(scope="module")
def folder(result: SlamResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "out"
    write_results(result, folder)
    return folder


def axes() -> Axes:
    return Figure(figsize=(6, 5), layout="constrained").subplots()


def panel(figure: Figure, label: str) -> Axes:
    """The last axes of a figure whose vertical axis has a label."""
    return [ax for ax in figure.axes if ax.get_ylabel() == label][-1]


def legend_of(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_a_result_and_its_folder_are_drawn_alike(result: SlamResult, folder: Path) -> None:
    back = read_run_folder(folder)
    of_result, of_folder = axes(), axes()
    plot.map(result, of_result)
    plot.map(back, of_folder)
    assert legend_of(of_result) == legend_of(of_folder)
    assert legend_of(of_result)[0].startswith("path, 0:00 to 0:5")
    title = of_result.get_legend()
    assert title is not None
    assert title.get_title().get_text() == "office.clf.gz, cells of 5 cm"
    assert of_result.get_xlim() == pytest.approx(of_folder.get_xlim())
    for drawn in (result, back):
        plot.trajectory(drawn, axes())
        plot.uncertainty(drawn, axes(), of="heading")
        plot.closures(drawn, axes())
        plot.floor_plan(drawn, axes())


def test_the_walls_of_the_map_are_outlines_where_the_walls_are() -> None:
    ax = axes()
    plot.map(MapLayers(grid=room_grid()), ax, key=False)
    free, walls = (np.concatenate([one.vertices for one in part.get_paths()]) for part in ax.collections)
    assert free[:, 0].min() == pytest.approx(0.05, abs=0.03)
    assert free[:, 0].max() == pytest.approx(7.95, abs=0.03)
    assert walls[:, 1].min() == pytest.approx(0.0, abs=0.03)
    assert walls[:, 1].max() == pytest.approx(5.0, abs=0.03)


def test_files_of_vectors_hold_no_pixels_and_no_date(tmp_path: Path) -> None:
    folder = written(tmp_path / "out", run(closures=(closure(0, 250),)))
    drawings = plot_results(folder, ("map", "uncertainty"), "svg")
    first = [drawing.read_bytes() for drawing in drawings]
    assert [drawing.name for drawing in drawings] == ["map.svg", "uncertainty.svg"]
    assert not any(b"<image" in content for content in first)
    assert [drawing.read_bytes() for drawing in plot_results(folder, ("map", "uncertainty"), "svg")] == first
    (printed,) = plot_results(folder, ("map",), "pdf")
    content = printed.read_bytes()
    assert content.startswith(b"%PDF")
    assert b"CreationDate" not in content
    assert b"/Subtype /Image" not in content


def test_curves_share_an_axis_of_time_and_errors_need_a_truth() -> None:
    drawn = run(closures=(closure(0, 250),))
    heading = panel(plot.trajectory_figure(drawn), "heading [°]")
    sure = panel(plot.uncertainty_figure(drawn), "heading, 1 σ [°]")
    assert heading.get_xlabel() == sure.get_xlabel() == "time [s]"
    assert heading.get_xlim() == pytest.approx(sure.get_xlim())
    known = plot.trajectory_figure(drawn, truth=path() + np.array([5.0, 0.0, 0.0]))
    assert panel(known, "heading error [°]").get_xlabel() == "time [s]"
    errors = np.asarray(panel(known, "position error [m]").lines[0].get_ydata())
    assert errors.max() < 1e-9  # the truth may be in another frame


def test_the_heading_has_a_gap_where_it_passes_half_a_turn() -> None:
    poses = path()
    poses[:, 2] = wrap_angle(poses[:, 2])
    heading = np.asarray(panel(plot.trajectory_figure(run(poses)), "heading [°]").lines[0].get_ydata())
    assert np.isnan(heading).sum() == 1
    assert np.nanmax(np.abs(heading)) <= 180.0


def test_closures_are_marked_when_they_came_in() -> None:
    ax = axes()
    plot.uncertainty(run(closures=(closure(0, 250), closure(20, 260, Verdict.REJECTED), closure(10, 270))), ax)
    (marks,) = (found for found in ax.collections if isinstance(found, LineCollection))
    assert [segment[0][0] for segment in marks.get_segments()] == pytest.approx([25.0, 27.0])
    assert "loop closure (2)" in legend_of(ax)


def test_stamps_that_step_back_never_turn_the_axis_round() -> None:
    drawn = run()
    stamps = drawn.trajectory.stamps.copy()
    stamps[100] -= 5.0
    stepping = replace(drawn, trajectory=Trajectory(stamps=stamps, poses=path()))
    times = np.asarray(panel(plot.trajectory_figure(stepping), "x [m]").lines[0].get_xdata())
    assert (np.diff(times) >= 0.0).all()
    still = replace(drawn, trajectory=Trajectory(stamps=np.zeros(300), poses=path()))
    assert panel(plot.trajectory_figure(still), "heading [°]").get_xlabel() == "scan"


def test_the_command_draws_what_it_is_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", str(folder), "--what", "closures, map", "--format", "pdf"]) == 0
    assert capsys.readouterr().out.split() == [str(folder / "map.pdf"), str(folder / "closures.pdf")]
    assert main(["plot", str(folder), "--what", "maps"]) == 2
    assert "--what: found 'maps', expected any of map, trajectory" in capsys.readouterr().err
    assert main(["plot", str(folder), "--truth", str(iceg.demo_truth_path())]) == 1
    assert "expected one row per scan" in capsys.readouterr().err
    for name in ("map.pdf", "closures.pdf"):
        (folder / name).unlink()


def test_a_filter_has_no_uncertainty_to_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    particles: RunFolder = run()
    folder = written(tmp_path / "out", particles)
    (folder / "summary.json").write_text('{"method": "dp-slam", "log": "room.clf"}')
    assert [one.name for one in plot_results(folder)] == ["map.png", "trajectory.png"]
    assert main(["plot", str(folder), "--what", "uncertainty"]) == 1
    assert "holds nothing to draw 'uncertainty' from, expected map, trajectory" in capsys.readouterr().err

"""The page of a run in a real browser: what it shows, and what clicks, keys and fingers do."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

import iceg
from frontends.simulator.simulation import simulate
from graph.se2 import transform_points
from iceg.config import Config
from iceg.maps.config import GridConfig
from iceg.report import write_report
from iceg.run_result.slam_result import SlamResult
from iceg.slam.broken_path.displacement import Displacement, displaced_covariances
from tests.browser import HOW_TO_GET_ONE, find_browser
from tests.conftest import IN_CI

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


class Shown(NamedTuple):
    """A run and its page."""

    result: SlamResult
    path: Path


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    simulation = simulate("room", 0)
    result = iceg.run(simulation.log, Config(grid=GridConfig(resolution=0.1)))
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(result, path, simulation.truth)
    return Shown(result, path)


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    executable = find_browser()
    if executable is None:
        if IN_CI:
            pytest.fail(HOW_TO_GET_ONE)
        pytest.skip(HOW_TO_GET_ONE)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        yield launched
        launched.close()


def opened(browser: "Browser", path: Path, size: Any, theme: Any = "light") -> "Page":
    """The page once it is ready; what the console complains of, or what is asked of the network, is in `trouble`."""
    is_phone = size is PHONE
    context = browser.new_context(
        viewport=size, color_scheme=theme, has_touch=is_phone, is_mobile=is_phone, locale="en-US"
    )
    page = context.new_page()
    trouble: list[str] = []
    page.on("console", lambda message: trouble.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.on("request", lambda asked: trouble.append(asked.url) if asked.url.startswith("http") else None)
    page.goto(path.as_uri())
    page.wait_for_function("document.documentElement.dataset.ready === 'true'")
    page.trouble = trouble  # type: ignore[attr-defined]
    return page


@pytest.fixture
def page(browser: "Browser", shown: Shown) -> Iterator["Page"]:
    found = opened(browser, shown.path, DESKTOP)
    yield found
    assert found.trouble == []  # type: ignore[attr-defined]
    found.context.close()


def place(page: "Page", x: float, y: float) -> tuple[float, float]:
    """Where a place of the map is in the window."""
    at = page.evaluate(f"(() => {{ const p = iceg.map.latLngToContainerPoint([{y}, {x}]); return [p.x, p.y]; }})()")
    box = page.locator("#map").bounding_box()
    assert box is not None
    return box["x"] + at[0], box["y"] + at[1]


def inked(page: "Page", sheet: int) -> int:
    """How many pixels of a layer of the map are painted."""
    page.wait_for_timeout(60)  # it is painted with the next frame
    return int(
        page.evaluate(
            """sheet => {
              const canvas = document.querySelector(`.leaflet-sheet-${sheet}-pane canvas`);
              const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
              return data.reduce((n, value, i) => n + (i % 4 === 3 && value > 0), 0);
            }""",
            sheet,
        )
    )


GROUND, LANDMARKS, CLOSURES, PATH = 0, 1, 2, 3


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_it_opens_without_a_complaint_and_fits_the_screen(
    browser: "Browser", shown: Shown, size: Any, theme: str, tmp_path: Path
) -> None:
    page = opened(browser, shown.path, size, theme)
    assert page.locator("h1").inner_text() == shown.result.log.path.name
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert inked(page, PATH) > 500
    picture = page.screenshot(path=tmp_path / "page.png")
    assert len(picture) > 20_000
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, paper[4:-1].split(","))) < 150) == (theme == "dark")
    page.locator("#theme").click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != paper
    assert page.trouble == []  # type: ignore[attr-defined]
    page.context.close()


def test_layers_are_switched(page: "Page") -> None:
    page.locator("#layers summary").click()
    for name, sheet in {"path": PATH, "accepted": CLOSURES, "grid": GROUND}.items():
        before = inked(page, sheet)
        page.locator(f'input[name="{name}"]').uncheck()
        assert inked(page, sheet) < before
    page.locator('input[name="metres"]').uncheck()
    assert inked(page, GROUND) == 0
    page.locator('input[name="walls"]').check()
    whole = inked(page, GROUND)
    page.keyboard.press("Home")
    assert 0 < inked(page, GROUND) < whole
    page.keyboard.press("End")
    assert inked(page, LANDMARKS) == 0
    page.locator('input[name="corner"]').check()
    assert inked(page, LANDMARKS) > 0
    page.locator('input[value="sure"]').check()
    assert page.locator("#key").is_hidden()
    page.locator('input[name="path"]').check()
    assert "mm" in page.locator("#key").inner_text()


def test_a_click_on_a_pose_tells_what_holds_it(page: "Page", shown: Shown) -> None:
    page.locator("#layers summary").click()
    page.locator('input[name="accepted"]').uncheck()
    page.locator("#layers summary").click()
    key = len(shown.result.key_scans) // 3
    page.mouse.click(*place(page, *shown.result.key_poses[key, :2]))
    clicked = int(page.locator("#inspector h2").inner_text().removeprefix("Key pose "))
    apart = shown.result.key_poses[clicked, :2] - shown.result.key_poses[key, :2]
    assert float(np.hypot(*apart)) < 0.3
    holding = [factor for factor in shown.result.graph.factors if clicked in (factor.i, factor.j)]
    assert page.locator("#inspector tbody tr").count() == len(holding)
    page.locator("#inspector [data-do=pose]").first.click()
    assert page.locator("#inspector h2").inner_text() == f"Key pose {clicked - 1}"
    page.keyboard.press("Escape")
    assert page.locator("#inspector h2").inner_text() == "What you see"


def test_a_click_on_a_closure_lays_its_scans_on_each_other(page: "Page", shown: Shown) -> None:
    closures = shown.result.closures
    lengths = [
        float(np.hypot(*(shown.result.trajectory[c.scan_i, :2] - shown.result.trajectory[c.scan_j, :2])))
        if c.verdict == "accepted"
        else 0.0
        for c in closures
    ]
    longest = closures[int(np.argmax(lengths))]
    page.locator("#layers summary").click()
    page.locator('input[name="path"]').uncheck()
    page.locator("#layers summary").click()
    middle = shown.result.trajectory[[longest.scan_i, longest.scan_j], :2].mean(axis=0)
    page.evaluate(f"iceg.map.setView([{middle[1]}, {middle[0]}], 9, {{animate: false}})")
    page.mouse.click(*place(page, *middle))
    index = int(page.locator("#inspector h2").inner_text().removeprefix("Closure "))
    found = closures[index]
    text = page.locator("#inspector").inner_text()
    assert "accepted" in text
    assert "% of the beams fall on the earlier pass" in text
    assert f"scan {found.scan_i}" in text
    assert f"scan {found.scan_j}" in text
    assert "σ" in page.locator("#inspector dl").inner_text()
    assert str(found.inliers) in page.locator("#inspector dl").inner_text()
    pixels = page.evaluate(
        "[...document.querySelectorAll('#inspector canvas')].map(c => c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data.reduce((n, v) => n + (v > 0), 0))"
    )
    assert len(pixels) == 2
    assert min(pixels) > 500


def test_keys_and_buttons_replay_the_run(page: "Page", shown: Shown) -> None:
    whole, map_whole = inked(page, PATH), inked(page, GROUND)
    last = len(shown.result.log) - 1
    assert page.locator("#time").input_value() == str(last)
    page.keyboard.press("Home")
    assert page.locator("#time").input_value() == "0"
    assert inked(page, PATH) < 0.2 * whole
    assert inked(page, GROUND) < map_whole
    page.keyboard.press("ArrowRight")
    assert page.locator("#time").input_value() == str(shown.result.key_scans[1])
    page.keyboard.press("Shift+ArrowRight")
    assert page.locator("#time").input_value() == str(shown.result.key_scans[11])
    page.locator("#back").click()
    assert page.locator("#time").input_value() == str(shown.result.key_scans[10])
    page.locator("body").press(" ")
    page.wait_for_function(f"Number(document.getElementById('time').value) > {shown.result.key_scans[12]}")
    page.locator("body").press(" ")
    stopped = page.locator("#time").input_value()
    page.wait_for_timeout(150)
    assert page.locator("#time").input_value() == stopped
    page.keyboard.press("End")
    assert inked(page, PATH) == whole


def test_a_finger_moves_the_slider_and_opens_layers(browser: "Browser", shown: Shown) -> None:
    page = opened(browser, shown.path, PHONE)
    box = page.locator("#time").bounding_box()
    assert box is not None
    page.touchscreen.tap(box["x"] + 0.3 * box["width"], box["y"] + box["height"] / 2)
    share = int(page.locator("#time").input_value()) / len(shown.result.log)
    assert share == pytest.approx(0.3, abs=0.08)
    assert not page.locator('input[name="path"]').is_visible()
    page.locator("#layers summary").tap()
    page.locator('input[name="poses"]').tap()
    assert page.locator('input[name="poses"]').is_checked()
    assert page.trouble == []  # type: ignore[attr-defined]
    page.context.close()


def test_curves_and_map_share_a_cursor(page: "Page", shown: Shown) -> None:
    charts = page.locator("#curves .uplot")
    titles = page.locator("#curves h3").all_inner_texts()
    assert {"Error against the truth", "Residuals of the factors", "Time a stage"} <= set(titles)
    assert charts.count() == len(titles) - 1
    over = page.locator("#curves .u-over").first
    over.hover()
    key = page.evaluate("iceg.state.cursor")
    assert key == pytest.approx(len(shown.result.key_scans) / 2, rel=0.3)
    over.click()
    assert page.locator("#time").input_value() == str(shown.result.key_scans[key])
    page.locator("#map").scroll_into_view_if_needed()
    page.mouse.move(*place(page, *shown.result.key_poses[5, :2]))
    page.wait_for_function("iceg.state.cursor !== null")
    legend = page.locator("#curves .u-legend").first.inner_text()
    scan = shown.result.key_scans[page.evaluate("iceg.state.cursor")]
    assert f"{scan} ·" in legend


def test_a_measured_distance_is_that_of_the_library(page: "Page", shown: Shown) -> None:
    result = shown.result
    page.locator("#measure").click()
    ends = [
        tuple(map(float, transform_points(result.trajectory[scan], result.log.scan(int(scan)).points[40])))
        for scan in (result.key_scans[2], result.key_scans[-3])
    ]
    for end in ends:
        page.mouse.click(*place(page, *end))
    measured = page.evaluate("iceg.state.measured.map(seen => [seen.x, seen.y])")
    found = page.evaluate("iceg.measurement()")
    expected = result.distance(*(tuple(point) for point in measured))
    assert found["length"] == pytest.approx(expected.length, abs=0.005)
    assert found["deviation"] == pytest.approx(expected.deviation, rel=0.1)
    assert page.locator("#measured-length").inner_text() == f"{found['length']:.3f} m"
    keys = page.evaluate("iceg.state.measured.map(seen => seen.key)")
    assert keys[0] != keys[1]
    displaced = Displacement(key=max(keys), variances=np.array([4.0, 4.0, 1.0]))
    page.evaluate(f"iceg.run.joint.displacements.push({{key: {displaced.key}, variances: [4, 4, 1]}})")
    marginals = result.joint.marginals + displaced_covariances([displaced], len(result.key_scans))
    joint = replace(result.joint, marginals=marginals, displacements=(displaced,))
    expected = replace(result, joint=joint).distance(*(tuple(point) for point in measured))
    assert expected.deviation > 1.0
    assert page.evaluate("iceg.measurement()")["deviation"] == pytest.approx(expected.deviation, rel=0.01)
    page.evaluate("iceg.run.joint.displacements.pop()")
    page.keyboard.press("Escape")
    assert page.locator("#measure").get_attribute("aria-pressed") == "false"


def test_figures_warnings_and_what_was_learned_are_told(page: "Page", shown: Shown) -> None:
    figures = page.locator("#figures").inner_text()
    assert "NEES" in figures
    assert "Least known position" in figures
    assert f"{shown.result.summary['closures']['accepted']} of {shown.result.summary['closures']['tried']}" in figures
    landmarks = shown.result.landmarks
    counts = f"{len(landmarks.settled())} landmarks ({len(landmarks)} with those seen rarely"
    assert counts in figures
    assert counts in page.locator("#inspector").inner_text()
    assert "Laser noise" in page.locator("#learned").inner_text()
    assert "grid.resolution" in page.locator("#settings").inner_text()
    assert page.locator("#warnings").inner_text()

"""Correcting a run in its page: with a server edits are solved at once, without one they are downloaded."""

# ruff: noqa: F401, F811 the browser is a fixture of another file

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import iceg
from iceg.corrections.corrections import Corrections, Cut
from iceg.corrections.reading import read_corrections
from iceg.maps.config import GridConfig
from iceg.resolving import resolve
from iceg.run_folder import read_closures, read_run_folder
from iceg.view.server import ViewServer
from iceg.view.session import CORRECTIONS, Session
from tests.test_report_page import DESKTOP, PHONE, browser, opened

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CONFIG = iceg.Config(grid=GridConfig(resolution=0.1))
CUT = 10


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose first scans are cut, so that the page counts otherwise than the log."""
    directory = tmp_path_factory.mktemp("edits") / "run"
    log = iceg.read_log(iceg.demo_log_path()).select(slice(260))
    iceg.write_results(iceg.run(log, CONFIG, corrections=Corrections(cut=Cut(drop=((0, CUT - 1),)))), directory)
    return directory


def first_accepted(folder: Path) -> tuple[int, list[int]]:
    """Index of the first closure in force, and its scans as recorded."""
    closures = read_closures(folder / "closures.csv")
    index = next(k for k, closure in enumerate(closures) if closure.verdict == "accepted")
    return index, [closures[index].scan_i + CUT, closures[index].scan_j + CUT]


def select_closure(page: "Page", index: int) -> None:
    page.evaluate(f"iceg.set('selection', {{selection: {{type: 'closure', index: {index}}}}})")


def test_without_a_server_the_corrections_are_downloaded(
    browser: "Browser",
    folder: Path,
    tmp_path: Path,
) -> None:
    page = opened(browser, folder / "report.html", DESKTOP)
    index, scans = first_accepted(folder)
    assert not page.locator("#edits").is_visible()
    select_closure(page, index)
    page.get_by_role("button", name="Forbid", exact=True).click()
    page.get_by_role("button", name="Pin").click()
    page.get_by_role("button", name="Forbid all around").click()
    assert "3 corrections" in page.locator("#edits").inner_text()
    page.get_by_role("button", name="Undo").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download corrections").click()
    saved = tmp_path / download.value.suggested_filename
    download.value.save_as(saved)
    assert saved.name == CORRECTIONS
    found = read_corrections(saved)
    assert [list(each.one + each.other) for each in found.forbidden] == [[scans[0]] * 2 + [scans[1]] * 2]
    assert [[each.scan_i, each.scan_j] for each in found.pinned] == [scans]
    assert resolve(folder, found).summary["corrections"]["pinned"] == [scans]
    assert page.trouble == []  # type: ignore[attr-defined]
    page.context.close()


def test_a_scan_is_dragged_onto_another(browser: "Browser", folder: Path) -> None:
    page = opened(browser, folder / "report.html", PHONE)
    index, scans = first_accepted(folder)
    select_closure(page, index)
    page.get_by_role("button", name="Drag…").click()
    canvas = page.locator("canvas.drag")
    canvas.scroll_into_view_if_needed()
    before = page.locator("#inspector output").inner_text()
    box = canvas.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=3)
    page.mouse.up()
    page.keyboard.press("[")
    moved = page.locator("#inspector output").inner_text()
    assert moved != before
    page.get_by_role("button", name="Close the loop like this").click()
    added = page.evaluate("iceg.asText()")
    assert f"scans = [{scans[0]}, {scans[1]}]" in added
    assert "pose = [" in added
    assert page.trouble == []  # type: ignore[attr-defined]
    page.context.close()


@pytest.fixture
def served(folder: Path, tmp_path: Path) -> Iterator[ViewServer]:
    directory = tmp_path / "run"
    directory.mkdir()
    for path in folder.iterdir():
        (directory / path.name).write_bytes(path.read_bytes())
    with ViewServer(Session(directory)) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def open_served(browser: "Browser", server: ViewServer) -> "Page":
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.goto(server.address)
    page.locator("html[data-ready=true]").wait_for()
    return page


def test_with_a_server_an_edit_is_solved_and_saved(
    browser: "Browser",
    served: ViewServer,
    tmp_path: Path,
) -> None:
    directory = served.session.directory
    before = read_run_folder(directory)
    index, scans = first_accepted(directory)
    page = open_served(browser, served)
    select_closure(page, index)
    page.get_by_role("button", name="Forbid", exact=True).click()
    page.locator("#edits", has_text="1 correction, saved").wait_for()
    assert f"scans = [{scans[0]}, {scans[1]}]" in (directory / CORRECTIONS).read_text()
    forbidden = read_closures(directory / "closures.csv")[index]
    assert (forbidden.verdict, forbidden.reason.startswith("forbidden by hand")) == ("rejected", True)
    page.locator("html[data-ready=true]").wait_for()
    select_closure(page, index)
    assert "forbidden by hand" in page.locator("#inspector").inner_text().lower()
    page.screenshot(path=tmp_path / "edited.png")
    page.get_by_role("button", name="Undo").click()
    page.locator("#edits").wait_for(state="hidden")
    page.locator("html[data-ready=true]").wait_for()
    np.testing.assert_array_equal(read_run_folder(directory).trajectory.poses, before.trajectory.poses)
    page.context.close()


def test_a_tab_that_is_behind_and_a_server_that_is_gone_are_told(
    browser: "Browser",
    served: ViewServer,
) -> None:
    index, scans = first_accepted(served.session.directory)
    page = open_served(browser, served)
    served.session.edit("forbid", {"revision": 0, "scans": scans})
    select_closure(page, index)
    page.get_by_role("button", name="Pin").click()
    page.locator("#edits", has_text="load it again").wait_for()
    served.shutdown()
    served.server_close()
    page.get_by_role("button", name="Pin").click()
    page.locator("#edits", has_text="iceg view has ended").wait_for()
    page.context.close()


def test_a_wrong_closure_by_hand_is_taken_out_in_the_page(browser: "Browser", served: ViewServer) -> None:
    directory = served.session.directory
    before = read_run_folder(directory).trajectory.poses
    _, scans = first_accepted(directory)
    served.session.edit("drag", {"revision": 0, "scans": scans, "pose": [4.0, 1.0, 2.0]})
    page = open_served(browser, served)
    page.evaluate(
        "iceg.set('selection', {selection: {type: 'closure', index: iceg.run.closures.reasons.findIndex("
        "(reason) => reason.startsWith('by hand'))}})"
    )
    page.get_by_role("button", name="Take out").click()
    page.locator("#edits", has_text="2 corrections, saved").wait_for()
    assert "[[add]]" not in (directory / CORRECTIONS).read_text()
    np.testing.assert_array_equal(read_run_folder(directory).trajectory.poses, before)
    page.context.close()

"""The pages: their links lead somewhere, the commands they show exist, and the reference leaves nothing out."""

import csv
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

import iceg
from docs._extensions.settings_tables import settings_tables
from iceg.cli.parsing import parse
from iceg.cli.settings_flags import setting_names
from iceg.config import Config, format_config
from iceg.evaluation.setting_scales import STAGES, scalable_settings

REPOSITORY = Path(__file__).parent.parent
PAGES = sorted((REPOSITORY / "docs").rglob("*.md"))
LINKED = [*PAGES, REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md"]

FENCE = re.compile(r"^ *```([^\n]*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?:)([^)\s#]*)(?:#([^)\s]*))?\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)


def name_of(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


def anchors(page: Path) -> set[str]:
    """As GitHub and MyST make them of the headings."""
    headings = HEADING.findall(FENCE.sub("", page.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def commands(page: Path) -> Iterator[str]:
    """Lines of `iceg …` in the unmarked blocks of a page; what may be left out is given."""
    for language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        for line in block.splitlines():
            if not language and re.match(r" *iceg [a-z]", line):
                yield re.sub(r"[\[\]]", "", line.partition(" > ")[0]).strip()


@pytest.mark.parametrize("page", LINKED, ids=name_of)
def test_links_within_the_repository_lead_somewhere(page: Path) -> None:
    for target, anchor in LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        path = page.parent / target if target else page
        assert path.exists(), f"{name_of(page)} links to {target}, which is not there"
        if anchor:
            assert anchor in anchors(path), f"{name_of(page)} links to {target}#{anchor}: no such heading"


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands(page))], ids=name_of)
def test_commands_that_are_shown_exist(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("settings.toml").write_text(format_config(Config()), encoding="utf-8")
    for line in commands(page):
        words = shlex.split(line, comments=True)[1:]
        try:
            parse(words)
        except SystemExit as ended:
            pytest.fail(f"{name_of(page)} shows '{line}', which ends with {ended.code}")


def test_the_reference_has_every_public_name() -> None:
    page = (REPOSITORY / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"^\.\. auto\w+:: iceg\.(\w+)$", page, re.MULTILINE))
    assert shown == set(iceg.__all__) - {"__version__"}


def test_the_reference_has_every_setting_with_its_default() -> None:
    shown, stage = {}, ""
    for line in settings_tables(Config()):
        if heading := re.fullmatch(r"## `(.*)`", line):
            stage = f"{heading[1]}."
        elif row := re.match(r"\| `(\w+)` \| (.*?) \| (.*?) \| (.*?) \| (.*) \|$", line):
            shown[stage + row[1]] = (row[2], row[5])
    assert set(shown) == set(setting_names(Config))
    assert all(text for _, text in shown.values())
    assert shown["front_end.key_scans.distance"][0] == "0.35 m"
    assert shown["front_end.key_scans.angle"][0] == "0.4 rad (22.9°)"


def test_the_reference_says_what_half_and_twice_of_a_setting_do() -> None:
    made = {"half [%]": "2.4", "half, worst log [%]": "11.6", "twice [%]": "", "twice, worst log [%]": ""}
    lines = list(settings_tables(Config(), scales={"loops.radius": made}))
    assert any(line.startswith("| `radius` | 3 m | +2 / +12 % | – |") for line in lines)


def test_scaled_settings_are_those_there_are_with_their_defaults() -> None:
    known = dict(scalable_settings(Config()))
    with (REPOSITORY / "docs" / "reference" / "settings-scaled.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["setting"]: pytest.approx(known[row["setting"]]) for row in rows} == {
        row["setting"]: float(row["default"]) for row in rows
    }
    assert {row["setting"].partition(".")[0] for row in rows} == set(STAGES)

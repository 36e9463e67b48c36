"""Damaged and hostile files end in a result or in one line of error, never in a traceback."""

from pathlib import Path

import pytest

from iceg.cli import main
from tests.fuzz.cases.case import Case
from tests.fuzz.hostile import CASES, SLOW


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=case.name) for case in CASES if not any(part in case.name for part in SLOW)]
)
def test_a_hostile_file_ends_in_a_line_of_error(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case.make(tmp_path)
    monkeypatch.chdir(tmp_path)
    try:
        code = main(case.words)
    except SystemExit as end:
        code = int(end.code or 0)
    told = capsys.readouterr().err
    assert code in {0, 1, 2}
    assert "Traceback" not in told
    assert max(map(len, told.splitlines()), default=0) < 2000

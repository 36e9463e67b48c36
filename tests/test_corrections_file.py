"""`corrections.toml`, and CSVs handed in as corrections: what they may say, and how they are refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graph.errors import IcegError
from iceg.corrections.corrections import CorrectionsError
from iceg.corrections.reading import parse_corrections, read_all_corrections, read_corrections
from iceg.slam.closures.closure import CLOSURE_COLUMNS
from tests.conftest import REPOSITORY

EVERYTHING = """\
# what is wrong with this run
[[forbid]]
scans = [100, 9000]

[[forbid]]
between = [[0, 200], [8900, 9100]]

[[add]]
scans = [120, 8950]
pose = [0.1, -0.2, 1.5]
sigma_m = 0.05
sigma_rad = 0.01
pin = true

[[add]]
scans = [130, 8960]

[[pin]]
scans = [140, 8970]

[[distrust]]
scans = [4000, 4100]
factor = 4

[cut]
keep = [[50, 9500]]
drop = [[6000, 6100], [7000, 7000]]

[map]
upright = true
turn_degrees = 90
origin_scan = 100
"""


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_everything_it_may_say(tmp_path: Path) -> None:
    found = read_corrections(write(tmp_path / "c.toml", EVERYTHING))
    assert [(each.one, each.other, each.is_single) for each in found.forbidden] == [
        ((100, 100), (9000, 9000), True),
        ((0, 200), (8900, 9100), False),
    ]
    first, second = found.added
    assert first.T_i_j is not None
    np.testing.assert_array_equal(first.T_i_j, [0.1, -0.2, 1.5])
    assert (first.sigma_m, first.sigma_rad, first.pinned) == (0.05, 0.01, True)
    assert (second.scan_i, second.scan_j, second.T_i_j, second.pinned) == (130, 8960, None, False)
    assert (found.pinned[0].scan_i, found.pinned[0].scan_j) == (140, 8970)
    assert (found.distrusted[0].scans, found.distrusted[0].factor) == ((4000, 4100), 4.0)
    assert (found.frame.upright, found.frame.turn_degrees, found.frame.origin_scan) == (True, 90.0, 100)
    kept = found.check(10_000)
    assert kept.intervals == ((50, 5999), (6101, 6999), (7001, 9500))
    assert found.forbidden[1].where.endswith("c.toml:6")


def test_the_example_in_the_documentation_is_sound(tmp_path: Path) -> None:
    text = (REPOSITORY / "docs" / "corrections.md").read_text(encoding="utf-8")
    example = text.split("```toml\n")[1].split("```")[0]
    found = read_corrections(write(tmp_path / "corrections.toml", example))
    assert found.forbidden
    assert found.added
    assert found.pinned
    assert found.distrusted
    assert found.cut.keep
    assert found.frame.upright


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[[forbid]]\nscans = [1, 2\n[x]", r":\d: not valid TOML"),
        ("[[forbidden]]\nscans = [1, 2]", r":1: found 'forbidden', expected one of forbid, add, pin"),
        ("\n[forbid]\nscans = [1, 2]", r":2: forbid: found .*, expected tables \[\[forbid\]\]"),
        ("forbid = 3", r":1: forbid: found 3, expected tables"),
        ("[[forbid]]\n", r":1: expected either scans = \[i, j\] or between"),
        ("[[forbid]]\nscans = [1, 2]\nbetween = [[1, 2], [3, 4]]", r":1: expected either"),
        ("[[forbid]]\nscans = [1, 2]\n\n[[forbid]]\n\nscan = [3, 4]", r":6: unknown key 'scan', did you mean 'scans'"),
        ("[[forbid]]\nscans = [1, 'two']", r":2: scans: found .*two.*, expected a list of a whole number"),
        ("[[forbid]]\nscans = [2, 2]", r":2: scans: found \[2, 2\], expected two different ones"),
        ("[[forbid]]\nbetween = [[5, 2], [8, 9]]", r":2: between: found \[5, 2\], expected \[first, last\]"),
        ("[[add]]\npose = [0, 0, 0]", r":1: found no scans, expected scans"),
        ("[[add]]\nscans = [1, 5]\npose = [0, 0]", r":3: pose: found \[0, 0\]"),
        ("[[add]]\nscans = [1, 5]\npose = [0, 0, inf]", r":3: pose: found"),
        (
            "[[add]]\nscans = [1, 5]\npose = [0, 0, 90]",
            r":3: pose: found a heading of 90 rad, expected radians \(90° is 1.5708",
        ),
        ("[[add]]\nscans = [1, 5]\nsigma_m = 0.0", r":3: sigma_m: found 0, expected 1e-06 to 10000"),
        ("[[add]]\nscans = [1, 5]\npin = 1", r":3: pin: found 1, expected true or false"),
        ("[[pin]]\nscans = [-1, 5]", r":2: scans: found \[-1, 5\]"),
        ("[[distrust]]\nscans = [1, 5]\nfactor = 0.5", r":3: factor: found 0.5, expected 1 to 10000"),
        ("[cut]\nkeep = [[5, 1]]", r":2: keep: found \[5, 1\]"),
        ("[cut]\ndrop = [5, 1]", r":2: drop: found \[5, 1\], expected a list of"),
        ("[map]\norigin = [0, 0]\norigin_scan = 3", r":3: found origin and origin_scan, expected one"),
        ("[map]\nupright = true\n\nturn_degrees = 1e9", r":4: turn_degrees: found 1e\+09, expected numbers of at most"),
        ("[map]\n# upright\norigin_scan = -1", r":3: origin_scan: found -1, expected 0 or more"),
        ("[map]\nupright = 'yes'", r":2: upright: found 'yes', expected true or false"),
        ("map = 3", r":1: map: found 3, expected a table"),
        (",".join(CLOSURE_COLUMNS) + "\n1,2,0,0,0,0.9,100,0.8,perhaps,why\n", r":2: found the verdict 'perhaps'"),
        (",".join(CLOSURE_COLUMNS) + "\n1,2,0,0\n", r":2: found 4 values, expected 10"),
        (",".join(CLOSURE_COLUMNS) + "\n1,1,0,0,0,0.9,100,0.8,accepted,why\n", r":2: found scans 1 and 1"),
    ],
)
def test_what_it_must_not_say(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(IcegError, match=rf"bad\.toml{complaint}"):
        read_corrections(write(tmp_path / "bad.toml", text))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[[forbid]]\nscans = [1, 100]", r":2: found scan 100, but the log has 100 scans"),
        ("[[forbid]]\nbetween = [[0, 1], [90, 120]]", r":2: found scan 120, but the log has 100 scans"),
        ("[map]\norigin_scan = 100", r":2: found scan 100"),
        ("[cut]\nkeep = [[200, 300]]", r":2: found scan 300"),
        ("[cut]\nkeep = [[1, 9]]\ndrop = [[9, 300]]", r":3: found scan 300"),
        ("[cut]\ndrop = [[0, 99]]", r":1: nothing is left of 100 scans"),
        ("[[pin]]\nscans = [5, 50]\n[cut]\ndrop = [[40, 60]]", r":2: found scan 50, which is cut from the log"),
    ],
)
def test_what_does_not_fit_the_log(tmp_path: Path, text: str, complaint: str) -> None:
    corrections = read_corrections(write(tmp_path / "c.toml", text))
    with pytest.raises(CorrectionsError, match=rf"c\.toml{complaint}"):
        corrections.check(100)


@given(st.lists(st.sampled_from(["", "# scans = [1, 2]", "  # a remark"]), max_size=5), st.sampled_from(["pin", "add"]))
def test_a_mistake_is_on_the_line_of_its_key(between: list[str], table: str) -> None:
    lines = [*between, "[[pin]]", "scans = [1, 2]", *between, f"[[{table}]]", *between, "scans = [7, 7]"]
    with pytest.raises(CorrectionsError, match=rf"^c\.toml:{len(lines)}: scans: found \[7, 7\]"):
        parse_corrections("\n".join(lines), "c.toml")


def test_a_csv_of_another_header_is_told_so_and_is_no_toml(tmp_path: Path) -> None:
    with pytest.raises(IcegError, match=r"c\.csv:1: found the header 'a,b', expected 'scan_i,scan_j"):
        read_corrections(write(tmp_path / "c.csv", "a,b\n1,2\n"))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CorrectionsError, match=r"nowhere\.toml"):
        read_corrections(tmp_path / "nowhere.toml")


def test_scans_count_as_recorded_whatever_is_cut(tmp_path: Path) -> None:
    file = write(tmp_path / "c.toml", "[[forbid]]\nscans = [20, 80]\n[cut]\ndrop = [[0, 9], [50, 59]]")
    corrections = read_corrections(file)
    kept = corrections.check(100)
    (there,) = corrections.counted_in(kept).forbidden
    assert (there.one, there.other) == ((10, 10), (60, 60))


def test_two_files_together_cut_once(tmp_path: Path) -> None:
    one, other = (write(tmp_path / name, "[cut]\ndrop = [[0, 9]]") for name in ("a.toml", "b.toml"))
    closures = write(tmp_path / "c.csv", "scan_i,scan_j,x_m,y_m,theta_rad\n3,70,0.5,-0.25,1.5\n")
    together = read_all_corrections([one, closures])
    assert together.cut.drop == ((0, 9),)
    assert len(together.added) == 1
    with pytest.raises(CorrectionsError, match=r"b\.toml:1: found more than one file that cuts"):
        read_all_corrections([one, other])
    turned = [write(tmp_path / name, "[map]\nturn_degrees = 9") for name in ("c.toml", "d.toml")]
    with pytest.raises(CorrectionsError, match=r"d\.toml:1: found more than one file that turns the map"):
        read_all_corrections(turned)

"""`iceg compare`: two runs of one log side by side."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True, kw_only=True)
class Compare:
    """Tell where two runs of one log differ, and lay both maps under a slider."""

    a: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="A", help="The folder of a run.")]
    b: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="B", help="The folder of another.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FILE", help="The page, replaced if it is there.")
    ] = Path("compare.html")
    json: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="One JSON object instead of a table.", help_behavior_hint=""),
    ] = False

    def __call__(self) -> None:
        """Read both, compare, print and write the page."""
        from iceg.compare.comparison import compare_runs
        from iceg.compare.map_pair import map_pair
        from iceg.compare.page import write_page
        from iceg.compare.report import format_comparison
        from iceg.run_folder import read_run_folder

        a, b = read_run_folder(self.a), read_run_folder(self.b)
        comparison, names = compare_runs(a, b), _names(self.a, self.b)
        write_page(comparison, map_pair(a, b, comparison.lone_closures), names, self.output)
        if self.json:
            print(json.dumps({"a": names[0], "b": names[1], **comparison.record()}, allow_nan=False))
            return
        print(format_comparison(comparison, names))
        print(f"Both maps are in {self.output}")


def _names(a: Path, b: Path) -> tuple[str, str]:
    """What tells two folders apart: their names, with as many of those above as it takes."""
    parts_a, parts_b = a.resolve().parts, b.resolve().parts
    most = max(len(parts_a), len(parts_b))
    n = next((n for n in range(1, most) if parts_a[-n:] != parts_b[-n:]), 1)
    return "/".join(parts_a[-n:]), "/".join(parts_b[-n:])

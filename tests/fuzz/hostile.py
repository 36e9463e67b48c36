"""Damaged and hostile files, each with the command that is given it: none may end but in a result or one line of error.

`python -m tests.fuzz.hostile [WORD ...]` runs each of them, or those with these words in their name, in a process of
its own and prints what became of those that broke something.
"""

import sys
import tempfile
from pathlib import Path

from tests.fuzz.cases.case import Case
from tests.fuzz.cases.folders import folders
from tests.fuzz.cases.logs import logs
from tests.fuzz.cases.plans import plans
from tests.fuzz.cases.scenes import scenes
from tests.fuzz.cases.settings import experiments, settings
from tests.fuzz.cases.tables import tables
from tests.fuzz.sandbox import run_command

SLOW = ("endless blank", "endless comments", "RGBA", "30,000² bits", "4 million", "uses of uses")
"""Cases that take seconds to write or to refuse, by a part of their names."""

CASES: tuple[Case, ...] = (
    *logs(),
    *settings(),
    *scenes(),
    *plans(),
    *tables(),
    *folders(),
    *experiments(),
)


def main() -> None:
    """Run every case in a process of its own and print what became of it."""
    chosen = [case for case in CASES if all(word in case.name for word in sys.argv[1:])]
    found: dict[str, list[str]] = {}
    for case in chosen:
        with tempfile.TemporaryDirectory() as name:
            case.make(Path(name))
            outcome = run_command(case.words, Path(name))
        kind = outcome.finding
        found.setdefault(kind, []).append(case.name)
        if kind:
            last = outcome.told.strip().splitlines()[-1:] or [""]
            print(
                f"{kind:10} {outcome.peak_bytes / 1e9:4.1f} GB {outcome.seconds:5.1f} s  {case.name}: {last[0][:120]}",
                flush=True,
            )
    print(f"{len(chosen)} files", {kind or "as it should": len(names) for kind, names in found.items()})


if __name__ == "__main__":
    main()

"""`python -m iceg.evaluation.regression.keep` writes docs/regression.md from what was measured, or a new baseline."""

import csv
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from graph.atomic import write_atomically
from iceg.evaluation.bench.tables import Row, format_markdown, write_csv
from iceg.evaluation.regression.comparison import changed_cells, in_words
from iceg.evaluation.regression.kept import BASELINE, RULES_TABLE
from iceg.evaluation.regression.outcome import Outcome, read_outcomes
from iceg.evaluation.regression.rules import RULES
from iceg.evaluation.regression.study import OUTCOMES, compared_by_group, total_rows
from iceg.evaluation.regression.study import RULES_TABLE as RULES_NAME

_HEAD = """# What changes from version to version

```
iceg bench --parts regression -o DIR      # the table, against the baseline; --long for every cell there is
iceg ablation --rules -o DIR              # the same with each rule and gate switched off in turn
iceg bench --parts regression --seeds 5000-5799 --odometry none -o DIR      # either on as many random scenes as wanted
iceg bench --parts regression --seeds 9000-9060 --laser kinect -o DIR        # with another laser than they draw
iceg bench --parts regression --seeds 9080-9200 --fault carried -o DIR       # all with one fault
iceg bench --parts regression --noise 11-14 -o DIR                          # where a millimetre decides, other noise
python -m iceg.evaluation.regression.likelihood -o FILE --seeds 26000-26319 [--baseline FILE]    # of the factors alone
python -m iceg.evaluation.regression.shortfall --seeds 9100-9160 --laser urg-04lx [--perfect]    # of matches: bias
python -m iceg.evaluation.regression.keep DIR ... [--as-baseline]    # writes this page from DIR
```

A cell is one run with the default settings: thirty recorded worlds with exact truth (*worlds*), the five logs of the
benchmark (*logs*), both with one fault each (*faults*, see [robustness.md](robustness.md)), simulated scenes with
lasers from 3.5 m to 80 m (*simulated*), some of these with a robot that is carried (*carried*), scenes of twelve kinds
drawn at random (*random*; `iceg simulate random:SEED` writes one), and others of them with one fault each (*degraded*).
Where a millimetre decides, a cell comes with four seeds of a millimetre of noise.

*Good* is an error below 0.1 m, or below 2 % of that of the odometry; *ruined* is neither, above 0.3 m, and five times
the error without the fault. *Said*: the run was lost, its path is broken, or it warns. *Off in silence* is what is not
good and not said, ruined or not. *NEES* is the median over the runs of the mean NEES of their key poses (3 is right),
*above 12* the share of runs whose standard deviations are too small by two. *Worse than odometry* counts runs that are
not good and err by more than the odometry they were given. `iceg.evaluation.regression.verdict` holds the definitions.

*p* is the probability that a version which is neither better nor worse differs by so much: the signs of the differences
are flipped at random (McNemar's exact test where they are counts), cells that differ by their noise alone as one.
*Cells changed* are those on which a change has any effect at all. Processor time compares only runs made at the same
time on the same machine. The random scenes joined later: their baseline is the version before they were looked at, of
those that are degraded that of November 2026.

Where one decision tips a run, versions that are equally good differ tenfold. `likelihood` tells what a change does to
odometry, matches and closures each by itself: the mean log-density of the true relative pose under their factors.
`shortfall` tells whether matches err to one side: those of a URG-04LX that claimed 3 to 10 and 10 to 50 cm fell short
by 3.0 and 8.3 % of the way before the ends of what it sees were no walls and round walls no polygons, by .9 and 3.6 %
now; those that claim less by .2 % and .1 %.
"""

_WHY_SOME_STAY = """Of those that move nothing here, *mount*, *delay*, *held readings*, *frozen scans*, *dead odometry*
and *lost odometry* answer faults of laser, odometry and recorder, and *goes on* with *sudden steps* odometry that is
set to zero on the way: without them the embedded log then ends 6.9 m off, not 3 mm. *Contradicted closures* decides
what `closures.csv` calls removed, and no more. *Relocalisation*: the rows on worlds and
logs, and those of *relocalisation without a loss*, are of a search for similar places; that on faults, carried and
degraded cells is of maps laid onto each other, by which alone 14 of 104 are good. The rows of the
192 random scenes (seeds 192 to 383) say that odometry was widened too soon and scans of few returns given up too early:
they were made before either was changed. The rows of *robust closures* on logs and faults are of a kernel that faded
from a χ² of 5 on, where one true closure in six lies. *Confirmed passes* keep the cost of a closure from growing with
the run. *Confirmations* move nothing in the mean, but on open ground, where a single closure may be metres off, two
cells end 2.7 m and 20 m off without them instead of .1 and 3.8 m, at a NEES of 16 and 32. *Velocity filter* moves
nothing once a log has been tracked a second time. The first pass alone, which is all that scans added one by one get,
errs without it 1.21 times as far on 230 scenes without odometry, and 1.33 times as far from scan to tenth scan (p below
1e-4 for both). *Uncertain usual velocity* is no more than chance in any one sample (of 368 scenes without odometry all
together the error is .95 of what it is without it, p .09; above 12 33, not 37; ruined 79, not 76); it stays because
without it the sum of what rows of unseen steps err is foretold 1.9 and 8.5 times too small, in squares, where the
velocity is the very process that is assumed (`tests/test_velocity.py`). *Between keys* moves the scans between key
scans by a millimetre or two, and hardly anything else. *Within reach* moves nothing where a laser sees far around:
nobody takes two places for one there. *Submap drift* and *doubtful matches* move errors by no more than chance;
without the one matches that it concerns are .32 nats less probable (40 scenes, p 2e-4 by scenes), without the other
two runs more are off in silence, and above 12 4.1 % of all. The rows on a range of seeds are those of `iceg ablation
--rules --seeds A-B`, with `--laser NAME` where one is named. All rows but those on 205 cells and on scenes 41000-41149
are older than what is worth more than most rules: that the ends of what a short laser sees are no walls across and
round walls no polygons, and that each range errs by its own distance.
By the first two, 81 scenes without odometry (5000-5300) err by .72 of what they did (.60 to .86), 48 with a URG-04LX
(9100-9160) by .60 (.50 to .73), and 78 with lasers as drawn (9000-9100) by .90 (.80 to 1.02); by the third, 48 with a
Kinect (9100-9160) by .70 (p below .005).
"""


@dataclass(frozen=True, kw_only=True)
class Keep:
    """Write docs/regression.md from the tables in DIR; those of rules are kept, too, one below the other."""

    measured: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="DIR ...", help="Each with a regression.csv, of which the first counts, or a rules.csv."),
    ]
    as_baseline: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Later versions are compared with this one.", help_behavior_hint=""),
    ] = False
    page: Annotated[Path, tyro.conf.arg(metavar="FILE", help="The page.")] = Path("docs/regression.md")

    def __call__(self) -> None:
        """Keep the tables and write the page."""
        rules = [row for folder in self.measured for row in _read_rows(folder / RULES_NAME)]
        if rules:
            write_csv(rules, RULES_TABLE)
        outcomes = next((folder / OUTCOMES for folder in self.measured if (folder / OUTCOMES).exists()), BASELINE)
        if self.as_baseline and outcomes != BASELINE:
            shutil.copyfile(outcomes, BASELINE)
        before, after = read_outcomes(BASELINE), read_outcomes(outcomes)
        write_atomically(self.page, page(before, after, _read_rows(RULES_TABLE)).encode())


def page(before: Sequence[Outcome], after: Sequence[Outcome], rules: Sequence[Row]) -> str:
    """The text of docs/regression.md.

    Args:
        before: the baseline.
        after: the present; the same outcomes where it is the baseline.
        rules: of the table of rules, none where it was not made.
    """
    parts = [_HEAD, f"## The baseline\n\n{format_markdown(total_rows(before))}\n"]
    if list(after) != list(before):
        parts.append(f"## The present, against the baseline\n\n{format_markdown(compared_by_group(before, after))}\n")
        parts.append(f"Cells that changed by a fifth, or in their verdict:\n\n{_changed(before, after)}\n")
    if faults := _faults(after):
        parts.append(f"## What one fault does, present\n\n{format_markdown(faults)}\n")
    if rules:
        parts.append(f"## Without one rule\n\n{format_markdown(rules)}\n")
        off = [name for name in dict.fromkeys(str(row["off"]) for row in rules) if name in RULES]
        parts.append("".join(f"- *{name}*: {RULES[name].what}.\n" for name in off))
        parts.append(_WHY_SOME_STAY)
    return "\n".join(parts)


def _changed(before: Sequence[Outcome], after: Sequence[Outcome]) -> str:
    rows = changed_cells(before, after)
    return format_markdown(rows) if rows else "none"


def _faults(outcomes: Sequence[Outcome]) -> list[Row]:
    """A row for each log with a fault, those that differ by a millimetre of noise in one."""
    families: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.group == "faults":
            families.setdefault(outcome.family, []).append(outcome)
    return [
        {
            "fault": family[0].fault,
            "log": family[0].source,
            "without it [m]": f"{family[0].usual_m:.3f}",
            "with it [m]": ", ".join(f"{outcome.error_m:.3f}" for outcome in family),
            "verdict": "; ".join(dict.fromkeys(in_words(outcome) for outcome in family)),
        }
        for family in families.values()
    ]


def _read_rows(path: Path) -> list[Row]:
    """The rows of a table as `write_csv` wrote it; none where there is no file."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return [{name: _figure(word) for name, word in row.items()} for row in csv.DictReader(stream)]


def _figure(word: str) -> float | int | str | None:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            pass
    return word or None


if __name__ == "__main__":
    tyro.cli(Keep)()

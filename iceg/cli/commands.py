"""All commands: what each is, which settings are its flags too, and which of those its help shows first."""

from dataclasses import dataclass

from frontends.dp_slam.config import DpSlamConfig
from iceg.cli.compare import Compare
from iceg.cli.export import Export
from iceg.cli.judge import Eval, Info, Plot
from iceg.cli.resolve import Resolve
from iceg.cli.run import Demo, DpSlam, Run
from iceg.cli.studies import Ablation, Bench, Nees
from iceg.cli.tools import Convert, Optimize, PrintConfig, Simulate
from iceg.cli.view import View
from iceg.config import Config, LogConfig

Command = (
    Run
    | DpSlam
    | Demo
    | Info
    | Eval
    | Plot
    | Resolve
    | View
    | Compare
    | Export
    | Simulate
    | Convert
    | Optimize
    | Bench
    | Ablation
    | Nees
    | PrintConfig
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One command.

    Attributes:
        kind: what it does.
        group: the commands it is listed with.
        settings: whose fields are flags of it, too; None where there are none.
        prefix: of those flags, with its dot.
        common: the settings that its short help shows.
    """

    kind: type[Command]
    group: str
    settings: type[Config] | type[DpSlamConfig] | type[LogConfig] | None = None
    prefix: str = ""
    common: tuple[str, ...] = ()


_RUNS, _JUDGES, _FILES, _STUDIES = "a recording", "its results", "files", "research"

COMMANDS: dict[str, Entry] = {
    "run": Entry(
        kind=Run,
        group=_RUNS,
        settings=Config,
        common=("matcher", "log.range_max", "log.scan_topic", "grid.resolution"),
    ),
    "info": Entry(
        kind=Info, group=_RUNS, settings=LogConfig, prefix="log.", common=("laser", "range_max", "scan_topic")
    ),
    "demo": Entry(kind=Demo, group=_RUNS),
    "config": Entry(kind=PrintConfig, group=_RUNS, settings=Config, common=("matcher", "seed")),
    "eval": Entry(kind=Eval, group=_JUDGES),
    "plot": Entry(kind=Plot, group=_JUDGES),
    "view": Entry(kind=View, group=_JUDGES),
    "resolve": Entry(kind=Resolve, group=_JUDGES),
    "compare": Entry(kind=Compare, group=_JUDGES),
    "export": Entry(kind=Export, group=_JUDGES),
    "convert": Entry(
        kind=Convert, group=_FILES, settings=LogConfig, prefix="log.", common=("laser", "range_max", "scan_topic")
    ),
    "simulate": Entry(kind=Simulate, group=_FILES),
    "optimize": Entry(kind=Optimize, group=_FILES),
    "bench": Entry(kind=Bench, group=_STUDIES),
    "ablation": Entry(kind=Ablation, group=_STUDIES),
    "nees": Entry(kind=Nees, group=_STUDIES),
    "dp-slam": Entry(
        kind=DpSlam, group=_STUDIES, settings=DpSlamConfig, common=("particles", "samples", "resolution", "max_range")
    ),
}

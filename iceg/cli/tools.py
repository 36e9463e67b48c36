"""Commands beside the main job: simulated logs, any pose graph, all settings."""

import dataclasses
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from iceg.cli.options import ConfigFile, Json, Overwrite, SkipBadLines, UsageError
from iceg.cli.telling import Telling
from iceg.config import Config, LogConfig

if TYPE_CHECKING:
    from frontends.simulator.simulation import Simulation


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """Drive a robot through a simulated scene: a log in two formats, and the truth."""

    scene: Annotated[
        tyro.conf.Positional[str],
        tyro.conf.arg(
            metavar="SCENE",
            help="A scene that comes with iceg, such as rooms, random:SEED to draw one, or a path of a .world file.",
        ),
    ]
    output: Annotated[
        Path,
        tyro.conf.arg(aliases=["-o"], metavar="DIR", help="Folder for log.clf, log.usarsim and truth.csv."),
    ]
    seed: Annotated[int, tyro.conf.arg(help="Of all that is random.")] = 0
    laser: Annotated[
        Literal["sick", "rplidar-a1", "lds-01", "urg-04lx", "kinect", "realsense-d435"] | None,
        tyro.conf.arg(
            help="The laser; the scene's own unless given. RPLidar, LDS and URG sweep while the robot moves."
        ),
    ] = None
    overwrite: Overwrite = False
    json: Json = False

    def __call__(self) -> None:
        """Simulate and write."""
        from frontends.simulator.output import write_simulation
        from iceg.results import check_directory
        from iceg.show.progress import compile_note

        if self.seed < 0:
            raise UsageError(f"found --seed {self.seed}, expected 0 or more")
        check_directory(self.output, overwrite=self.overwrite)
        with compile_note():
            simulation = self._simulation()
            write_simulation(self.output, simulation)
        seconds, scans = float(simulation.log.stamps[-1]), len(simulation.log)
        with Telling(as_json=self.json) as telling:
            telling.say(f"{scans} scans in {seconds:.1f} s of '{simulation.scene.name}' are in {self.output}")
            telling.keep(scene=simulation.scene.name, scans=scans, seconds=seconds)

    def _simulation(self) -> "Simulation":
        from frontends.simulator.lasers import LASERS
        from frontends.simulator.random_scenes.scene import named_seed, simulate_random
        from frontends.simulator.simulation import simulate

        laser = None if self.laser is None else LASERS[self.laser]()
        drawn = named_seed(self.scene)
        if drawn is not None:
            return simulate_random(drawn, drive=self.seed, laser=laser)
        return simulate(self.scene, self.seed, laser=laser)


@dataclass(frozen=True, kw_only=True)
class Convert:
    """Write a log in another format: bags, tables, CARMEN, USARSim, DP-SLAM."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG", help="The recorded log.")]
    output: Annotated[
        tyro.conf.Positional[Path],
        tyro.conf.arg(metavar="OUT", help="Where to write it; the end of the name tells the format."),
    ]
    to: Annotated[
        Literal["by-name", "carmen", "usarsim", "dpslam", "ros1", "ros2", "mcap", "csv", "npz", "parquet"],
        tyro.conf.arg(help="The format; ros2 is sqlite3."),
    ] = "by-name"
    overwrite: Overwrite = False
    skip_bad_lines: SkipBadLines = False
    json: Json = False
    settings: LogConfig = field(default_factory=LogConfig)

    def __call__(self) -> None:
        """Read, write, and say what could not be carried."""
        from frontends.logs import read_log
        from frontends.logs.writers import check_free, write_log
        from iceg.show.progress import reading_bar

        log_format = self._format()
        check_free(self.output, overwrite=self.overwrite)
        with reading_bar(self.log) as progress:
            log = read_log(
                self.log, skip_bad_lines=self.skip_bad_lines, progress=progress, **dataclasses.asdict(self.settings)
            )
        lost = write_log(self.output, log, log_format=log_format, overwrite=self.overwrite)
        for warning in (*log.warnings, *lost):
            print(f"warning: {warning}", file=sys.stderr)
        with Telling(as_json=self.json) as telling:
            telling.say(f"{len(log)} scans are in {self.output}")
            telling.keep(scans=len(log))

    def _format(self) -> str:
        from frontends.logs.errors import LogError
        from frontends.logs.writers import format_of

        try:
            return format_of(self.output) if self.to == "by-name" else self.to
        except LogError as err:
            raise UsageError(str(err)) from err


@dataclass(frozen=True, kw_only=True)
class Optimize:
    """Solve any planar pose graph (g2o), robustly against false closures."""

    graph: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="GRAPH", help="The pose graph, a g2o file.")]
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FILE", help="The solved graph, with the edges that hold.")
    ]
    kernel: Annotated[
        Literal["given", "none", "huber", "cauchy", "geman_mcclure", "dcs"],
        tyro.conf.arg(help="Robust kernel of the closures; given: what the file says."),
    ] = "given"
    kernel_width: Annotated[float, tyro.conf.arg(help="Where it begins to fade.")] = 5.0
    gnc: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Decide by graduated non-convexity which closures hold.", help_behavior_hint=""),
    ] = False
    pcm: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Drop closures that disagree with most others first.", help_behavior_hint=""),
    ] = False
    incremental: Annotated[
        tyro.conf.FlagCreatePairsOff[bool],
        tyro.conf.arg(help="Grow the graph pose by pose before solving it at once.", help_behavior_hint=""),
    ] = False
    json: Json = False

    def __call__(self) -> None:
        """Read, solve, write, tell."""
        from graph.errors import GraphError
        from graph.g2o import read_g2o, write_g2o
        from graph.optimize_g2o import OptimizeOptions, format_report, optimize_g2o

        if not 0.0 < self.kernel_width < math.inf:
            raise UsageError(f"found --kernel-width {self.kernel_width}, expected a positive number")
        if self.output.resolve() == self.graph.resolve():
            raise UsageError(f"found {self.graph} as the graph and as --output, expected another file")
        options = OptimizeOptions(
            kernel=self.kernel,
            kernel_width=self.kernel_width,
            gnc=self.gnc,
            pcm=self.pcm,
            incremental=self.incremental,
        )
        graph = read_g2o(self.graph)
        try:
            solved = optimize_g2o(graph, options)
        except GraphError as err:
            raise GraphError(f"{self.graph}: {err}") from err
        write_g2o(self.output, solved.poses, solved.factors, solved.ids)
        with Telling(as_json=self.json) as telling:
            telling.say(format_report(solved))
            telling.say(f"The solved graph is {self.output}")
            telling.keep(
                vertices=len(solved.ids),
                edges_along_the_way=solved.n_odometry,
                closures=solved.n_closures,
                initial_error=solved.initial_error,
                final_error=solved.final_error,
                steps=solved.iterations,
                rejected=[dataclasses.asdict(edge) for edge in solved.rejected],
            )


@dataclass(frozen=True, kw_only=True)
class PrintConfig:
    """Print all settings with their documentation, as a file for --config."""

    config: ConfigFile = None
    settings: Config = field(default_factory=Config)

    def __call__(self) -> None:
        """Print the settings that would be used."""
        from iceg.config import format_config

        print(format_config(self.settings), end="")

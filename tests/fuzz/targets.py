"""Every kind of input that the command line takes: sound seeds of it, who reads it, and what must hold of the result.

A new kind of input is one more row in `TARGETS`.
"""

import bz2
import gzip
import io
import lzma
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from graph.errors import IcegError
from tests import bags
from tests.fuzz import seeds


class MeaninglessError(AssertionError):
    """A result that the input can't mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One kind of input.

    Attributes:
        file: its name, below the folder of a trial.
        seeds: sound inputs.
        read: reads it as the command line would and judges the result.
        use: what the command line would go on to do with it, which takes longer; None for nothing.
        prepare: puts into the folder what the input belongs to.
        words: the command line that takes it.
        packed: how the input is packed after it was changed; None for not at all.
        goes_on: whether it is read on behind a bad line, so that each line of an input is worth a change.
    """

    file: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], Any]
    words: tuple[str, ...]
    use: Callable[[Any], None] | None = None
    prepare: Callable[[Path], None] | None = None
    packed: Callable[[bytes], bytes] | None = None
    goes_on: bool = False

    def write(self, folder: Path, content: bytes) -> Path:
        """Put an input into a folder."""
        path = folder / self.file
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_bytes(self.packed(content) if self.packed else content)
        return path


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise MeaninglessError(what)


def _log(path: Path) -> Any:
    from frontends.logs import describe_log, read_log

    try:
        log = read_log(path)
    except IcegError:
        log = read_log(path, skip_bad_lines=True)
    bearings = log.geometry.bearings
    _require(bool(np.isfinite(log.odometry).all() and np.isfinite(log.stamps).all()), "odometry or stamps not finite")
    _require(bool((np.diff(bearings) > 0).all() and bearings[-1] - bearings[0] < 6.3), "bearings of no laser")
    _require(not (log.ranges > log.geometry.range_max).any(), "a range beyond the longest")
    _require(bool(np.abs(log.odometry[:, :2]).max(initial=0.0) <= 1e7), "odometry beyond any map")
    str(describe_log(log))
    return log


def _run(log: Any) -> None:
    from iceg import Config
    from iceg.pipeline import run

    if len(log) > 40:
        log = log.select(slice(0, 40))
    result = run(log, Config())
    steps = np.hypot(*np.diff(log.odometry[:, :2], axis=0).T).sum()
    farthest = 2.0 * steps + len(log) * log.geometry.range_max + np.hypot(*log.geometry.T_robot_laser[:2]) + 1.0
    _require(bool(np.isfinite(result.trajectory).all()), "a trajectory that is not finite")
    _require(bool(np.isfinite(result.covariances).all()), "a covariance that is not finite")
    away = np.hypot(*(result.trajectory - result.trajectory[0])[:, :2].T).max()
    _require(bool(away <= farthest), f"a position {away:g} m away, where odometry and ranges reach {farthest:g} m")
    _require(bool(np.isfinite(result.grid.log_odds).all()), "a grid that is not finite")


def _config(path: Path) -> Any:
    from iceg.config import format_config, parse_config, read_config

    config = read_config(path)
    _require(parse_config(format_config(config)) == config, "settings that do not read back")
    return config


def _experiment(path: Path) -> Any:
    from iceg.evaluation.bench.experiment import read_experiment

    return read_experiment(path)


def _scene(path: Path) -> Any:
    from frontends.simulator.scene import read_scene

    scene = read_scene(path)
    _require(bool(np.isfinite(scene.world.segments).all()), "a wall that is not finite")
    return scene


def _simulate(scene: Any) -> None:
    from frontends.simulator.simulation import simulate

    route = replace(scene.route, duration=min(scene.route.duration or 20.0, 20.0))
    simulation = simulate(replace(scene, route=route), 1)
    _require(bool(np.isfinite(simulation.truth).all()), "a truth that is not finite")
    _require(bool(np.isfinite(simulation.log.odometry).all()), "odometry that is not finite")


def _plan(path: Path) -> Any:
    from frontends.simulator.floor_plan import read_plan

    segments = read_plan(path, metres=0.05)
    _require(bool(np.isfinite(segments).all()), "a wall that is not finite")
    return segments


def _g2o(path: Path) -> Any:
    from graph.g2o import read_g2o

    graph = read_g2o(path)
    _require(bool(np.isfinite(graph.poses).all()), "a pose that is not finite")
    return graph


def _optimize(graph: Any) -> None:
    from graph.optimize_g2o import OptimizeOptions, format_report, optimize_g2o

    solved = optimize_g2o(
        graph, OptimizeOptions(kernel="given", kernel_width=5.0, gnc=False, pcm=False, incremental=False)
    )
    _require(bool(np.isfinite(solved.poses).all()), "a pose that is not finite")
    format_report(solved)


def _tum(path: Path) -> Any:
    from iceg.tum import format_tum, read_tum

    trajectory = read_tum(path)
    format_tum(trajectory.stamps, trajectory.poses)
    return trajectory


def _judged(name: str) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        from iceg.evaluation import judge

        reports = {
            "relations": judge.relations_csv_report,
            "reference": judge.reference_report,
            "truth": judge.truth_report,
        }
        report = reports[name](path.parent / "t.tum", path)
        _require(
            bool(np.isfinite([value for key, value in report.items() if "std" not in key]).all()), "a figure not finite"
        )
        return report

    return read


def _corrections(path: Path) -> Any:
    from iceg.corrections.reading import read_corrections

    corrections = read_corrections(path)
    corrections.check(8)
    return corrections


def _findings(path: Path) -> Any:
    from iceg.findings_file.codec import read_findings

    findings = read_findings(path)
    _require(bool(np.isfinite(findings.solution.poses).all()), "a pose not finite")
    return findings


def _conclude(findings: Any) -> None:
    from iceg.pipeline import resolve

    resolve(findings)


def _run_folder(path: Path) -> Any:
    from iceg.run_folder import read_run_folder

    read_run_folder(path.parent)
    return path.parent


def _draw(folder: Any) -> None:
    from iceg.show.run_plots import plot_results

    plot_results(folder)


def _draw_plan(folder: Any) -> None:
    from iceg.export.formats import export_results

    export_results(folder, "floorplan.svg")


def _beside_trajectory(folder: Path) -> None:
    (folder / "t.tum").write_text(seeds.trajectory())


def _beside_log(folder: Path) -> None:
    (folder / "x.clf").write_text(seeds.flaser_log(3))


def _folder_of_run(folder: Path) -> None:
    if not (folder / "r").exists():
        seeds.run_folder(folder / "r")


def _of_run_folder(name: str) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        seeds.run_folder(Path(folder) / "r")
        return (Path(folder) / "r" / name).read_bytes()


def _png() -> bytes:
    from PIL import Image

    pixels = np.full((12, 16), 255, dtype=np.uint8)
    pixels[2:4, 3:9] = 0
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def _logs() -> dict[str, Target]:
    texts = {
        "flaser": ("x.clf", (seeds.flaser_log(),)),
        "robotlaser": ("x.clf", (seeds.robotlaser_log(),)),
        "rawlaser": ("x.clf", (seeds.rawlaser_log(),)),
        "carmen": ("x.clf", (seeds.carmen_log(),)),
        "usarsim": ("x.usarsim", (seeds.usarsim_log(),)),
        "dpslam": ("x.log", (seeds.dpslam_log(),)),
        "player": ("x.log", (seeds.player_log(version=1), seeds.player_log(version=2))),
    }
    return {
        name: Target(
            file=file,
            seeds=tuple(text.encode() for text in given),
            read=_log,
            use=_run,
            words=("run", file, "-o", "out", "--overwrite"),
            goes_on=True,
        )
        for name, (file, given) in texts.items()
    }


def _packed_logs() -> dict[str, Target]:
    text = seeds.flaser_log().encode()
    info = ("info", "x.clf.packed")
    inside: dict[str, Callable[[bytes], bytes]] = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}
    return {
        f"flaser-{name}": Target(file="x.clf.packed", seeds=(text,), read=_log, packed=pack, words=info)
        for name, pack in inside.items()
    } | {
        f"damaged-{name}": Target(file="x.clf.packed", seeds=(pack(text),), read=_log, words=info)
        for name, pack in inside.items()
    }


def _run_folder_targets() -> dict[str, Target]:
    names = (
        "trajectory.tum",
        "covariances.csv",
        "closures.csv",
        "map.yaml",
        "map.pgm",
        "features.geojson",
        "summary.json",
    )
    return {
        f"folder-{name}": Target(
            file=f"r/{name}",
            seeds=(_of_run_folder(name),),
            read=_run_folder,
            use=_draw,
            prepare=_folder_of_run,
            words=("plot", "r"),
        )
        for name in names
    } | {
        "folder-walls.csv": Target(
            file="r/walls.csv",
            seeds=(_of_run_folder("walls.csv"),),
            read=_run_folder,
            use=_draw_plan,
            prepare=_folder_of_run,
            words=("export", "r", "--to", "floorplan.svg"),
        )
    }


def _others() -> dict[str, Target]:
    simulate = ("simulate", "x.world", "-o", "out", "--overwrite")
    return {
        "settings": Target(
            file="x.toml", seeds=(seeds.settings().encode(),), read=_config, words=("config", "--config", "x.toml")
        ),
        "experiment": Target(
            file="x.toml",
            seeds=(
                seeds.experiment(
                    'seeds = [0, 1]\ntime_limit_s = 60\n[sweep]\n"grid.resolution" = [0.05, 0.1]\n',
                    method='"ice", {method = "plicp", name = "p"}',
                ).encode(),
            ),
            read=_experiment,
            prepare=_beside_log,
            words=("bench", "x.toml", "-o", "out"),
        ),
        "world": Target(
            file="x.world",
            seeds=(seeds.world().encode(), seeds.rich_world().encode()),
            read=_scene,
            use=_simulate,
            words=simulate,
        ),
        "svg": Target(file="p.svg", seeds=(seeds.drawing().encode(),), read=_plan, words=()),
        "pgm": Target(file="p.pgm", seeds=(seeds.picture(), b"P5 4 2 255\n\0\1\xff\0\xff\0\0\0"), read=_plan, words=()),
        "png": Target(file="p.png", seeds=(_png(),), read=_plan, words=()),
        "g2o": Target(
            file="x.g2o",
            seeds=(seeds.g2o().encode(),),
            read=_g2o,
            use=_optimize,
            words=("optimize", "x.g2o", "-o", "y.g2o"),
        ),
        "tum": Target(file="t.tum", seeds=(seeds.trajectory().encode(),), read=_tum, words=()),
        "closures": Target(file="c.csv", seeds=(seeds.closures().encode(),), read=_corrections, words=()),
        "corrections": Target(file="c.toml", seeds=(seeds.corrections().encode(),), read=_corrections, words=()),
        "findings": Target(file="run.npz", seeds=(seeds.findings(),), read=_findings, use=_conclude, words=()),
    } | {
        name: Target(
            file="x.csv",
            seeds=tuple(text.encode() for text in texts),
            read=_judged(name),
            prepare=_beside_trajectory,
            words=("eval", "t.tum", f"--{name}", "x.csv"),
        )
        for name, texts in (
            ("relations", (seeds.relations(),)),
            ("reference", (seeds.reference(),)),
            ("truth", (seeds.truth(), seeds.trajectory(), seeds.euroc())),
        )
    }


def _converted(name: str) -> bytes:
    """The CARMEN log in another format."""
    import tempfile

    from frontends.logs import read_log
    from frontends.logs.writers import write_log

    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "x.clf"
        log.write_text(seeds.flaser_log())
        write_log(Path(folder) / name, read_log(log))
        return (Path(folder) / name).read_bytes()


def _bag_of(said: Iterable[bags.Said]) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return bags.write_bag(Path(folder), said).read_bytes()


def _clouds() -> bytes:
    level = [[math.cos(0.1 * k), math.sin(0.1 * k), 0.0] for k in range(20)]
    return _bag_of(bags.point_cloud(1.0 + k, [*level, [1.0, 0.0, 0.5]], rows=3) for k in range(3))


def _echoes() -> bytes:
    plain = (bags.scan(1.0 + k, [1.0, 2.0, 3.0, 4.0]) for k in range(3))
    return _bag_of(bags.multi_echo(said, [[1.0, 1.5], [], [3.0], [4.0]]) for said in plain)


def _bags_and_tables() -> dict[str, Target]:
    given = {name: _converted(f"x.{name}") for name in ("bag", "db3", "mcap", "npz", "csv")}
    files = {name: (f"x.{name}", content) for name, content in given.items()}
    files |= {"clouds": ("x.bag", _clouds()), "echoes": ("x.bag", _echoes())}
    return {
        name: Target(file=file, seeds=(seed,), read=_log, use=_run, words=("run", file, "-o", "out", "--overwrite"))
        for name, (file, seed) in files.items()
    }


TARGETS: dict[str, Target] = _logs() | _packed_logs() | _bags_and_tables() | _others() | _run_folder_targets()
"""By name."""

"""Worlds."""

from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.cases.case import LONG, Case, text_file
from tests.fuzz.seeds import world


def scenes() -> Iterator[Case]:
    """Worlds for `iceg simulate`."""

    def scene(name: str, *lines: str) -> Case:
        return Case(
            name=f"scene {name}", words=("simulate", "x.world", "-o", "out"), make=text_file("x.world", world(*lines))
        )

    for line in (
        "odometry slip_time=0",
        "odometry slip_time=-1",
        "odometry slip_std=1e300",
        "odometry drift_std=-1",
        "odometry translation_scale=1e200",
        "person 0 0 1 1 speed=1e308",
        "person 0 0 1e-300 0",
        "person 0 0 1 0 speed=1e-300",
        "arc 0 0 1 pieces=1e300",
        "arc 0 0 1 pieces=1e9",
        "arc 0 0 1e300",
        "arc 0 0 1 to=1e300",
        "laps 1e15",
        "goto 1 0 pause=1e12",
        "goto 1e300 0",
        "lasts 1e12",
        "laser period=1e300",
        "laser period=1e-300",
        "laser period=0",
        "laser range_std=1e300",
        "laser quantisation=1e-300",
        "laser beam_width=1e300",
        "laser sweep_time=1e300",
        "wall 0 0 1e308 1e308 thick=1e308",
        "box 0 0 1e308 1e308 turn=1e308",
        "table 0 0 1 1 leg=1e308",
        "wall 0 0 nan 1",
        f"wall 0 0 {LONG} 1",
        f"laps {LONG}",
        "include nowhere.world",
        "include .",
        "include x.world",
        "include d/../x.world",
        "plan /dev/zero",
        "plan x.world",
        "include /dev/zero",
        "wall 0 0 1 1 glass=2",
        "wall 0 0 0 0",
        "goto 5 0\nwall 3 -9 3 9",
    ):
        yield scene(line[:40], line)

    def includes(folder: Path) -> None:
        for k in range(39):
            (folder / f"w{k}.world").write_text(f"include w{k + 1}.world\n" * 3)
        (folder / "w39.world").write_text("wall 0 5 1 5\n")
        (folder / "x.world").write_text(world("include w0.world"))

    yield Case(name="scene 3^39 includes", words=("simulate", "x.world", "-o", "out"), make=includes)

    def includes_itself(folder: Path) -> None:
        (folder / "d").mkdir()
        (folder / "x.world").write_text(world("include d/../x.world"))

    yield Case(name="scene includes itself", words=("simulate", "x.world", "-o", "out"), make=includes_itself)

"""Logs of CARMEN, USARSim, DP-SLAM and Player."""

import bz2
import gzip
import lzma
import os
from collections.abc import Iterator

from tests.fuzz.cases.case import LONG, Case, text_file
from tests.fuzz.seeds import flaser, player_log, robotlaser, usarsim_log


def _log(name: str, *lines: str) -> Case:
    good = [flaser(k) for k in range(3)]
    text = "\n".join([*good, *lines, flaser(3)]) + "\n"
    return Case(name=f"log {name}", words=("run", "x.clf", "-o", "out"), make=text_file("x.clf", text))


def _only(name: str, content: str | bytes, file: str = "x.clf", command: str = "run") -> Case:
    words = (command, file, "-o", "out") if command != "info" else (command, file)
    return Case(name=f"log {name}", words=words, make=text_file(file, content))


def _replaced(old: str, new: str, n: int = 12) -> str:
    """A log with one part of each line changed."""
    return "".join(f"{robotlaser(k).replace(old, new)}\n" for k in range(n))


def logs() -> Iterator[Case]:
    """CARMEN, USARSim, DP-SLAM and Player."""
    for value in ("1e300", "-inf", "nan", "1e15", LONG):
        shown = value[:8]
        yield _log(f"odometry {shown}", flaser(3, x=value))
        yield _log(f"heading {shown}", flaser(3, heading=value))
        yield _log(f"stamp {shown}", flaser(3, stamp=value))
        yield _log(f"range {shown}", flaser(3, first=value))
        yield _log(f"count {shown}", f"FLASER {value} 1 2 3")
        yield _only(f"field of view {shown}", _replaced("3.124139", value))
        yield _only(f"start angle {shown}", _replaced("-1.570796", value))
        yield _only(f"resolution {shown}", _replaced(" 0.017453", f" {value}"))
        yield _only(f"maximum range {shown}", _replaced(" 81.91 ", f" {value} "))
        yield _only(
            f"PARAM offset {shown}",
            f"PARAM robot_frontlaser_offset {value} 0 h 0\n" + "\n".join(_raw(k) for k in range(8)) + "\n",
        )
        yield _only(f"usarsim pose {shown}", usarsim_log(x=value), "x.usarsim")
        yield _only(f"usarsim fov {shown}", usarsim_log(fov=value), "x.usarsim")
        yield _only(f"usarsim max range {shown}", usarsim_log(max_range=value), "x.usarsim")
        yield _only(f"usarsim mount {shown}", usarsim_log(mount=value), "x.usarsim")
        yield _only(f"player pose {shown}", player_log(x=value), "x.log")
        yield _only(f"player angle {shown}", player_log(angle=value), "x.log")
        yield _only(f"player count {shown}", player_log(count=value), "x.log")
        yield _only(f"dpslam pose {shown}", f"Odometry {value} 0 0\nLaser 3 1 2 3\n" * 4, "x.log")
        yield _only(f"dpslam count {shown}", f"Odometry 0 0 0\nLaser {value} 1 2 3\n" * 4, "x.log")
    yield _only(
        "equal bearings",
        _replaced("3.124139 0.017453", "1.8e-298 1e-300"),
    )
    yield _only("start angle 1e150", _replaced("-1.570796", "1e150"))
    yield _only("raw count of 5,000 digits", f"RAWLASER1 {LONG} 1 2 3 0 h 0\n")
    yield _only("jumps to and fro", "\n".join(flaser(k, x=str((-1) ** k * 9e6)) for k in range(9)) + "\n")
    yield _only(
        "one endless line, packed", gzip.compress(b"FLASER ") + gzip.compress(b"1 " * 1_000_000) * 200, "x.clf.gz"
    )
    yield _only("one endless line, bz2", bz2.compress(b"FLASER ") + bz2.compress(b"1" * 1_000_000) * 100, "x.clf.bz2")
    yield _only("one endless line, xz", lzma.compress(b"FLASER ") + lzma.compress(b"1" * 1_000_000) * 100, "x.clf.xz")
    yield _only(
        "endless blank lines", gzip.compress(flaser(0).encode()) + gzip.compress(b"\n" * 1_000_000) * 3000, "x.clf.gz"
    )
    yield _only(
        "endless comments",
        gzip.compress(f"{flaser(0)}\n".encode()) + gzip.compress(b"# \n" * 1_000_000) * 2000,
        "x.clf.gz",
    )
    yield _only("NUL bytes", b"FLASER\0" * 100 + b"\n")
    yield _only("half a gzip", gzip.compress((flaser(0) + "\n").encode() * 500)[:200], "x.clf.gz")
    yield _only("damaged gzip", gzip.compress((flaser(0) + "\n").encode() * 500)[:-30] + b"\0" * 30, "x.clf.gz")
    yield _only("UTF-16", (flaser(0) + "\n").encode("utf-16"))
    yield _only("100,000 beams once", flaser(0) + "\nFLASER 99999 " + "1 " * 99_999 + "0 0 0 0 0 0 0 h 0\n")
    yield Case(name="log /dev/zero", words=("info", "/dev/zero"), make=lambda _: None)
    yield Case(name="log is a pipe", words=("info", "pipe"), make=lambda folder: os.mkfifo(folder / "pipe"))
    yield Case(name="log is a folder", words=("info", "."), make=lambda _: None)
    yield Case(name="log of a name too long", words=("info", "n" * 300), make=lambda _: None)


def _raw(k: int) -> str:
    beams = " ".join(f"{2 + 0.01 * ((k + b) % 7):.2f}" for b in range(181))
    return f"ODOM {0.1 * k} 0 0 0 0 0 {k} h {k}\nRAWLASER1 181 {beams} {k} h {k}"

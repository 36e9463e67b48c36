"""Relations, references, truths, trajectories, pose graphs, closures by hand."""

from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.cases.case import LONG, Case, text_file
from tests.fuzz.seeds import flaser


def tables() -> Iterator[Case]:
    """Relations, references, truths, trajectories, pose graphs, closures by hand."""
    trajectory = "".join(f"{k} {0.1 * k} 0 0 0 0 0 1\n" for k in range(20))

    def against(option: str, name: str, text: str) -> Case:
        def make(folder: Path) -> None:
            (folder / "t.tum").write_text(trajectory)
            (folder / "x.csv").write_text(text)

        return Case(name=f"{option} {name}", words=("eval", "t.tum", f"--{option}", "x.csv"), make=make)

    relations, reference = "scan_i,scan_j,x_m,y_m,theta_rad,certain\n", "scan,x_m,y_m,theta_rad\n"
    truth = "t_s,x_m,y_m,theta_rad\n"
    for value in ("1e19", "1e300", "-1", "nan", "1e999", LONG, "0.5", "1e-320"):
        yield against("relations", f"scan {value[:6]}", f"{relations}0,{value},0,0,0,1\n")
        yield against("relations", f"pose {value[:6]}", f"{relations}0,1,{value},0,0,1\n")
        yield against("reference", f"scan {value[:6]}", f"{reference}0,0,0,0\n{value},0,0,0\n")
        yield against("truth", f"pose {value[:6]}", truth + "".join(f"{k},{value},0,0\n" for k in range(20)))
    yield against("relations", "a field of a megabyte", relations + '"' + "1" * 1_000_000 + '"\n')
    yield against("relations", "a NUL", relations + "0,\0,0,0,0,1\n")

    def tum(name: str, text: str) -> Case:
        def make(folder: Path) -> None:
            (folder / "t.tum").write_text(text)
            (folder / "x.csv").write_text(truth + "".join(f"{k},0,0,0\n" for k in range(20)))

        return Case(name=f"trajectory {name}", words=("eval", "t.tum", "--truth", "x.csv"), make=make)

    yield tum("at 1e300", trajectory.replace("0.1 0", "1e300 0"))
    yield tum("with a quaternion of 1e300", trajectory.replace("0 0 0 1\n", "0 0 0 1e300\n"))
    yield tum("with a quaternion of 0", trajectory.replace("0 0 0 1\n", "0 0 0 0\n"))
    yield tum("of 5,000 digits", trajectory.replace("0.1", LONG))
    yield tum("too short", trajectory[:40])

    def g2o(name: str, text: str, *flags: str) -> Case:
        words = ("optimize", "x.g2o", "-o", "out.g2o", *flags)
        return Case(name=f"g2o {name}", words=words, make=text_file("x.g2o", text))

    vertices = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(4))
    edges = "".join(f"EDGE_SE2 {k} {k + 1} 1 0 0 100 0 0 100 0 100\n" for k in range(3))
    for name, edge in {
        "information 1e200 beside 1e-200": "EDGE_SE2 0 3 3 0 0 1e200 0 0 1e-200 0 1",
        "information 1e300": "EDGE_SE2 0 3 3 0 0 1e300 0 0 1e300 0 1e300",
        "information 1e-300": "EDGE_SE2 0 3 3 0 0 1e-300 0 0 1e-300 0 1e-300",
        "information 0": "EDGE_SE2 0 3 3 0 0 0 0 0 0 0 0",
        "pose 1e300": "EDGE_SE2 0 3 1e300 0 0 1 0 0 1 0 1",
        "id of 5,000 digits": f"EDGE_SE2 0 {LONG} 3 0 0 1 0 0 1 0 1",
        "edge to itself": "EDGE_SE2 0 0 3 0 0 1 0 0 1 0 1",
        "kernel width 1e300": "EDGE_SE2 0 3 3 0 0 1 0 0 1 0 1 # closure dcs 1e300",
        "kernel width 0": "EDGE_SE2 0 3 3 0 0 1 0 0 1 0 1 # closure dcs 0",
        "kernel width 1e-300": "EDGE_SE2 0 3 3 0 0 1 0 0 1 0 1 # closure huber 1e-300",
        "heading 1e300": "EDGE_SE2 0 3 3 0 1e300 1 0 0 1 0 1",
    }.items():
        yield g2o(name, f"{vertices}{edges}{edge}\n")
    yield g2o("vertex at 1e300", vertices.replace("1 0 0", "1e300 0 0") + edges)
    yield g2o("FIX of 5,000 digits", f"{vertices}{edges}FIX {LONG}\n")
    yield g2o("pcm of far edges", vertices + edges + "EDGE_SE2 0 3 9e6 9e6 3 1e9 0 0 1e9 0 1e9\n" * 2, "--pcm")
    yield g2o("gnc of far edges", vertices + edges + "EDGE_SE2 0 3 9e6 9e6 3 1e9 0 0 1e9 0 1e9\n" * 2, "--gnc")
    for text in ("/dev/zero", "."):
        yield Case(name=f"g2o {text}", words=("optimize", text, "-o", "out.g2o"), make=lambda _: None)
    closures = "scan_i,scan_j,x_m,y_m,theta_rad,sigma_m,sigma_rad\n"
    for row in ("0,1e300,0,0,0,1,1", "0,5,1e300,0,0,1,1", "0,5,0,0,0,1e300,1", "0,5,0,0,0,1e-300,1", "0,99,0,0,0,1,1"):

        def make(folder: Path, row: str = row) -> None:
            (folder / "x.clf").write_text("\n".join(flaser(k) for k in range(8)) + "\n")
            (folder / "c.csv").write_text(f"{closures}{row}\n")

        words = ("run", "x.clf", "-o", "out", "--closures", "c.csv")
        yield Case(name=f"closure by hand {row}", words=words, make=make)

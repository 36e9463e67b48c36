"""Folders of runs."""

from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.cases.case import LONG, Case
from tests.fuzz.seeds import run_folder


def folders() -> Iterator[Case]:
    """Run folders for `iceg plot`."""

    def damaged(name: str, file: str, content: str | bytes) -> Case:
        def make(folder: Path) -> None:
            run_folder(folder / "r")
            (folder / "r" / file).write_bytes(content.encode() if isinstance(content, str) else content)

        return Case(name=f"folder {name}", words=("plot", "r"), make=make)

    for value in ("0", "-1", "nan", "1e-300", "1e300", "inf", LONG):
        yield damaged(
            f"resolution {value[:6]}", "map.yaml", f"image: map.pgm\nresolution: {value}\norigin: [0, 0, 0]\n"
        )
    for value in ("[1]", "[inf, 0, 0]", "[1e300, 0, 0]", "[1e6, 1e6, 0]", "[", ""):
        yield damaged(f"origin {value}", "map.yaml", f"image: map.pgm\nresolution: 0.05\norigin: {value}\n")
    for value in ("/dev/zero", "..", "map.yaml"):
        yield damaged(f"image {value}", "map.yaml", f"image: {value}\nresolution: 0.05\norigin: [0, 0, 0]\n")
    yield damaged("0x0 PGM", "map.pgm", b"P5\n0 0\n255\n")
    yield damaged("PGM of 5,000 digits", "map.pgm", b"P5\n" + LONG.encode() + b" 1\n255\n\0")
    feature = (
        '{"features": [{"id": %s, "geometry": {"coordinates": [%s, 0]}, "properties": {"kind": "corner", "directions": '
        '[0, 1], "direction_variances": [1, 1], "covariance": [[1, 0], [0, 1]], "anchor": 0, "first_seen": 0, '
        '"last_seen": 0, "seen": 9, "missed": 0, "expired_at": null}}]}'
    )
    for name, numbers in {
        "id 10^30": ("1" + "0" * 30, "0"),
        "id of 5,000 digits": (LONG, "0"),
        "at 1e300": ("1", "1e300"),
        "at infinity": ("1", "Infinity"),
        "at 1e6": ("1", "1e6"),
    }.items():
        yield damaged(f"GeoJSON {name}", "features.geojson", feature % numbers)
    yield damaged("GeoJSON nested 100,000 deep", "features.geojson", '{"features": ' + "[" * 100_000)
    yield damaged("GeoJSON of a list", "features.geojson", "[]")
    yield damaged("GeoJSON of nulls", "features.geojson", '{"features": [null]}')
    yield damaged("summary nested 100,000 deep", "summary.json", "[" * 100_000)
    head = "scan_i,scan_j,x_m,y_m,theta_rad,score,inliers,overlap,verdict,reason\n"
    for row in ("0,999,0,0,0,1,1,1,accepted,x", f"0,{LONG},0,0,0,1,1,1,accepted,x", "0,1,nan,0,0,1,1,1,accepted,x"):
        yield damaged(f"closure {row[:20]}", "closures.csv", f"{head}{row}\n")
    yield damaged("trajectory too short", "trajectory.tum", "0 0 0 0 0 0 0 1\n")
    yield damaged("trajectory at 1e6 m", "trajectory.tum", "".join(f"{k} {k * 3e5} 0 0 0 0 0 1\n" for k in range(6)))
    yield damaged("trajectory at 1e300 m", "trajectory.tum", "".join(f"{k} {k}e300 0 0 0 0 0 1\n" for k in range(6)))
    covariances = "scan,x_m,y_m,theta_rad,xx,xy,xtheta,yy,ytheta,thetatheta\n"
    for row in (
        "1e300,0,0,0,1,0,0,1,0,1",
        "-1,0,0,0,1,0,0,1,0,1",
        "0,0,0,0,1e300,0,0,1e300,0,1",
        "0,0,0,0,-1,0,0,-1,0,-1",
    ):
        yield damaged(f"covariance {row[:14]}", "covariances.csv", f"{covariances}0,0,0,0,1,0,0,1,0,1\n{row}\n")
    walls = "x1_m,y1_m,x2_m,y2_m,points,deviation_m,key_poses\n"
    for row in ("0,0,1e300,0,9,0,9", "0,0,1,0,-9,0,9", "0,0,1,0,0.5,0,9", "0,0,1,0,9,nan,9", f"0,0,1,0,{LONG},0,9"):
        yield damaged(f"wall {row[:20]}", "walls.csv", f"{walls}{row}\n")

"""Small sound inputs of every kind that the command line takes."""

import math
from pathlib import Path

import numpy as np


def ranges(k: int, n: int = 180) -> list[str]:
    """Readings of a room of 8 m by 6 m from 0.1 k m ahead of its middle [m]."""
    x, found = 0.1 * k, []
    for beam in range(n):
        angle = -math.pi / 2 + beam * math.pi / 180
        c, s = math.cos(angle), math.sin(angle)
        along = ((4 - x) if c > 0 else (4 + x)) / max(abs(c), 1e-9)
        found.append(f"{min(along, 3 / max(abs(s), 1e-9)):.2f}")
    return found


def flaser(
    k: int, *, x: str | None = None, heading: str = "0", stamp: str | None = None, first: str | None = None
) -> str:
    """One line of the classic CARMEN message, some of its fields replaced."""
    readings = ranges(k)
    readings[0] = first or readings[0]
    x = x or f"{0.1 * k:.3f}"
    pose = f"{x} 0.0 {heading}"
    return f"FLASER 180 {' '.join(readings)} {pose} {pose} {stamp or 0.2 * k} host {0.2 * k}"


def robotlaser(k: int) -> str:
    """One line of the newer CARMEN message."""
    pose = f"{0.1 * k:.3f} 0.0 0.0"
    head = "0 -1.570796 3.124139 0.017453 81.91 0.01 0"
    return f"ROBOTLASER1 {head} 180 {' '.join(ranges(k))} 0 {pose} {pose} 0 0 0.3 0.3 1e6 {0.2 * k} host {0.2 * k}"


def odom(k: int) -> str:
    """One line of odometry."""
    return f"ODOM {0.1 * k:.3f} 0.0 0.0 0.5 0.0 0.0 {0.2 * k} host {0.2 * k}"


def rawlaser(k: int) -> str:
    """One line of the message without poses."""
    head = "0 -1.570796 3.124139 0.017453 81.91 0.01 0"
    return f"RAWLASER1 {head} 180 {' '.join(ranges(k))} 0 {0.2 * k} host {0.2 * k}"


def usarsim_log(
    n: int = 8, x: str | None = None, fov: str = "3.1241", max_range: str = "20.0", mount: str = "0.1"
) -> str:
    """A USARSim log, some of its fields replaced."""
    name = "{Type RangeScanner} {Name Scanner1}"
    lines = [
        f"CONF {name} {{MaxRange {max_range}}} {{MinRange 0.1}} {{Resolution 0.0174}} {{Fov {fov}}}",
        f"GEO {name} {{Location {mount},0.0,0.0}} {{Orientation 0.0,0.0,0.0}} {{Mount HARD}}",
    ]
    for k in range(n):
        place = x if x is not None and k == 3 else f"{0.1 * k:.3f}"
        lines.append(f"SEN {{Time {0.2 * k:.1f}}} {{Type Odometry}} {{Name Odometry}} {{Pose {place},0.0,0.0}}")
        lines.append(
            f"SEN {{Time {0.2 * k:.1f}}} {{Type GroundTruth}} {{Name GroundTruth}} {{Location {0.1 * k:.3f},0.0,0.0}} "
            "{Orientation 0.0,0.0,0.0}"
        )
        lines.append(
            f"SEN {{Time {0.2 * k:.1f}}} {name} {{Resolution 0.0174}} {{FOV {fov}}} {{Range {','.join(ranges(k))}}}"
        )
    return "\n".join(lines) + "\n"


def player_log(*, version: int = 2, x: str | None = None, angle: str = "-1.5708", count: str = "0180") -> str:
    """A log of Player 1 or 2, some of its fields replaced."""
    lines = [f"## Player version {version}.1.0 "]
    if version > 1:
        lines.append("0000000000.000 16777343 6665 laser 00 004 001  +0.030  +0.000   0.000   0.140   0.140")
    for k in range(8):
        time = f"{0.2 * k:014.3f}"
        place = x if x is not None and k == 3 else f"{0.1 * k:+07.3f}"
        readings = "".join(f"{reading}  0 " for reading in ranges(k))
        heads = {
            1: (f"{time} host 6665 position 00 {time}", f"{time} host 6665 laser 00 {time}", "", ""),
            2: (
                f"{time} 16777343 6665 position2d 00 001 001",
                f"{time} 16777343 6665 laser 00 001 001",
                f" {k:04d}",
                " +80.0000",
            ),
        }
        position, laser, number, longest = heads[version]
        lines.append(f"{position} {place} +00.000 +0.000 +00.100 +00.000 +00.000 0")
        lines.append(f"{laser}{number} {angle} +1.5533 +0.01745329{longest} {count} {readings}")
    return "\n".join(lines) + "\n"


def carmen_log(n: int = 8) -> str:
    """A CARMEN log of all kinds of messages."""
    lines = ["# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp"]
    lines += ["PARAM robot_frontlaser_offset 0.1 0 host 0", "PARAM laser_front_laser_resolution 1.0 0 host 0"]
    for k in range(n):
        lines += [odom(k), flaser(k), robotlaser(k), rawlaser(k), f"SYNC tag {0.2 * k} host {0.2 * k}"]
    return "\n".join(lines) + "\n"


def flaser_log(n: int = 8) -> str:
    """A CARMEN log of one kind of message."""
    return "\n".join(flaser(k) for k in range(n)) + "\n"


def robotlaser_log(n: int = 8) -> str:
    """A CARMEN log whose laser describes itself."""
    return "\n".join(robotlaser(k) for k in range(n)) + "\n"


def rawlaser_log(n: int = 8) -> str:
    """A CARMEN log whose odometry stands on lines of its own."""
    return "\n".join(f"{odom(k)}\n{rawlaser(k)}" for k in range(n)) + "\n"


def dpslam_log(n: int = 8) -> str:
    """A DP-SLAM log."""
    return "".join(f"Odometry {0.1 * k:.3f} 0.0 0.0\nLaser 180 {' '.join(ranges(k))}\n" for k in range(n))


def world(*lines: str) -> str:
    """A small world, and more lines."""
    own = ["wall -2 -2 4 -2 4 2 -2 2 -2 -2 thick=0.1", "box 1 1 0.5 0.5 turn=30", "start 0 0 0", "goto 0.6 0"]
    return "\n".join([*own, *lines]) + "\n"


def rich_world() -> str:
    """A small world with a bit of everything."""
    return world(
        "table 2 -1 1 0.5 turn=20 leg=0.05",
        "arc 3 1 0.3 from=0 to=360 pieces=8",
        "person -1 1 1 1.5 speed=1.1 appears=0.2",
        "wall 0 1.8 1 1.8 glass=0.5 dark=0.1 vanishes=2",
        "laser range_std=0.01 mixed_share=0.1 period=0.2",
        "odometry drift_std=0.2 slip_std=0.01 slip_time=1",
        "goto 0.5 0.4 pause=0.2",
        "laps 1",
        "lasts 4",
    )


def drawing() -> str:
    """A drawing of every element that is read."""
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10" height="10">\n'
        '<g transform="translate(1,2) rotate(30) scale(1.5)">\n<line x1="0" y1="0" x2="5" y2="5"/>\n'
        '<polyline points="0,0 1,1 2,0"/>\n<rect x="1" y="1" width="3" height="2"/>\n'
        '<circle cx="5" cy="5" r="2"/>\n</g>\n'
        '<ellipse cx="5" cy="5" rx="2" ry="1"/>\n'
        '<path d="M0 0L1 1H2V3C1 2 3 4 5 5S6 6 7 7Q1 1 2 2T4 4A1 2 30 0 1 5 5Z"/>\n'
        '<g transform="matrix(1 0 0 1 0 0) skewX(10) skewY(5)"><polygon id="p" points="0 0 1 0 1 1"/></g>\n'
        '<use href="#p" x="1mm"/><symbol id="s" viewBox="0 0 2 2"><line x2="50%"/></symbol><use href="#s"/>\n</svg>\n'
    )


def picture() -> bytes:
    """A plan as text."""
    return b"P2\n# plan\n6 4\n255\n" + b"0 0 0 0 0 0\n0 255 255 255 255 0\n0 255 9 255 255 0\n0 0 0 0 0 0\n"


def g2o() -> str:
    """A pose graph with all kinds of lines."""
    vertices = "".join(f"VERTEX_SE2 {k} {0.9 * k} 0.1 0.05\n" for k in range(5))
    edges = "".join(f"EDGE_SE2 {k} {k + 1} 1 0 0.1 100 1 2 100 3 400 # odometry\n" for k in range(4))
    prior, closure = "EDGE_PRIOR_SE2 0 0 0 0 1e6 0 0 1e6 0 1e6", "EDGE_SE2 0 4 4 0 0.4 50 0 0 50 0 90 # closure dcs 1.0"
    return f"{vertices}FIX 0\n{prior}\n{edges}{closure}\n"


def trajectory(n: int = 8) -> str:
    """A trajectory."""
    return "# t x y z qx qy qz qw\n" + "".join(f"{0.2 * k} {0.1 * k} 0.0 0 0 0 0.1 0.995\n" for k in range(n))


def relations() -> str:
    """Relations by scan."""
    rows = "".join(f"{k},{k + 2},0.2,0.0,0.0,1\n" for k in range(5))
    return f"scan_i,scan_j,x_m,y_m,theta_rad,certain\n{rows}"


def reference() -> str:
    """Reference poses."""
    return "scan,x_m,y_m,theta_rad\n" + "".join(f"{k},{0.1 * k},0.0,0.0\n" for k in range(0, 8, 2))


def truth(n: int = 8) -> str:
    """The true pose of every scan."""
    return "t_s,x_m,y_m,theta_rad\n" + "".join(f"{0.2 * k},{0.1 * k},0.0,0.0\n" for k in range(n))


def euroc(n: int = 8) -> str:
    """The same as a EuRoC table."""
    header = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    return header + "".join(f"{200_000_000 * k},{0.1 * k},0.0,0.0,1.0,0.0,0.0,0.0\n" for k in range(n))


def corrections() -> str:
    """`corrections.toml` with a little of everything."""
    return (
        "[[forbid]]\nscans = [0, 5]\n[[forbid]]\nbetween = [[0, 2], [5, 7]]\n"
        "[[add]]\nscans = [1, 6]\npose = [0.5, -0.25, 0.1]\nsigma_m = 0.2\npin = true\n"
        "[[pin]]\nscans = [2, 7]\n[[distrust]]\nscans = [3, 4]\nfactor = 5.0\n"
        "[cut]\nkeep = [[0, 7]]\n[map]\nupright = true\nturn_degrees = 90\norigin = [1.0, 2.0]\n"
    )


def closures() -> str:
    """Closures by hand."""
    return "scan_i,scan_j,x_m,y_m,theta_rad,sigma_m,sigma_rad\n0,7,0.7,0.0,0.0,0.1,0.05\n1,6,0.5,0.0,0.0,0.1,0.05\n"


def experiment(more: str = "", *, log: str = "x.clf", method: str = '"ice"', before: bool = False) -> str:
    """An experiment, and more lines before or behind it."""
    own = f'methods = [{method}]\nlogs = ["{log}"]\n'
    return more + own if before else own + more


def settings() -> str:
    """Settings of several stages."""
    return (
        'seed = 3\nmatcher = "ice"\n[log]\nrange_max = 20.0\n[grid]\nresolution = 0.1\nmax_range = 15.0\n'
        'mode = "binary"\n'
        "[ice.segments]\ngap = 0.3\nmin_points = 3\n[ice.local_map]\ncell = 0.1\nreach = 25.0\n[loops]\nradius = 3.0\n"
        "support_offsets = [-2, 0, 2]\n[finish]\nrounds = 1\n[finish.joint]\nsteps = 2\n"
        "[front_end.key_scans]\nwindow = 9\n"
    )


def run_folder(folder: Path, n: int = 6) -> None:
    """The files of a run that `iceg plot` and `iceg export` read."""
    folder.mkdir()
    (folder / "trajectory.tum").write_text(trajectory(n))
    head = "scan,x_m,y_m,theta_rad,xx,xy,xtheta,yy,ytheta,thetatheta\n"
    rows = "".join(f"{k},{0.1 * k},0,0,1e-4,0,0,1e-4,0,1e-5\n" for k in range(0, n, 2))
    (folder / "covariances.csv").write_text(head + rows)
    head = "scan_i,scan_j,x_m,y_m,theta_rad,score,inliers,overlap,verdict,reason\n"
    (folder / "closures.csv").write_text(f"{head}0,4,0.4,0,0,0.9,100,0.8,accepted,\n")
    walls = "".join(f"{x},0,{x + 0.4:.1f},0,90,0.005,7\n0,{x},0,{x + 0.4:.1f},90,0.005,7\n" for x in (0.1, 0.5, 0.9))
    (folder / "walls.csv").write_text("x1_m,y1_m,x2_m,y2_m,points,deviation_m,key_poses\n" + walls)
    (folder / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\norigin: [-1, -1, 0]\n")
    (folder / "map.pgm").write_bytes(b"P5\n40 40\n255\n" + bytes([0, 254, 205, 254] * 400))
    (folder / "features.geojson").write_text(
        '{"features": [\n{"id": 1, "geometry": {"coordinates": [1.0, 0.5]}, "properties": {"kind": "corner", '
        '"directions": [0.0, 1.5], "direction_variances": [0.01, 0.01], "covariance": [[0.01, 0], [0, 0.01]], '
        '"anchor": 0, "first_seen": 0, "last_seen": 4, "seen": 4, "missed": 0, "expired_at": null}}\n]}\n'
    )
    (folder / "summary.json").write_text('{"method": "ice"}\n')


def findings() -> bytes:
    """What a run has found in a few scans of a room."""
    import tempfile

    from frontends.scan import Log
    from graph.factors import Factor, RobustKernel
    from graph.measurement import NoMatch, RelativePose
    from graph.odometry import OdometryModel, OdometryMotion
    from iceg.config import Config
    from iceg.findings_file.codec import write_findings
    from iceg.slam.closures.attempt import Attempt, Place
    from iceg.slam.findings import Findings
    from iceg.slam.kept_scans import KeptScans
    from iceg.slam.odometry.calibration import OdometryCalibration
    from iceg.slam.odometry.gyro import GyroFinding
    from iceg.slam.solution import Solution
    from iceg.slam.track import KeyScan, Track

    n, poses = 6, np.array([[0.2 * k, 0.0, 0.0] for k in range(6)])
    beside = 1.0 / np.maximum(np.abs(np.sin(np.linspace(-1.5, 1.5, 37))), 0.1)
    log = Log.from_arrays(np.tile(beside.round(2), (n, 1)), field_of_view=3.0, odometry=poses, stamps=np.arange(n))
    sure = np.diag([1e-4, 1e-4, 1e-5])
    step = RelativePose(
        T_ref_cur=np.array([0.4, 0.0, 0.0]),
        covariance=sure,
        score=0.9,
        inliers=30,
        overlap=0.8,
        weak_directions=np.array([[1.0, 0.0, 0.0]]),
    )
    motion = OdometryMotion(T_key_robot=step.T_ref_cur, covariance=sure, distance=0.4)
    keys = [
        KeyScan(
            index=2 * k,
            scan=log.scan(2 * k),
            motion=motion,
            match=step if k else NoMatch(reason="the first"),
            anchor=max(0, k - 1),
            T_track_robot=poses[2 * k],
        )
        for k in range(3)
    ]
    track = Track(keys=keys, key_of_scan=np.arange(n) // 2, T_key_scan=np.tile(poses[:2], (3, 1)), failures=1, lost=[2])
    attempt = Attempt(
        key_old=0,
        key_new=2,
        match=step,
        accepted=True,
        reason="fits",
        places=(Place(T_old_new=step.T_ref_cur, misfit=0.1),),
    )
    factors = [
        Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=sure),
        Factor(kind="odometry", i=0, j=1, T_i_j=step.T_ref_cur, covariance=sure),
        Factor(kind="ice", i=1, j=2, T_i_j=step.T_ref_cur, covariance=sure),
        Factor(kind="closure", i=0, j=2, T_i_j=poses[4], covariance=sure, kernel=RobustKernel(name="dcs", width=5.0)),
    ]
    solution = Solution(
        factors=factors,
        poses=poses[::2],
        attempts=[attempt],
        searchable=np.ones(3, dtype=np.bool_),
    )
    found = Findings(
        log=log,
        kept=KeptScans.all_of(n),
        config=Config(),
        has_own_stages=False,
        laser=None,
        sweep={"source": "nothing", "applied": False},
        gyro=GyroFinding(rejection="they are all zero"),
        track=track,
        calibration=OdometryCalibration(noise=OdometryModel()),
        solution=solution,
    )
    with tempfile.TemporaryDirectory() as folder:
        write_findings(Path(folder) / "run.npz", found)
        return (Path(folder) / "run.npz").read_bytes()

"""Findings to a file and back: arrays, and one piece of JSON for what is none."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from frontends.laser_noise import LaserNoise
from graph.errors import IcegError
from graph.odometry import OdometryModel
from iceg.config import Config, format_config, parse_config
from iceg.findings_file.archive import read_arrays, write_arrays
from iceg.findings_file.errors import FindingsError
from iceg.findings_file.log_arrays import log_arrays, log_facts, log_of
from iceg.findings_file.solution_arrays import solution_arrays, solution_facts, solution_of
from iceg.findings_file.table import Table
from iceg.findings_file.track_arrays import track_arrays, track_facts, track_of
from iceg.slam.findings import Findings
from iceg.slam.finish import Round
from iceg.slam.kept_scans import KeptScans
from iceg.slam.odometry.calibration import OdometryCalibration
from iceg.slam.odometry.gyro import GyroFinding

VERSION = 7
"""Of the file; it changes with what is in it."""
_WHAT = "the findings of a run"


def write_findings(path: Path, findings: Findings) -> None:
    """Write what a run has found; the same findings give the same bytes."""
    track, solution = findings.track, findings.solution
    facts = {
        "version": VERSION,
        "config": format_config(findings.config),
        "is_own_matcher": findings.has_own_stages,
        "kept": findings.kept.record(),
        "laser": None if findings.laser is None else asdict(findings.laser),
        "sweep": findings.sweep,
        "gyro": None if findings.gyro is None else asdict(findings.gyro),
        "calibration": asdict(findings.calibration),
        "log": log_facts(findings.log),
        "track": track_facts(track),
        "solution": solution_facts(solution),
        # Seconds are those of the run, not of what is concluded from it anew.
        "rounds": [{**asdict(done), "seconds": 0.0} for done in findings.rounds],
    }
    text = json.dumps(facts, ensure_ascii=False, sort_keys=True).encode()
    arrays = {
        "facts": np.frombuffer(text, dtype=np.uint8),
        **log_arrays(findings.log),
        **track_arrays(track),
        **solution_arrays(solution),
    }
    write_arrays(path, arrays)


def read_findings(path: Path) -> Findings:
    """Read back what a run has found.

    Raises:
        FindingsError: the file cannot be read, is of another version or holds what cannot be.
    """
    table = Table(path, read_arrays(path, _WHAT))
    try:
        facts = json.loads(table.bytes("facts"))
        if not isinstance(facts, dict) or facts.get("version") != VERSION:
            found = facts.get("version") if isinstance(facts, dict) else facts
            raise table.error(
                f"found version {str(found)[:40]}, expected {VERSION}: run the log again with this version of iceg"
            )
        return _findings(table, facts)
    except FindingsError:
        raise
    except (IcegError, ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as err:
        said = f"it lacks {err}" if isinstance(err, KeyError) else str(err)
        raise table.error(" ".join(said.split())[:300]) from err


def _findings(table: Table, facts: Mapping[str, Any]) -> Findings:
    config = _config(table, str(facts["config"]))
    log = log_of(table, facts["log"])
    track = track_of(table, facts["track"], log)
    return Findings(
        log=log,
        kept=_kept(table, facts["kept"], len(log)),
        config=config,
        has_own_stages=facts["is_own_matcher"] is not False,
        laser=None if facts["laser"] is None else LaserNoise(**_numbers(facts["laser"])),
        sweep=dict(facts["sweep"]),
        gyro=None if facts["gyro"] is None else _gyro(facts["gyro"]),
        track=track,
        calibration=_calibration(facts["calibration"]),
        solution=solution_of(table, facts["solution"], len(track.keys)),
        rounds=tuple(Round(**done) for done in facts["rounds"]),
    )


def _config(table: Table, text: str) -> Config:
    try:
        return parse_config(text, where="its settings")
    except IcegError as err:
        raise table.error(
            f"{err}; if another version of iceg has written them, run the log again with this one"
        ) from err


def _kept(table: Table, found: Mapping[str, Any], n_scans: int) -> KeptScans:
    kept = KeptScans.from_record(dict(found))
    if sum(last - first + 1 for first, last in kept.intervals) != n_scans:
        raise table.error(f"it says to hold the scans {str(kept.intervals)[:80]}, and holds {n_scans}")
    return kept


def _calibration(found: Mapping[str, Any]) -> OdometryCalibration:
    x, y, heading = map(float, found["T_odometry_laser"])
    apart = ("noise", "lasting_noise", "T_odometry_laser", "laser_deviations")
    ahead, aside = map(float, found["laser_deviations"])
    return OdometryCalibration(
        **_numbers({name: value for name, value in found.items() if name not in apart}),
        noise=OdometryModel(**_numbers(found["noise"])),
        lasting_noise=OdometryModel(**_numbers(found["lasting_noise"])),
        T_odometry_laser=(x, y, heading),
        laser_deviations=(ahead, aside),
    )


def _gyro(found: Mapping[str, Any]) -> GyroFinding:
    x, y, z = map(float, found["scale"])
    others = {name: value for name, value in found.items() if name not in ("rejection", "scale", "has_times")}
    return GyroFinding(
        **_numbers(others), rejection=str(found["rejection"]), scale=(x, y, z), has_times=found["has_times"] is True
    )


def _numbers(found: Mapping[str, Any]) -> dict[str, Any]:
    return {str(name): float(value) for name, value in found.items()}

"""A run as viewers of recordings replay it: everything it has found, on a clock that does not step back."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.g2o import G2oGraph, read_g2o
from iceg.export.options import ExportError, ExportOptions
from iceg.export.recorded_log import kept_scans, read_log_of_run
from iceg.ice.features import KIND_NAMES
from iceg.results import FINDINGS, read_summary, whole_results
from iceg.run_folder import RunFolder, read_run_folder
from iceg.stamps import repaired_stamps


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """What a viewer shows.

    Attributes:
        found: the files of the run.
        graph: its key poses and factors.
        stamps: (n,) of the scans [s], increasing, none negative.
        log: the scans, None where neither a log was given nor the run has kept its own.
    """

    found: RunFolder
    graph: G2oGraph
    stamps: NDArray[np.float64]
    log: Log | None

    @property
    def poses(self) -> NDArray[np.float64]:
        """(n, 3) T_map_robot of each scan."""
        return self.found.trajectory.poses

    @property
    def key_stamps(self) -> NDArray[np.float64]:
        """(k,) [s]."""
        return self.stamps[self.found.key_scans]

    def deviations(self) -> NDArray[np.float64]:
        """(k, 3) standard deviations of the key poses: along and across the heading [m], and of the heading [rad]."""
        return np.sqrt(np.diagonal(self.found.covariances, axis1=1, axis2=2))

    def edges(self) -> dict[str, NDArray[np.float64]]:
        """(m, 2, 2) ends of the factors between key poses [m], by their kind."""
        found: dict[str, list[tuple[int, int]]] = {}
        for factor in self.graph.factors:
            if factor.i is not None:
                found.setdefault(factor.kind, []).append((factor.i, factor.j))
        return {kind: self.found.key_poses[np.array(pairs), :2] for kind, pairs in sorted(found.items())}

    def closures(self) -> dict[str, NDArray[np.float64]]:
        """(m, 2, 2) positions of both scans of the loop closures [m], by verdict."""
        found: dict[str, list[tuple[int, int]]] = {}
        for closure in self.found.closures:
            found.setdefault(closure.verdict, []).append((closure.scan_i, closure.scan_j))
        return {verdict: self.poses[np.array(pairs), :2] for verdict, pairs in sorted(found.items())}

    def landmarks(self) -> dict[str, NDArray[np.float64]]:
        """(m, 2) positions of the settled landmarks [m], by kind."""
        settled = self.found.landmarks.settled()
        return {name: settled.positions[settled.kinds == kind] for kind, name in enumerate(KIND_NAMES)}


def read_recorded_run(directory: Path, options: ExportOptions) -> RecordedRun:
    """Read a run, with the log that is given, else the scans that the run has kept in its folder.

    Raises:
        IcegError: a file cannot be read, or the log is not the one that was run.
    """
    found = read_run_folder(directory)
    with whole_results(directory):
        graph = read_g2o(directory / "graph.g2o")
    log = _kept_log(directory) if options.log is None else read_log_of_run(directory, options.log)
    if log is not None and len(log) != len(found.trajectory):
        raise ExportError(
            f"{directory / FINDINGS}: holds {len(log)} scans, the trajectory {len(found.trajectory)}; expected the "
            "files of one run"
        )
    stamps = repaired_stamps(found.trajectory.stamps)
    return RecordedRun(
        found=found,
        graph=graph,
        stamps=stamps - min(0.0, float(stamps.min())),
        log=log,
    )


def holds_scans(directory: Path) -> bool:
    """Whether a run has kept its scans."""
    return (directory / FINDINGS).exists()


def _kept_log(directory: Path) -> Log | None:
    if not holds_scans(directory):
        return None
    from iceg.findings_file.codec import read_findings

    with whole_results(directory):
        findings, kept = read_findings(directory / FINDINGS), kept_scans(read_summary(directory))
    if kept is None:
        return findings.log
    return findings.log.select(np.searchsorted(findings.kept.indices, kept.indices))  # a resolved run cuts more

"""What a run has found, for fewer scans: what others have measured is gone, what was learned from them stays."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graph.batch import optimize
from graph.dense import congruence
from graph.factors import Factor
from graph.measurement import RelativePose
from graph.se2 import adjoint, between, compose, inverse
from iceg.corrections.corrections import CorrectionsError
from iceg.slam.closures.attempt import Attempt
from iceg.slam.findings import Findings
from iceg.slam.kept_scans import KeptScans
from iceg.slam.solution import BATCH, Solution
from iceg.slam.track import Track


def cut_findings(findings: Findings, kept: KeptScans, where: str) -> Findings:
    """The findings of a run for some of its scans, solved anew.

    A key pose whose own scan is gone stands for the first that is left of those tied to it. Where key poses are gone,
    odometry alone leads on.

    Args:
        findings: of the run.
        kept: the scans that are left.
        where: file and line that ask for it, for messages.

    Raises:
        CorrectionsError: scans are asked for that the run did not take in.
    """
    at = np.searchsorted(findings.kept.indices, kept.indices)
    if at[-1] >= len(findings.log) or (findings.kept.indices[at] != kept.indices).any():
        raise CorrectionsError(
            f"{where}: asks for scans that were cut when the log was run, expected only those left: run the log again"
        )
    cut = _Cut.of(findings.track, at)
    log = findings.log.select(at)
    track = replace(
        findings.track,
        keys=[
            replace(
                findings.track.keys[key],
                index=index,
                scan=log.scan(index),
                anchor=max(0, int(np.searchsorted(cut.keys, findings.track.keys[key].anchor, side="right")) - 1),
                T_track_robot=compose(findings.track.keys[key].T_track_robot, T_key_new),
            )
            for key, index, T_key_new in zip(cut.keys.tolist(), cut.scans.tolist(), cut.T_key_new, strict=True)
        ],
        key_of_scan=np.searchsorted(cut.keys, findings.track.key_of_scan[at]),
        T_key_scan=_seen_from(cut, findings.track, at),
        failures=min(findings.track.failures, len(at)),
        lost=_left(findings.track.lost, at),
        breaks=_left(findings.track.breaks, at),
        unknown_motion=_left(findings.track.unknown_motion, at),
        dead=[
            (first, last) for first, last in (_span(interval, at) for interval in findings.track.dead) if first < last
        ],
    )
    return replace(findings, log=log, kept=kept, track=track, solution=_solution(findings, cut, track, at))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cut:
    """The key poses that are left.

    Attributes:
        keys: (k,) which they were.
        scans: (k,) the scan that each stands for now, counted among those left.
        T_key_new: (k, 3) where that lies in the frame of the one before.
    """

    keys: NDArray[np.int64]
    scans: NDArray[np.int64]
    T_key_new: NDArray[np.float64]

    @classmethod
    def of(cls, track: Track, at: NDArray[np.int64]) -> "_Cut":
        keys, firsts = np.unique(track.key_of_scan[at], return_index=True)
        own = np.array([track.keys[key].index for key in keys.tolist()], dtype=np.int64)
        places = np.minimum(np.searchsorted(at, own), len(at) - 1)
        stays = at[places] == own
        scans = np.where(stays, places, firsts)
        T_key_new = np.where(stays[:, None], 0.0, track.T_key_scan[at[scans]])
        return cls(keys=keys, scans=scans, T_key_new=T_key_new)

    def row(self, key: int) -> int | None:
        """Where a key pose is among those left; None where it is gone."""
        at = int(np.searchsorted(self.keys, key))
        return at if at < len(self.keys) and self.keys[at] == key else None

    def next_row(self, key: int) -> int:
        """Where it is, or the next one, or else the last."""
        return min(int(np.searchsorted(self.keys, key)), len(self.keys) - 1)

    def carried(
        self, i: int, j: int, T_i_j: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What was measured between two key poses, rows i and j, between the scans that they stand for now."""
        T_i, T_j = self.T_key_new[i], self.T_key_new[j]
        if not (T_i.any() or T_j.any()):
            return T_i_j, covariance
        return compose(compose(inverse(T_i), T_i_j), T_j), congruence(adjoint(inverse(T_j)), covariance)


def _solution(findings: Findings, cut: _Cut, track: Track, at: NDArray[np.int64]) -> Solution:
    before = findings.solution
    poses = compose(before.poses[cut.keys], cut.T_key_new)
    factors = _factors(before.factors, cut, poses) + _over_gaps(findings, cut, track, at)
    poses = optimize(factors, poses, BATCH).poses
    rows = {key: row for key in before.odometry_jumps if (row := cut.row(key)) is not None}
    return replace(
        before,
        factors=factors,
        poses=poses,
        attempts=[found for attempt in before.attempts if (found := _attempt(attempt, cut)) is not None],
        searchable=before.searchable[cut.keys],
        odometry_jumps=tuple(rows.values()),
        breaks=tuple(replace(each, key=cut.next_row(each.key)) for each in before.breaks if cut.next_row(each.key)),
        ambiguous=tuple(
            replace(vote, first=cut.next_row(vote.first), last=cut.next_row(vote.last))
            for vote in before.ambiguous
            if cut.next_row(vote.first)
        ),
    )


def _factors(factors: Iterable[Factor], cut: _Cut, poses: NDArray[np.float64]) -> list[Factor]:
    """Those between key poses that are left; the prior holds the first of them where it is."""
    left = []
    for factor in factors:
        i, j = None if factor.i is None else cut.row(factor.i), cut.row(factor.j)
        if factor.i is None:
            left.append(replace(factor, j=0, T_i_j=poses[0]))
        elif i is not None and j is not None:
            T_i_j, covariance = cut.carried(i, j, factor.T_i_j, factor.covariance)
            left.append(replace(factor, i=i, j=j, T_i_j=T_i_j, covariance=covariance))
    return left


def _over_gaps(findings: Findings, cut: _Cut, track: Track, at: NDArray[np.int64]) -> list[Factor]:
    """Odometry from each key pose to the next, where those between are gone."""
    log, noise, found = findings.log, findings.calibration.lasting_noise, []
    odometry = findings.calibration.apply(log.odometry, findings.config.front_end.calibration.sudden)
    unknown = track.keys_without_odometry()
    for j in (np.flatnonzero(np.diff(cut.keys) > 1) + 1).tolist():
        first, last = at[[track.keys[j - 1].index, track.keys[j].index]].tolist()
        if log.has_odometry and j not in unknown:
            steps = between(odometry[first:last], odometry[first + 1 : last + 1])
            motion = noise.extend(noise.start(), steps)
            T_i_j, covariance = motion.T_key_robot, motion.covariance
        else:
            T_i_j = between(track.keys[j - 1].T_track_robot, track.keys[j].T_track_robot)
            covariance = findings.config.loops.failures.unknown.covariance
        found.append(Factor(kind="odometry", i=j - 1, j=j, T_i_j=T_i_j, covariance=covariance))
    return found


def _attempt(attempt: Attempt, cut: _Cut) -> Attempt | None:
    old, new = cut.row(attempt.key_old), cut.row(attempt.key_new)
    if old is None or new is None:
        return None
    match = None if attempt.match is None else _match(attempt.match, cut, old, new)
    return replace(attempt, key_old=old, key_new=new, match=match)


def _match(match: RelativePose, cut: _Cut, old: int, new: int) -> RelativePose:
    T_ref_cur, covariance = cut.carried(old, new, match.T_ref_cur, match.covariance)
    return replace(match, T_ref_cur=T_ref_cur, covariance=covariance)


def _seen_from(cut: _Cut, track: Track, at: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, 3) the scans left, in the frames of their key poses now."""
    T_key_new = cut.T_key_new[np.searchsorted(cut.keys, track.key_of_scan[at])]
    moved = T_key_new.any(axis=1)
    T_key_scan = track.T_key_scan[at].copy()
    T_key_scan[moved] = between(T_key_new[moved], T_key_scan[moved])
    return T_key_scan


def _left(scans: Sequence[int], at: NDArray[np.int64]) -> list[int]:
    """Those scans that are left, counted among them."""
    return np.flatnonzero(np.isin(at, scans)).tolist()


def _span(interval: tuple[int, int], at: NDArray[np.int64]) -> tuple[int, int]:
    """First and last of the scans of an interval that are left, counted among them."""
    first, last = np.searchsorted(at, [interval[0], interval[1] + 1]).tolist()
    return first, last - 1

"""A solved graph and its record of closures as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from graph.batch import check_determined
from graph.factors import Factor, FactorKind, RobustKernel
from graph.limits import LIMITS
from iceg.findings_file.match_arrays import match_arrays, matches_of
from iceg.findings_file.table import Table
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.broken_path.place_votes import Vote
from iceg.slam.closures.attempt import Attempt, Place
from iceg.slam.solution import Solution

_KINDS: tuple[FactorKind, ...] = get_args(FactorKind)


def solution_arrays(solution: Solution) -> dict[str, NDArray[Any]]:
    """The arrays of a solution."""
    factors, attempts = solution.factors, solution.attempts
    kernels = _kernels(factors)
    places = [[*place.T_old_new, place.misfit] for attempt in attempts for place in attempt.places]
    return {
        "graph_poses": solution.poses,
        "graph_searchable": solution.searchable,
        "factor_kind": np.array([_KINDS.index(factor.kind) for factor in factors], dtype=np.uint8),
        "factor_ends": np.array([(-1 if factor.i is None else factor.i, factor.j) for factor in factors], np.int32),
        "factor_T": np.array([factor.T_i_j for factor in factors]),
        "factor_covariance": np.array([factor.covariance for factor in factors]),
        "factor_kernel": np.array([kernels.index(factor.kernel) for factor in factors], dtype=np.uint8),
        "closure_keys": np.array([(a.key_old, a.key_new) for a in attempts], dtype=np.uint32).reshape(-1, 2),
        "closure_flags": np.array([(a.accepted, a.removed) for a in attempts], dtype=np.bool_).reshape(-1, 2),
        "closure_overlap": np.array([a.overlap for a in attempts], dtype=np.float64),
        "closure_off_path": np.array([a.off_path for a in attempts], dtype=np.float64),
        "closure_n_places": np.array([len(a.places) for a in attempts], dtype=np.uint32),
        "closure_places": np.array(places, dtype=np.float64).reshape(-1, 4),
        **match_arrays("closure_match", [attempt.match for attempt in attempts]),
    }


def solution_facts(solution: Solution) -> dict[str, Any]:
    """What there is to say of a solution besides arrays, for JSON."""
    return {
        "kernels": [None if kernel is None else asdict(kernel) for kernel in _kernels(solution.factors)],
        "closure_reasons": [attempt.reason for attempt in solution.attempts],
        "odometry_jumps": list(map(int, solution.odometry_jumps)),
        "breaks": [asdict(found) for found in solution.breaks],
        "ambiguous": [asdict(vote) for vote in solution.ambiguous],
    }


def solution_of(table: Table, facts: Mapping[str, Any], n_keys: int) -> Solution:
    """The solution again.

    Raises:
        IcegError: the arrays or facts make no graph of so many key poses.
    """
    poses = table.floats("graph_poses", n_keys, 3)
    if (np.abs(poses) > LIMITS.coordinate).any():
        raise table.error(f"'graph_poses' holds poses beyond {LIMITS.coordinate:g} m")
    jumps = [int(key) for key in facts["odometry_jumps"]]
    breaks = tuple(_break(found) for found in facts["breaks"])
    ambiguous = tuple(Vote(**vote) for vote in facts["ambiguous"])
    named = [*jumps, *(found.key for found in breaks), *(key for vote in ambiguous for key in (vote.first, vote.last))]
    if any(not 0 <= key < n_keys for key in named):
        raise table.error(f"found key poses {str(named)[:80]}, expected 0 to {n_keys - 1}")
    factors = _factors(table, facts, n_keys)
    check_determined(factors, n_keys)
    return Solution(
        factors=factors,
        poses=poses,
        attempts=_attempts(table, facts, n_keys),
        searchable=table.flags("graph_searchable", n_keys),
        odometry_jumps=tuple(jumps),
        breaks=breaks,
        ambiguous=ambiguous,
    )


def _kernels(factors: Sequence[Factor]) -> list[RobustKernel | None]:
    """The different ones, in the order in which they come."""
    return list(dict.fromkeys(factor.kernel for factor in factors))


def _factors(table: Table, facts: Mapping[str, Any], n_keys: int) -> list[Factor]:
    kernels = [
        None if kernel is None else RobustKernel(name=kernel["name"], width=float(kernel["width"]))
        for kernel in facts["kernels"]
    ]
    kinds = table.whole("factor_kind", -1, high=len(_KINDS)).tolist()
    n = len(kinds)
    ends = table.whole("factor_ends", n, 2, low=-1, high=n_keys).tolist()
    chosen = table.whole("factor_kernel", n, high=len(kernels)).tolist()
    poses, covariances = table.floats("factor_T", n, 3), table.floats("factor_covariance", n, 3, 3)
    if (np.abs(poses) > LIMITS.coordinate).any() or any(j < 0 for _, j in ends):
        raise table.error("its factors join poses that cannot be")
    return [
        Factor(
            kind=_KINDS[kinds[k]],
            i=None if ends[k][0] < 0 else ends[k][0],
            j=ends[k][1],
            T_i_j=poses[k],
            covariance=covariances[k],
            kernel=kernels[chosen[k]],
        )
        for k in range(n)
    ]


def _attempts(table: Table, facts: Mapping[str, Any], n_keys: int) -> list[Attempt]:
    keys = table.whole("closure_keys", -1, 2, high=n_keys).tolist()
    n = len(keys)
    flags, overlaps = table.flags("closure_flags", n, 2).tolist(), table.floats("closure_overlap", n).tolist()
    matches, reasons = matches_of(table, "closure_match", n), list(map(str, facts["closure_reasons"]))
    off_path = table.floats("closure_off_path", n, is_nan_allowed=True).tolist()
    ends = np.cumsum(table.whole("closure_n_places", n, high=LIMITS.rows)).tolist()
    places = table.floats("closure_places", ends[-1] if ends else 0, 4)
    if len(reasons) != n or any(old >= new for old, new in keys):
        raise table.error("its closures are not each of an earlier and a later key scan, with a reason")
    if any(accepted and match is None for (accepted, _), match in zip(flags, matches, strict=True)):
        raise table.error("it accepts closures that matched nothing")
    return [
        Attempt(
            key_old=keys[k][0],
            key_new=keys[k][1],
            match=matches[k],
            accepted=flags[k][0],
            reason=reasons[k],
            overlap=overlaps[k],
            removed=flags[k][1],
            places=tuple(Place(T_old_new=row[:3], misfit=float(row[3])) for row in places[first:last]),
            off_path=off_path[k],
        )
        for k, (first, last) in enumerate(zip([0, *ends], ends, strict=False))
    ]


def _break(found: Mapping[str, Any]) -> Break:
    outcome = found["outcome"]
    if outcome not in list(Outcome):
        raise ValueError(f"found the outcome {str(outcome)[:40]!r}, expected one of {', '.join(Outcome)}")
    return Break(
        key=int(found["key"]),
        outcome=Outcome(outcome),
        reason=str(found["reason"]),
        closures=int(found["closures"]),
        moved=float(found["moved"]),
        across=int(found["across"]),
        scan=None if found["scan"] is None else int(found["scan"]),
        probability=_probability(found["probability"]),
    )


def _probability(found: object) -> float:
    if not isinstance(found, int | float) or not 0.0 <= found <= 1.0:
        raise ValueError(f"found the probability {str(found)[:40]}, expected 0 to 1")
    return float(found)

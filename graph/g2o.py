"""The g2o text format for SE(2): `VERTEX_SE2`, `EDGE_SE2`, `EDGE_PRIOR_SE2` and `FIX`.

A remark at the end of each edge's line keeps what the format has no word for, the kind of the factor and its robust
kernel: `… # closure dcs 1.0`. Other readers (g2o, GTSAM) pass over it, and so lose the kernel; a remark on its own line
would make GTSAM's reader lose every edge. A prior is g2o's own `EDGE_PRIOR_SE2`, which GTSAM's reader skips. Numbers
are written so that they read back bit for bit.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast, get_args

import numpy as np
from numpy.typing import NDArray

from graph.atomic import write_atomically
from graph.dense import eigvalsh
from graph.errors import GraphError, reason
from graph.factors import Factor, FactorKind, KernelName, RobustKernel
from graph.files import check_file
from graph.limits import LIMITS, at_most
from graph.noise import information_of

FIX_SIGMA = 1e-3
"""Standard deviation [m, rad] of the prior that stands for a `FIX` line, or for its absence on the first vertex."""

_UPPER = np.triu_indices(3)
_N_FIELDS = {"VERTEX_SE2": 5, "EDGE_SE2": 12, "EDGE_PRIOR_SE2": 11, "FIX": 2}
_LARGEST_ID = 2**62
_ID_DIGITS = 20
_MOST_INFORMATION = 1e20
_MOST_CONDITION = 1e15
"""Of an information matrix; beyond, float64 does not tell its weakest direction from none."""


class G2oError(GraphError):
    """A g2o file that cannot be read or written; the message begins with the path, and the line where there is one."""


@dataclass(frozen=True, kw_only=True)
class G2oGraph:
    """What a g2o file holds.

    Attributes:
        ids: (n,) vertex ids of the file, increasing; factors count poses by their place in this array.
        poses: (n, 3) T_map_robot as written; chained along the edges if the file has no vertices.
        factors: in the file's order. Without a remark, an edge between neighbouring ids counts as odometry, any other
            as a closure.
    """

    ids: NDArray[np.int64]
    poses: NDArray[np.float64]
    factors: tuple[Factor, ...]


def write_g2o(
    path: Path | str,
    poses: NDArray[np.float64],
    factors: Iterable[Factor],
    ids: NDArray[np.int64] | None = None,
) -> None:
    """Write key poses and every factor with its full information matrix, atomically.

    Args:
        path: the file.
        poses: (n, 3) T_map_robot.
        factors: the records, in order.
        ids: (n,) vertex ids; 0 … n−1 when left out.

    Raises:
        G2oError: the file cannot be written.
    """
    names = list(range(len(poses))) if ids is None else ids.tolist()
    lines = [
        f"VERTEX_SE2 {name} {x!r} {y!r} {heading!r}"
        for name, (x, y, heading) in zip(names, poses.tolist(), strict=True)
    ]
    kept = list(factors)
    informations = information_of(np.array([factor.covariance for factor in kept]).reshape(-1, 3, 3))
    rows, columns = _UPPER
    edges = np.hstack([np.array([factor.T_i_j for factor in kept]).reshape(-1, 3), informations[:, rows, columns]])
    for factor, edge in zip(kept, edges.tolist(), strict=True):
        seen = names[factor.j]
        head = f"EDGE_PRIOR_SE2 {seen}" if factor.i is None else f"EDGE_SE2 {names[factor.i]} {seen}"
        lines.append(f"{head} {' '.join(map(repr, edge))} # {_remark(factor)}")
    try:
        write_atomically(Path(path), ("\n".join(lines) + "\n").encode())
    except OSError as err:
        raise G2oError(f"{path}: cannot be written: {reason(err)}") from err


def read_g2o(path: Path | str) -> G2oGraph:
    """Read an SE(2) pose graph.

    A file without prior gets one: on each `FIX`ed vertex, or else on its first.

    Args:
        path: the file.

    Raises:
        G2oError: path:line, what was found and what was expected.
    """
    file = Path(path)
    contents = _Contents()
    check_file(file, "table_bytes", G2oError, "a pose graph")
    try:
        with file.open(encoding="utf-8-sig") as lines:
            for number, line in enumerate(lines, start=1):
                if number > LIMITS.rows:
                    raise G2oError(f"{file}:{number}: found more lines, expected {at_most('rows')}")
                _read_line(contents, line, f"{file}:{number}")
    except OSError as err:
        raise G2oError(f"{file}: cannot be read as a pose graph: {reason(err)}") from err
    except UnicodeDecodeError as err:
        raise G2oError(f"{file}: not a text file ({err.reason} at byte {err.start})") from err
    return _assembled(contents, file)


@dataclass(slots=True)
class _Edge:
    """An edge as written: vertex ids, not yet indices."""

    i: int | None
    j: int
    numbers: list[float]
    remark: list[str]
    where: str


@dataclass(slots=True)
class _Contents:
    vertices: dict[int, list[float]] = field(default_factory=dict)
    edges: list[_Edge] = field(default_factory=list)
    fixed: list[tuple[int, str]] = field(default_factory=list)


def _read_line(contents: _Contents, line: str, where: str) -> None:
    text, _, remark = line.partition("#")
    words = text.split()
    if not words:
        return
    tag = words[0]
    if tag not in _N_FIELDS:
        raise G2oError(f"{where}: found {tag[:40]}, expected one of {', '.join(_N_FIELDS)} (an SE(2) pose graph)")
    if tag == "FIX" and len(words) > 1:
        contents.fixed += [(_id(word, where), where) for word in words[1:]]
        return
    if len(words) != _N_FIELDS[tag]:
        raise G2oError(f"{where}: found {len(words) - 1} fields after {tag}, expected {_N_FIELDS[tag] - 1}")
    n_ids = 2 if tag == "EDGE_SE2" else 1
    ids = [_id(word, where) for word in words[1 : 1 + n_ids]]
    numbers = _bounded([_number(word, where) for word in words[1 + n_ids :]], where)
    if tag == "VERTEX_SE2":
        if ids[0] in contents.vertices:
            raise G2oError(f"{where}: found vertex {ids[0]} a second time")
        contents.vertices[ids[0]] = numbers
    else:
        i, j = (ids[0], ids[1]) if n_ids == 2 else (None, ids[0])
        contents.edges.append(_Edge(i, j, numbers, _known(remark.split()), where))


def _assembled(contents: _Contents, file: Path) -> G2oGraph:
    known = contents.vertices.keys() if contents.vertices else _ids_of_edges(contents.edges)
    if not known:
        raise G2oError(f"{file}: found neither vertices nor edges, expected an SE(2) pose graph")
    ids = sorted(known)
    index = {vertex: place for place, vertex in enumerate(ids)}
    factors = [_factor(edge, index) for edge in contents.edges]
    priors = [] if any(factor.i is None for factor in factors) else _priors(contents, index)
    factors = [*priors, *factors]
    if contents.vertices:
        poses = np.array([contents.vertices[vertex] for vertex in ids])
    else:
        poses = _chained(factors, len(ids), file)
    return G2oGraph(ids=np.array(ids, dtype=np.int64), poses=poses, factors=tuple(factors))


def _factor(edge: _Edge, index: dict[int, int]) -> Factor:
    for vertex in (edge.i, edge.j):
        if vertex is not None and vertex not in index:
            raise G2oError(f"{edge.where}: found an edge to vertex {vertex}, which the file does not define")
    i = None if edge.i is None else index[edge.i]
    j = index[edge.j]
    information = np.zeros((3, 3))
    information[_UPPER] = edge.numbers[3:]
    information = information + np.triu(information, 1).T
    guessed: FactorKind = "prior" if edge.i is None else "odometry" if abs(edge.j - edge.i) == 1 else "closure"
    try:
        return Factor(
            kind=cast("FactorKind", edge.remark[0]) if edge.remark else guessed,
            i=i,
            j=j,
            T_i_j=np.array(edge.numbers[:3]),
            covariance=_covariance_of(information),
            kernel=_kernel(edge),
        )
    except GraphError as err:
        raise G2oError(f"{edge.where}: {err}") from err


def _covariance_of(information: NDArray[np.float64]) -> NDArray[np.float64]:
    strengths = eigvalsh(information)
    if strengths[0] <= 0.0:
        raise GraphError(f"an information matrix is positive definite, found {strengths.tolist()} along its axes")
    if strengths[2] > _MOST_INFORMATION or strengths[0] < 1.0 / _MOST_INFORMATION:
        raise GraphError(
            f"an information matrix has eigenvalues from {1.0 / _MOST_INFORMATION:g} to {_MOST_INFORMATION:g}, found "
            f"{strengths.tolist()}"
        )
    if strengths[2] > _MOST_CONDITION * strengths[0]:
        raise GraphError(
            f"an information matrix can be inverted, found {strengths.tolist()} along its axes: they differ too much"
        )
    return information_of(information)


def _known(remark: list[str]) -> list[str]:
    """The remark, if it is one of ours: a kind alone, or a kind and a kernel; other people's are passed over."""
    is_kind = 1 <= len(remark) <= 3 and remark[0] in get_args(FactorKind)
    return remark if is_kind and (len(remark) == 1 or remark[1] in get_args(KernelName)) else []


def _kernel(edge: _Edge) -> RobustKernel | None:
    if len(edge.remark) <= 1:
        return None
    if len(edge.remark) != 3:
        raise GraphError(f"found the remark {' '.join(edge.remark)[:80]!r}, expected KIND or KIND KERNEL WIDTH")
    return RobustKernel(name=cast("KernelName", edge.remark[1]), width=_number(edge.remark[2], edge.where))


def _priors(contents: _Contents, index: dict[int, int]) -> list[Factor]:
    for vertex, where in contents.fixed:
        if vertex not in index:
            raise G2oError(f"{where}: found FIX {vertex}, which the file does not define")
    held = [vertex for vertex, _ in contents.fixed] or [min(index)]
    return [
        Factor(
            kind="prior",
            i=None,
            j=index[vertex],
            T_i_j=np.array(contents.vertices.get(vertex, [0.0, 0.0, 0.0])),
            covariance=np.eye(3) * FIX_SIGMA**2,
        )
        for vertex in dict.fromkeys(held)
    ]


def _chained(factors: Sequence[Factor], n_poses: int, file: Path) -> NDArray[np.float64]:
    from graph.batch import chained_poses

    try:
        return chained_poses(factors, n_poses)
    except GraphError as err:
        raise G2oError(f"{file}: no vertices to start from, and along the edges {err}") from err


def _ids_of_edges(edges: Iterable[_Edge]) -> set[int]:
    return {vertex for edge in edges for vertex in (edge.i, edge.j) if vertex is not None}


def _remark(factor: Factor) -> str:
    return factor.kind if factor.kernel is None else f"{factor.kind} {factor.kernel.name} {factor.kernel.width!r}"


def _id(word: str, where: str) -> int:
    try:
        number = int(word) if len(word) <= _ID_DIGITS else 2 * _LARGEST_ID
    except ValueError as err:
        raise G2oError(f"{where}: found {word[:80]!r}, expected a vertex id (an integer)") from err
    if len(word) > _ID_DIGITS and not word.lstrip("+-").isdigit():
        raise G2oError(f"{where}: found {word[:40]!r}, expected a vertex id (an integer)")
    if abs(number) > _LARGEST_ID:
        raise G2oError(f"{where}: found {word[:40]}, expected a vertex id of at most {_LARGEST_ID}")
    return number


def _bounded(numbers: list[float], where: str) -> list[float]:
    """x, y, heading and what follows, if they can be a pose and an information matrix."""
    if max(map(abs, numbers[:2])) > LIMITS.coordinate or abs(numbers[2]) > LIMITS.heading:
        raise G2oError(
            f"{where}: found the pose {numbers[:3]}, expected one within {LIMITS.coordinate:g} m of the origin, its "
            f"heading within {LIMITS.heading:g} rad"
        )
    if any(abs(number) > _MOST_INFORMATION for number in numbers[3:]):
        raise G2oError(f"{where}: found the information {numbers[3:]}, expected at most {_MOST_INFORMATION:g}")
    return numbers


def _number(word: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError as err:
        raise G2oError(f"{where}: found {word[:80]!r}, expected a number") from err
    if not math.isfinite(value):
        raise G2oError(f"{where}: found {word[:80]}, expected a finite number")
    return value

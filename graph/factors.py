"""Factors as plain records: what the graph is made of, written as, and rebuilt from."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graph.errors import GraphError
from graph.noise import conditioned
from graph.short_repr import short_repr

FactorKind = Literal["prior", "odometry", "ice", "closure"]
"""What a factor comes from: a pose known beforehand, wheels, a match along the way, what several of these say together,
a place seen again."""

KernelName = Literal["huber", "cauchy", "geman_mcclure", "dcs"]

_KINDS: tuple[str, ...] = get_args(FactorKind)
_LEAST_WIDTH, _MOST_WIDTH = 1e-9, 1e9
_KERNEL_NAMES: tuple[str, ...] = get_args(KernelName)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustKernel:
    """How the pull of a factor fades when the rest of the graph contradicts it.

    Attributes:
        name: "huber" (fades to a constant), "cauchy", "geman_mcclure" (fades to nothing) or "dcs" (dynamic covariance
            scaling, Agarwal et al. 2013: untouched below √width, then fading to nothing).
        width: where fading begins: in standard deviations of the factor; for "dcs" Φ, in their square.
    """

    name: KernelName
    width: float = 1.0

    def __post_init__(self) -> None:
        if self.name not in _KERNEL_NAMES:
            raise GraphError(f"a robust kernel is one of {', '.join(_KERNEL_NAMES)}, found {self.name!r}")
        if not _LEAST_WIDTH <= self.width <= _MOST_WIDTH:
            raise GraphError(
                f"the width of a robust kernel is a positive number from {_LEAST_WIDTH:g} to {_MOST_WIDTH:g}, found "
                f"{self.width}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factor:
    """One measurement of the graph: where pose `j` lies as seen from pose `i`.

    Attributes:
        kind: what it comes from.
        i: index of the key pose it is seen from; None for a prior, where the map itself takes its place.
        j: index of the key pose that is seen.
        T_i_j: (3,) pose of j in the frame of i (for a prior T_map_j), read-only.
        covariance: (3, 3) in the tangent space at T_i_j, right perturbation, order x, y, θ; read-only, made fit for the
            graph by `graph.noise.conditioned`.
        kernel: robust kernel, or None for plain least squares.
    """

    kind: FactorKind
    i: int | None
    j: int
    T_i_j: NDArray[np.float64]
    covariance: NDArray[np.float64]
    kernel: RobustKernel | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise GraphError(f"the kind of a factor is one of {', '.join(_KINDS)}, found {self.kind!r}")
        if (self.kind == "prior") != (self.i is None):
            raise GraphError(f"a prior, and only a prior, has no pose i: found kind {self.kind!r} with i = {self.i}")
        if self.i == self.j:
            raise GraphError(f"a factor joins two poses, found pose {self.i} joined to itself")
        T_i_j = np.array(self.T_i_j, dtype=np.float64)
        if T_i_j.shape != (3,) or not all(map(math.isfinite, T_i_j.tolist())):
            raise GraphError(f"{self}: a pose is 3 finite numbers, found {self.T_i_j}")
        T_i_j.flags.writeable = False
        try:
            covariance = conditioned(self.covariance)
        except GraphError as err:
            raise GraphError(f"{self}: {err}") from err
        object.__setattr__(self, "T_i_j", T_i_j)
        object.__setattr__(self, "covariance", covariance)

    @property
    def pair(self) -> tuple[int | None, int]:
        """The two key poses that it joins: i and j."""
        return self.i, self.j

    def measuring(self, T_i_j: NDArray[np.float64]) -> "Factor":
        """The same with another measurement, (3,) finite numbers; what was checked before is not checked again."""
        T_i_j.flags.writeable = False
        twin = object.__new__(Factor)
        for name in ("kind", "i", "j", "covariance", "kernel"):
            object.__setattr__(twin, name, getattr(self, name))
        object.__setattr__(twin, "T_i_j", T_i_j)
        return twin

    def __str__(self) -> str:
        return f"{self.kind} {self.j}" if self.i is None else f"{self.kind} {self.i}→{self.j}"

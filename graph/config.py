"""Settings of the pose graph; light to import, since the command line needs them before anything is computed."""

from dataclasses import dataclass
from typing import Literal

from graph.errors import GraphError
from graph.ranges import CheckedSettings, between, positive

Factorization = Literal["CHOLESKY", "QR"]


@dataclass(frozen=True, kw_only=True)
class PoseGraphConfig(CheckedSettings, error=GraphError):
    """How the graph is solved while it grows; quick rather than exact, since `graph.batch` makes the end result exact.

    Attributes:
        relinearize_threshold: a pose that moved by more than this since it was last linearised [m, rad] is linearised
            anew.
        relinearize_skip: look for such poses at every so many updates only.
        settle_iterations: at most so many further updates after one that closed a loop, until no pose needs to be
            linearised anew.
        snapshot_before_closure: copy iSAM2 before such an update (8 ms at 3500 poses), so that a failing one is undone
            exactly; without, the graph is rebuilt from its records instead.
        factorization: "CHOLESKY", or "QR": slower in graphs with many loops, copes with strongly correlated
            covariances. A failing CHOLESKY becomes QR by itself.
        prior_sigma: standard deviation of the first pose [m, rad]; small, because it defines the map frame.
    """

    relinearize_threshold: float = positive(0.1)
    relinearize_skip: int = positive(20)
    settle_iterations: int = 0
    snapshot_before_closure: bool = False
    factorization: Factorization = "CHOLESKY"
    prior_sigma: float = between(1e-3, 1e-6, 10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.factorization not in {"CHOLESKY", "QR"}:
            raise GraphError(f"factorization is CHOLESKY or QR, found {self.factorization!r}")

"""The pose graph of a run, solved as it grows: GTSAM's iSAM2 behind plain records."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from graph.batch import check_determined, marginal_covariances
from graph.config import Factorization, PoseGraphConfig
from graph.errors import GraphError
from graph.factors import Factor, RobustKernel
from graph.gtsam_bridge import (
    from_gtsam_pose,
    from_gtsam_values,
    new_isam,
    to_gtsam_graph,
    to_gtsam_pose,
)
from graph.measurement import RelativePose
from graph.se2 import between_covariance

_FAILING_VARIABLE = re.compile(r"near variable\s+(\d+)")
_FACTORS_NAMED = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """A state of a `PoseGraph` to return to; opaque."""

    isam: gtsam.ISAM2
    factorization: Factorization
    n_poses: int
    factors: tuple[Factor, ...]
    slots: tuple[int | None, ...]


class PoseGraph:
    """Key poses, numbered 0, 1, 2 … as they come, and the factors that tie them.

    `add_…` collects; `update` sends what was collected to iSAM2, each factor exactly once. One update may carry any
    number of key poses. Questions (`pose`, `all_poses`, covariances) send what is still waiting first.
    """

    def __init__(self, config: PoseGraphConfig | None = None) -> None:
        self.config = config or PoseGraphConfig()
        self._factorization: Factorization = self.config.factorization
        self._isam = self._new_isam()
        self._factors: list[Factor] = []
        self._slots: list[int | None] = []  # where iSAM2 keeps each factor; None once removed
        self._n_poses = 0  # those iSAM2 knows
        self._waiting: list[NDArray[np.float64]] = []  # first guesses of the poses it does not know yet

    @classmethod
    def from_factors(
        cls, factors: Sequence[Factor], poses: NDArray[np.float64], config: PoseGraphConfig | None = None
    ) -> "PoseGraph":
        """A graph made at once, from the records of another; iSAM2 gets it with the first question.

        Args:
            factors: at least one prior among them.
            poses: (n, 3) first guesses of T_map_robot.
            config: how it is solved.
        """
        check_determined(factors, len(poses))
        graph = cls(config)
        guesses = np.array(poses, dtype=np.float64)
        if not np.isfinite(guesses).all():
            raise GraphError(f"first guesses are finite numbers, found {guesses[~np.isfinite(guesses).all(axis=1)][0]}")
        graph._waiting, graph._factors = list(guesses), list(factors)
        return graph

    def __repr__(self) -> str:
        counts = Counter(factor.kind for factor in self.factors)
        factors = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
        return f"PoseGraph({len(self)} poses; factors: {factors or 'none'})"

    def __len__(self) -> int:
        """Number of key poses."""
        return self._n_poses + len(self._waiting)

    @property
    def factors(self) -> tuple[Factor, ...]:
        """The factors in force, in the order in which they came."""
        n_sent = len(self._slots)
        kept = (factor for factor, slot in zip(self._factors, self._slots, strict=False) if slot is not None)
        return (*kept, *self._factors[n_sent:])

    @property
    def factorization(self) -> Factorization:
        """How iSAM2 solves at present: as configured, or QR after CHOLESKY failed."""
        return self._factorization

    @property
    def has_loose_poses(self) -> bool:
        """Whether a waiting pose hangs on nothing yet, so that an update would be refused."""
        return bool(self._loose_poses(self._factors[len(self._slots) :]))

    def factor(self, index: int) -> Factor:
        """The factor that `add_…` gave this index, in force or removed."""
        return self._factors[index]

    def add_first_pose(self, T_map_robot: NDArray[np.float64], covariance: NDArray[np.float64] | None = None) -> int:
        """Start the map: key pose 0 and the prior that holds it.

        Args:
            T_map_robot: (3,) where the map says it is.
            covariance: (3, 3) of it; None takes the configured `prior_sigma`.

        Returns:
            0, its index.
        """
        if len(self):
            raise GraphError(f"the first pose comes first, found {len(self)} poses")
        held = np.eye(3) * self.config.prior_sigma**2 if covariance is None else covariance
        key = self.add_pose(T_map_robot)
        self.add(Factor(kind="prior", i=None, j=key, T_i_j=T_map_robot, covariance=held))
        return key

    def add_pose(self, T_map_robot: NDArray[np.float64]) -> int:
        """Add a key pose at a first guess; at least one factor must tie it before the next update.

        Args:
            T_map_robot: (3,) first guess.

        Returns:
            Its index.
        """
        guess = np.array(T_map_robot, dtype=np.float64)
        if guess.shape != (3,) or not all(map(math.isfinite, guess.tolist())):
            raise GraphError(f"the first guess of pose {len(self)} is 3 finite numbers, found {T_map_robot}")
        self._waiting.append(guess)
        return len(self) - 1

    def add_odometry(self, i: int, j: int, T_i_j: NDArray[np.float64], covariance: NDArray[np.float64]) -> int:
        """Add what the wheels say; returns the factor's index.

        Args:
            i: index of the key pose it is seen from.
            j: index of the key pose that is seen.
            T_i_j: (3,) motion.
            covariance: (3, 3) in the tangent space at it.
        """
        return self.add(Factor(kind="odometry", i=i, j=j, T_i_j=T_i_j, covariance=covariance))

    def add_match(self, i: int, j: int, match: RelativePose, kernel: RobustKernel | None = None) -> int:
        """Add a match along the way, of pose j against a reference in the frame of pose i; returns its index.

        It tells nothing along what it does not observe.
        """
        covariance = match.informed_covariance
        return self.add(Factor(kind="ice", i=i, j=j, T_i_j=match.T_ref_cur, covariance=covariance, kernel=kernel))

    def add_closure(self, i: int, j: int, match: RelativePose, kernel: RobustKernel | None) -> int:
        """Add a loop closure, pose j found again from pose i; returns its index.

        It tells nothing along what it does not observe: a place that is similar along a corridor or a ring moves
        nothing there, and many such places add up to nothing.
        """
        covariance = match.informed_covariance
        return self.add(Factor(kind="closure", i=i, j=j, T_i_j=match.T_ref_cur, covariance=covariance, kernel=kernel))

    def add(self, factor: Factor) -> int:
        """Add any factor between poses that are there; returns its index."""
        for key in (factor.i, factor.j):
            if key is not None and not 0 <= key < len(self):
                raise GraphError(f"{factor} joins pose {key}, there are {len(self)} poses")
        self._factors.append(factor)
        return len(self._factors) - 1

    def update(self) -> NDArray[np.float64]:
        """Solve with everything added since the last update.

        An update with a loop closure in it is risky: a snapshot is taken before. If it or any other fails, the graph is
        rebuilt with it once more with QR factorisation, which stays in force; if that fails too, the graph returns to
        its state before the update, and the poses and factors of this update are gone.

        Returns:
            (3,) the newest T_map_robot.

        Raises:
            GraphError: names the pose that made the system indeterminate and the factors at it.
        """
        self._send()
        if self._n_poses == 0:
            raise GraphError("the graph has no poses")
        return self.pose(self._n_poses - 1)

    def remove(self, index: int) -> None:
        """Take a factor out again; its record stays under its index, but is no longer in `factors`.

        Args:
            index: as `add_…` returned it.

        Raises:
            GraphError: there is no such factor in force, or a pose would hang on nothing without it; nothing changed.
        """
        self._send()
        slot = self._slots[index] if 0 <= index < len(self._slots) else None
        if slot is None:
            raise GraphError(f"factor {index} is not in force")
        kept = [self._factors[k] for k, s in enumerate(self._slots) if s is not None and k != index]
        try:
            check_determined(kept, self._n_poses)
        except GraphError as err:
            raise GraphError(f"factor {index} ({self._factors[index]}) must stay: {err}") from err
        before = self._snapshot()
        self._slots[index] = None
        try:
            self._isam.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), [slot])
            self._settle()
        except RuntimeError as err:
            self._rebuild_or_return(before, err)

    def pose(self, key: int) -> NDArray[np.float64]:
        """(3,) T_map_robot of key pose `key`."""
        self._check_key(key)
        return from_gtsam_pose(self._isam.calculateEstimatePose2(key))

    def all_poses(self) -> NDArray[np.float64]:
        """(n, 3) T_map_robot of all key poses."""
        self._send()
        return from_gtsam_values(self._isam.calculateEstimate()) if self._n_poses else np.zeros((0, 3))

    def marginal_covariance(self, key: int) -> NDArray[np.float64]:
        """(3, 3) covariance of key pose `key` given everything, in the tangent space at it."""
        self._check_key(key)
        return np.array(self._isam.marginalCovariance(key))

    def marginal_covariances(self) -> NDArray[np.float64]:
        """(n, 3, 3) covariance of every key pose given everything, each in the tangent space at its pose."""
        self._send()
        if not self._n_poses:
            return np.zeros((0, 3, 3))
        return marginal_covariances(self.factors, self.all_poses())

    def relative_covariance(self, i: int, j: int) -> NDArray[np.float64]:
        """(3, 3) covariance of T_i_j given everything, in the tangent space at it."""
        self._check_key(i)
        self._check_key(j)
        if i == j:
            return np.zeros((3, 3))
        joint = self._isam.jointMarginalCovariance([i, j])
        return between_covariance(
            self.pose(i), np.array(joint.at(i, i)), self.pose(j), np.array(joint.at(j, j)), np.array(joint.at(i, j))
        )

    def snapshot(self) -> Snapshot:
        """The state to return to with `restore`; costs milliseconds in a graph of thousands of poses."""
        self._send()
        return self._snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot of this graph; what was added since is gone."""
        self._isam = gtsam.ISAM2(snapshot.isam)
        self._factorization = snapshot.factorization
        self._n_poses = snapshot.n_poses
        self._factors = list(snapshot.factors)
        self._slots = list(snapshot.slots)
        self._waiting = []

    def _snapshot(self) -> Snapshot:
        return Snapshot(
            isam=gtsam.ISAM2(self._isam),
            factorization=self._factorization,
            n_poses=self._n_poses,
            factors=tuple(self._factors[: len(self._slots)]),
            slots=tuple(self._slots),
        )

    def _check_key(self, key: int) -> None:
        self._send()
        if not 0 <= key < self._n_poses:
            raise GraphError(f"there is no pose {key}, the graph has {self._n_poses}")

    def _new_isam(self) -> gtsam.ISAM2:
        return new_isam(
            self._factorization,
            relinearize_threshold=self.config.relinearize_threshold,
            relinearize_skip=self.config.relinearize_skip,
        )

    def _send(self) -> None:
        """Hand iSAM2 what is waiting, once."""
        n_sent = len(self._slots)
        new_factors = self._factors[n_sent:]
        if not new_factors and not self._waiting:
            return
        self._check_new_poses_tied(new_factors)
        closes_loop = any(factor.kind == "closure" for factor in new_factors)
        before = self._snapshot() if closes_loop and self.config.snapshot_before_closure else None
        try:
            result = self._isam.update(to_gtsam_graph(new_factors), self._waiting_values())
            if closes_loop:
                self._settle()
        except RuntimeError as err:
            self._rebuild_or_return(before, err)
            return
        slots = result.getNewFactorsIndices()
        assert len(slots) == len(new_factors), "iSAM2 took another number of factors than it was given"
        self._slots.extend(slots)
        self._n_poses += len(self._waiting)
        self._waiting = []

    def _settle(self) -> None:
        """Linearise anew what a large correction moved, until it rests."""
        for _ in range(self.config.settle_iterations):
            result = self._isam.update(force_relinearize=True)
            if result.getVariablesRelinearized() == 0:
                break

    def _rebuild_or_return(self, before: Snapshot | None, error: RuntimeError) -> None:
        """After a failed update: everything once more, in a new iSAM2 with QR; if that fails, back and raise."""
        n_sent, n_poses = len(self._slots), self._n_poses
        known = before.isam.calculateEstimate() if before else self._isam.getLinearizationPoint()
        sent = [k for k, slot in enumerate(self._slots) if slot is not None]
        waiting = self._waiting
        self._factorization = "QR"
        try:
            self._rebuild([*sent, *range(n_sent, len(self._factors))], known)
        except RuntimeError as second_error:
            message = self._describe(second_error if _FAILING_VARIABLE.search(str(second_error)) else error)
            del self._factors[n_sent:]
            self._waiting = []
            self._n_poses = n_poses
            if before:
                self.restore(before)
            else:
                self._rebuild(sent, known)
            dropped = f"; its {len(waiting)} poses and their factors are dropped" if waiting else ""
            raise GraphError(f"{message}; the graph is as it was before this update{dropped}") from second_error

    def _rebuild(self, in_force: list[int], known: gtsam.Values) -> None:
        """Put the factors of these indices into a new iSAM2, starting from values of the poses it knew before."""
        values = self._waiting_values()
        for key in range(self._n_poses):
            values.insert(key, known.atPose2(key))
        isam = self._new_isam()
        result = isam.update(to_gtsam_graph(self._factors[k] for k in in_force), values)
        slots = result.getNewFactorsIndices()
        assert len(slots) == len(in_force), "iSAM2 took another number of factors than it was given"
        self._isam = isam
        self._settle()
        self._slots = [None] * len(self._factors)
        for k, slot in zip(in_force, slots, strict=True):
            self._slots[k] = slot
        self._n_poses += len(self._waiting)
        self._waiting = []

    def _waiting_values(self) -> gtsam.Values:
        values = gtsam.Values()
        for key, guess in enumerate(self._waiting, start=self._n_poses):
            values.insert(key, to_gtsam_pose(guess))
        return values

    def _check_new_poses_tied(self, new_factors: list[Factor]) -> None:
        """Every waiting pose must be reached from the poses that iSAM2 knows, or hold a prior."""
        loose = self._loose_poses(new_factors)
        if loose:
            raise GraphError(f"pose {min(loose)} hangs on no factor; add one before the next update")

    def _loose_poses(self, new_factors: list[Factor]) -> set[int]:
        loose = set(range(self._n_poses, len(self)))
        changed = True
        while loose and changed:
            changed = False
            for factor in new_factors:
                ends = {factor.j} if factor.i is None else {factor.i, factor.j}
                if loose & ends and (factor.i is None or not ends <= loose):
                    loose -= ends
                    changed = True
        return loose

    def _describe(self, error: RuntimeError) -> str:
        found = _FAILING_VARIABLE.search(str(error))
        if found is None:
            return f"iSAM2 failed: {' '.join(str(error).split())}"
        key = int(found[1])
        at_key = [f"#{k} {factor}" for k, factor in enumerate(self._factors) if key in {factor.i, factor.j}]
        more = f" and {len(at_key) - _FACTORS_NAMED} more" if len(at_key) > _FACTORS_NAMED else ""
        named = ", ".join(at_key[-_FACTORS_NAMED:])
        return f"the system is indeterminate near pose {key}; factors at it: {named}{more}"

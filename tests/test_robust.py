"""Robust batch optimisation: false closures, heading jumps, starts that find the right valley."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.batch import BatchConfig, chained_poses, graph_error, optimize
from graph.errors import GraphError
from graph.factors import Factor, FactorKind, RobustKernel
from graph.g2o import read_g2o
from graph.gtsam_bridge import to_gtsam_graph, to_gtsam_values
from graph.problem import Problem
from graph.se2 import between, compose, expmap, logmap

Array = NDArray[np.float64]

COVARIANCE = np.diag([0.02, 0.02, 0.01]) ** 2


def laps(n_laps: int = 3, side: int = 8, seed: int = 0) -> tuple[list[Factor], Array]:
    """Round a square several times, matches along the way, a closure to the lap before at every other pose; truth."""
    rng = np.random.default_rng(seed)
    truth = [np.zeros(3)]
    for k in range(1, 4 * side * n_laps):
        truth.append(compose(truth[-1], np.array([0.5, 0.0, np.pi / 2 if k % side == 0 else 0.0])))
    poses, lap = np.array(truth), 4 * side
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=np.eye(3) * 1e-6)]
    ties: list[tuple[FactorKind, int, int]] = [("ice", k - 1, k) for k in range(1, len(poses))]
    ties += [("closure", k - lap, k) for k in range(lap, len(poses), 2)]
    for kind, i, j in ties:
        measured = compose(between(poses[i], poses[j]), expmap(np.sqrt(np.diag(COVARIANCE)) * rng.normal(size=3)))
        factors.append(Factor(kind=kind, i=i, j=j, T_i_j=measured, covariance=COVARIANCE))
    return factors, poses


def false_closures(factors: list[Factor], poses: Array, share: float, seed: int) -> list[Factor]:
    """So many more closures between places that are not the same, seen as if they nearly were."""
    rng = np.random.default_rng(seed)
    covariances = [factor.covariance for factor in factors if factor.kind == "closure"]
    found: list[Factor] = []
    while len(found) < round(share * len(covariances)):
        i, j = sorted(rng.integers(0, len(poses), 2).tolist())
        T_i_j = np.array([*rng.normal(0.0, 1.0, 2), rng.uniform(-np.pi, np.pi)])
        off = between(T_i_j, between(poses[i], poses[j]))
        if j - i < 10 or np.hypot(off[0], off[1]) < 2.0:
            continue
        covariance = covariances[int(rng.integers(len(covariances)))]
        found.append(Factor(kind="closure", i=i, j=j, T_i_j=T_i_j, covariance=covariance))
    return found


def trajectory_error(poses: Array, truth: Array) -> float:
    return float(np.hypot(*(poses - truth)[:, :2].T).mean())


def test_errors_and_optimum_are_those_of_gtsam() -> None:
    import gtsam

    factors, truth = laps()
    rng = np.random.default_rng(1)
    initial = compose(truth, expmap(rng.normal(0.0, 0.1, (len(truth), 3))))
    for name in ("huber", "cauchy", "geman_mcclure", None):
        kernel = RobustKernel(name=name, width=1.3) if name else None
        robust = [
            Factor(kind=f.kind, i=f.i, j=f.j, T_i_j=f.T_i_j, covariance=f.covariance, kernel=kernel) for f in factors
        ]
        graph = to_gtsam_graph(robust)
        assert graph_error(robust, initial) == pytest.approx(graph.error(to_gtsam_values(initial)), rel=1e-9)
    ours = optimize(factors, initial)
    theirs = gtsam.LevenbergMarquardtOptimizer(to_gtsam_graph(factors), to_gtsam_values(initial)).optimize()
    assert ours.error_after == pytest.approx(to_gtsam_graph(factors).error(theirs), rel=1e-6)
    marginals = gtsam.Marginals(to_gtsam_graph(factors), to_gtsam_values(ours.poses))
    covariances = Problem.of(factors, len(truth)).marginal_covariances(ours.poses)
    expected = np.array([marginals.marginalCovariance(k) for k in range(len(truth))])
    np.testing.assert_allclose(covariances, expected, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("name", ["huber", "cauchy", "geman_mcclure", "dcs"])
def test_weights_are_the_slopes_of_the_losses(name: str) -> None:
    # w = ρ′(e) / e = 2 dρ / d(e²), by central differences; the loss is continuous where the kernel begins.
    factor = Factor(
        kind="prior",
        i=None,
        j=0,
        T_i_j=np.zeros(3),
        covariance=np.eye(3),
        kernel=RobustKernel(name=name, width=2.0),  # type: ignore[arg-type]
    )
    problem, h = Problem.of([factor], 1), 1e-5
    for distance in (0.3, 1.2, 1.6, 2.5, 9.0):
        low, here, high = (problem.evaluate(np.array([[d, 0.0, 0.0]])) for d in (distance - h, distance, distance + h))
        slope = (high.losses[0] - low.losses[0]) / (2.0 * h)
        assert here.weights[0] == pytest.approx(slope / distance, rel=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.2, 0.5, 1.0])
def test_false_closures_change_nothing(share: float) -> None:
    factors, truth = laps()
    clean = trajectory_error(optimize(factors, None).poses, truth)
    wrong = false_closures(factors, truth, share, seed=4)
    chained = chained_poses(factors, len(truth))
    for initial in (None, chained):
        result = optimize([*factors, *wrong], initial, BatchConfig(gnc=True, inlier_probability=0.9999))
        assert result.inliers.tolist() == [True] * len(factors) + [False] * len(wrong)
        assert trajectory_error(result.poses, truth) < 1.1 * clean
        robust = optimize([*factors, *wrong], initial, BatchConfig(kernel="dcs"))
        assert trajectory_error(robust.poses, truth) < 1.1 * clean + 0.01
    plain = optimize([*factors, *wrong], chained)
    assert trajectory_error(plain.poses, truth) > 5.0 * clean  # the defence is needed


@pytest.mark.parametrize(("name", "share"), [("intel", 0.5)])
def test_false_closures_in_public_graphs(data_dir: Path, name: str, share: float) -> None:
    graph = read_g2o(data_dir / "posegraph" / f"{name}.g2o")
    factors = list(graph.factors)
    clean = optimize(factors, None).poses
    wrong = false_closures(factors, clean, share, seed=1)
    result = optimize([*factors, *wrong], None, BatchConfig(gnc=True))
    assert not result.inliers[len(factors) :].any()
    assert trajectory_error(result.poses, clean) < 1e-3


@pytest.mark.parametrize(
    ("name", "optimum"),
    [("mit-weak-loops", 20.61), ("m3500-correlated", 1774.6), ("intel", 22.51), ("manhattanOlson3500", 73.04)],
)
def test_public_graphs_find_the_right_valley_without_a_start(data_dir: Path, name: str, optimum: float) -> None:
    graph = read_g2o(data_dir / "posegraph" / f"{name}.g2o")
    assert optimize(graph.factors, None).error_after < optimum


def test_a_heading_jump_of_odometry_yields_to_the_matches() -> None:
    # Odometry turns by 30° once; matches along the way say otherwise. As wide as odometry may be, the kernel decides.
    rng = np.random.default_rng(2)
    step, jump = np.array([0.4, 0.0, 0.05]), np.radians(30.0)
    truth = [np.zeros(3)]
    for _ in range(30):
        truth.append(compose(truth[-1], step))
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=truth[0], covariance=np.eye(3) * 1e-6)]
    for k in range(30):
        wheels = compose(step, np.array([0.0, 0.0, jump if k == 14 else 0.0]))
        odometry, match = (compose(T, expmap(rng.normal(0.0, 0.005, 3))) for T in (wheels, step))
        factors.append(
            Factor(
                kind="odometry",
                i=k,
                j=k + 1,
                T_i_j=odometry,
                covariance=COVARIANCE / 4.0,
                kernel=RobustKernel(name="dcs", width=5.0),
            )
        )
        factors.append(Factor(kind="ice", i=k, j=k + 1, T_i_j=match, covariance=COVARIANCE / 4.0))
    wheels_only = [factor for factor in factors if factor.kind != "ice"]
    for initial in (chained_poses(wheels_only, 31), chained_poses(factors, 31)):
        result = optimize(factors, initial)
        assert np.abs(logmap(between(result.poses, np.array(truth)))[:, 2]).max() < np.radians(3.0)
        assert np.hypot(*(result.poses - np.array(truth))[:, :2].T).max() < 0.25  # 12 m of path; a jump makes 2.5 m
        assert np.flatnonzero(~result.inliers).tolist() == [1 + 2 * 14]
        gnc = optimize(factors, initial, BatchConfig(gnc=True, suspects=("odometry",), inlier_probability=0.9999))
        assert np.flatnonzero(~gnc.inliers).tolist() == [1 + 2 * 14]
    plain = optimize([Factor(kind=f.kind, i=f.i, j=f.j, T_i_j=f.T_i_j, covariance=f.covariance) for f in factors], None)
    assert np.abs(logmap(between(plain.poses, np.array(truth)))[:, 2]).max() > np.radians(10.0)


@pytest.mark.parametrize(("sigmas", "holds"), [(3.2, True), (3.5, False), (6.0, False)])
def test_a_closure_holds_up_to_the_gate_of_its_probability(sigmas: float, holds: bool) -> None:
    # Far stronger steps hold the poses where they are; 99 % of three degrees of freedom lie within 3.37 σ.
    step = np.array([1.0, 0.0, 0.0])
    ties: list[tuple[FactorKind, int, int]] = [("odometry", k, k + 1) for k in range(3)]
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=1e-4 * COVARIANCE)]
    factors += [Factor(kind=kind, i=i, j=j, T_i_j=step, covariance=1e-4 * COVARIANCE) for kind, i, j in ties]
    off = np.array([3.0 + 0.02 * sigmas, 0.0, 0.0])
    factors += [
        Factor(kind="closure", i=0, j=3, T_i_j=np.array([3.0, 0.0, 0.0]), covariance=COVARIANCE),
        Factor(kind="closure", i=0, j=3, T_i_j=off, covariance=COVARIANCE),
    ]
    result = optimize(factors, chained_poses(factors, 4), BatchConfig(gnc=True))
    assert result.inliers.tolist() == [True] * 5 + [holds]


def test_a_closure_that_alone_holds_a_part_is_no_suspect() -> None:
    # Two sessions, tied by one closure: it cannot be judged and must not be dropped.
    def step(i: int, j: int, kind: FactorKind = "odometry") -> Factor:
        return Factor(kind=kind, i=i, j=j, T_i_j=np.array([1.0, 0.0, 0.0]), covariance=COVARIANCE)

    factors = [Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=COVARIANCE)]
    factors += [step(0, 1), step(2, 3), step(1, 3, "closure")]
    result = optimize(factors, np.zeros((4, 3)), BatchConfig(gnc=True))
    assert result.inliers.all()
    np.testing.assert_allclose(result.poses[:, 0], [0.0, 1.0, 1.0, 2.0], atol=1e-6)


def test_the_stages_are_told() -> None:
    factors, _ = laps()
    result = optimize(factors, None, BatchConfig(gnc=True))
    assert [stage.name for stage in result.stages] == ["start", "robust", "gnc"]
    assert result.iterations == sum(stage.iterations for stage in result.stages)
    assert len(result.weights) == len(result.squared_norms) == len(factors)
    again = optimize(factors, None, BatchConfig(gnc=True))
    assert again.poses.tobytes() == result.poses.tobytes()


@pytest.mark.parametrize(
    "settings",
    [
        {"kernel": "foo"},
        {"suspects": ("loop",)},
        {"suspects": "closure"},
        {"kernel_width": 0.0},
        {"inlier_probability": 1.0},
        {"max_iterations": 0},
    ],
)
def test_impossible_settings_are_named(settings: dict[str, object]) -> None:
    with pytest.raises(GraphError, match=next(iter(settings))):
        BatchConfig(**settings)  # type: ignore[arg-type]

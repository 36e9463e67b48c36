"""The pose graph: every factor once, covariances in closed form, recovery from failing updates, removal."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray

from graph.batch import chained_poses, check_determined, graph_error, marginal_covariances, optimize
from graph.config import PoseGraphConfig
from graph.errors import GraphError
from graph.factors import Factor, FactorKind, KernelName, RobustKernel
from graph.g2o import read_g2o
from graph.measurement import MeasurementError, RelativePose
from graph.pose_graph import PoseGraph, Snapshot
from graph.se2 import between, chain_covariance, compose, expmap, logmap, wrap_angle

Array = NDArray[np.float64]

COVARIANCE = np.array([[4e-4, 1e-5, 0.0], [1e-5, 3e-4, 2e-5], [0.0, 2e-5, 1e-4]])
STEP = np.array([0.5, 0.1, 0.3])
FINE = PoseGraphConfig(relinearize_threshold=1e-5, relinearize_skip=1, settle_iterations=10)


def match(T_ref_cur: Array, covariance: Array = COVARIANCE) -> RelativePose:
    return RelativePose(
        T_ref_cur=T_ref_cur,
        covariance=covariance,
        score=0.9,
        inliers=100,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )


def chain(n: int, config: PoseGraphConfig | None = None, seed: int = 0) -> PoseGraph:
    """n poses; odometry and a match between neighbours, both noisy."""
    rng = np.random.default_rng(seed)
    graph = PoseGraph(config)
    graph.add_first_pose(np.zeros(3))
    newest = graph.update()
    for i in range(n - 1):
        odometry = compose(STEP, expmap(rng.normal(0, 0.02, 3)))
        j = graph.add_pose(compose(newest, odometry))
        graph.add_odometry(i, j, odometry, 2 * COVARIANCE)
        graph.add_match(i, j, match(compose(STEP, expmap(rng.normal(0, 0.01, 3)))))
        newest = graph.update()
    return graph


def factors_in_gtsam(graph: PoseGraph) -> int:
    count: int = graph._isam.getFactorsUnsafe().nrFactors()
    return count


def test_every_factor_enters_once_however_often_the_graph_is_asked() -> None:
    graph = chain(20)
    for _ in range(3):
        graph.update()
        graph.all_poses()
        graph.marginal_covariance(7)
    assert len(graph) == 20
    assert len(graph.factors) == factors_in_gtsam(graph) == 1 + 2 * 19
    assert [factor.kind for factor in graph.factors[:3]] == ["prior", "odometry", "ice"]


def test_covariance_of_a_chain_in_closed_form() -> None:
    # Exact odometry and one match per step: the end's covariance is the transported sum of the prior and the steps.
    graph, newest = PoseGraph(), np.array([1.0, 2.0, 0.5])
    prior = np.diag([0.01, 0.02, 0.003])
    graph.add_first_pose(newest, prior)
    steps = np.array([[0.5, 0.1, 0.3], [1.0, 0.0, -2.0], [0.3, 0.3, 3.1]])
    for i, step in enumerate(steps):
        newest = compose(newest, step)
        graph.add_pose(newest)
        graph.add_match(i, i + 1, match(step))
        graph.update()
    # The chain begins with the prior, carried by no motion of its own.
    expected = chain_covariance([np.zeros(3), *steps], np.array([prior, *[COVARIANCE] * 3]))
    np.testing.assert_allclose(graph.marginal_covariance(3), expected, rtol=1e-8)
    np.testing.assert_allclose(graph.marginal_covariances()[3], expected, rtol=1e-8)
    np.testing.assert_allclose(
        graph.relative_covariance(1, 3), chain_covariance(steps[1:], np.array([COVARIANCE] * 2)), atol=1e-10
    )
    np.testing.assert_allclose(graph.relative_covariance(2, 2), 0.0)


def test_two_factors_between_the_same_poses_add_their_information() -> None:
    graph = PoseGraph()
    graph.add_first_pose(np.zeros(3), np.eye(3) * 1e-10)
    graph.add_pose(STEP)
    graph.add_odometry(0, 1, STEP, 2 * COVARIANCE)
    graph.add_match(0, 1, match(STEP))
    # (½ C⁻¹ + C⁻¹)⁻¹ = ⅔ C, not ⅓ C (odometry twice) or ½ C (a match that holds it already).
    np.testing.assert_allclose(graph.marginal_covariance(1), COVARIANCE * 2 / 3, rtol=1e-4, atol=1e-9)


def test_a_match_tells_nothing_along_what_it_does_not_observe() -> None:
    # Odometry is 3 m uncertain. With the 1 m that the match claims there it would be 0.95 m.
    turned = np.array([0.6, 0.8, 0.0])
    claimed = COVARIANCE + np.outer(turned, turned)
    weak = replace(match(STEP, claimed), weak_directions=turned[None])
    graph = PoseGraph()
    graph.add_first_pose(np.zeros(3), np.eye(3) * 1e-10)
    graph.add_pose(STEP)
    graph.add_odometry(0, 1, STEP, 9.0 * np.eye(3))
    graph.add_match(0, 1, weak)
    told = graph.marginal_covariance(1)
    assert turned @ told @ turned == pytest.approx(1.0 / (1.0 / 9.0 + 1.0 / 100.0), rel=1e-3)
    assert np.linalg.eigvalsh(told)[1] < 1e-3


def test_many_closures_of_one_place_tell_nothing_along_what_none_of_them_observes() -> None:
    turned = np.array([0.6, 0.8, 0.0])
    weak = replace(match(STEP, COVARIANCE + np.outer(turned, turned)), weak_directions=turned[None])
    graph = PoseGraph()
    graph.add_first_pose(np.zeros(3), np.eye(3) * 1e-10)
    graph.add_pose(STEP)
    graph.add_odometry(0, 1, STEP, np.diag([0.25, 0.25, 0.01]))
    for _ in range(30):
        graph.add_closure(0, 1, weak, None)
    told = graph.marginal_covariance(1)
    # With the 1 m that each claims there it would be 0.17 m.
    assert turned @ told @ turned > 0.9 * 0.25
    assert np.linalg.eigvalsh(told)[1] < 1e-3


@pytest.mark.parametrize("shape", [(0,), (3,), (1, 2)])
def test_weak_directions_are_rows_of_three(shape: tuple[int, ...]) -> None:
    with pytest.raises(MeasurementError, match=r"\(k, 3\), found shape"):
        replace(match(STEP), weak_directions=np.zeros(shape))


def test_a_loop_shared_between_two_ways_in_closed_form() -> None:
    # Straight ahead with heading known: four steps of variance v against one closure of variance v. Any pose k of the
    # chain has k·v from the near side; with the closure the end has v·4/(4 + 1) and the middle 2v − (2v)²/(4v + v).
    v, graph = 0.01, PoseGraph()
    covariance = np.diag([v, v, 1e-9])
    graph.add_first_pose(np.zeros(3), np.diag([1e-12, 1e-12, 1e-12]))
    for i in range(4):
        graph.add_pose(np.array([i + 1.0, 0.0, 0.0]))
        graph.add_match(i, i + 1, match(np.array([1.0, 0.0, 0.0]), covariance))
    graph.add_closure(0, 4, match(np.array([4.0, 0.0, 0.0]), covariance), None)
    assert graph.marginal_covariance(4)[0, 0] == pytest.approx(v * 4 / 5, rel=1e-4)
    assert graph.marginal_covariance(2)[0, 0] == pytest.approx(2 * v - 4 * v * v / (5 * v), rel=1e-4)


def test_covariances_are_honest_against_truth() -> None:
    # Round a square of 2 m three times, closures on every lap: the normalised squared error of 3 numbers averages 3.
    rng, root = np.random.default_rng(11), np.linalg.cholesky(COVARIANCE)
    squared_errors = []
    for _ in range(60):
        turns = np.where(np.arange(1, 61) % 5 == 0, np.pi / 2, 0.0)
        truth = [np.zeros(3)]
        for turn in turns:
            truth.append(compose(truth[-1], np.array([0.4, 0.0, turn])))
        graph = PoseGraph()
        graph.add_first_pose(truth[0])
        for j in range(1, 61):
            ties = [("odometry", j - 1, 2.0), ("ice", j - 1, 1.0)] + ([("closure", j - 20, 1.0)] if j % 20 == 5 else [])
            measured = [
                (kind, i, compose(between(truth[i], truth[j]), expmap(scale * root @ rng.normal(size=3))), scale)
                for kind, i, scale in ties
                if i >= 0
            ]
            graph.add_pose(compose(graph.pose(j - 1), measured[1][2]))
            for kind, i, T_i_j, scale in measured:
                graph.add(Factor(kind=kind, i=i, j=j, T_i_j=T_i_j, covariance=scale**2 * COVARIANCE))  # type: ignore[arg-type]
            graph.update()
        error = logmap(between(truth[60], graph.pose(60)))
        squared_errors.append(error @ np.linalg.solve(graph.marginal_covariance(60), error))
    # The mean of 60 draws of χ²₃ has a standard deviation of 0.32.
    assert 2.0 < np.mean(squared_errors) < 4.0


def test_growing_and_batch_agree() -> None:
    graph = chain(60, FINE)
    graph.add_closure(0, 59, match(between(np.zeros(3), compose(graph.pose(59), expmap(np.full(3, 0.2))))), None)
    graph.update()
    batch = optimize(graph.factors, graph.all_poses())
    assert batch.error_after <= batch.error_before
    np.testing.assert_allclose(graph.all_poses()[:, :2], batch.poses[:, :2], atol=1e-4)
    covariances = marginal_covariances(graph.factors, batch.poses)
    np.testing.assert_allclose(graph.marginal_covariances(), covariances, atol=1e-3 * np.abs(covariances).max())
    np.testing.assert_allclose(graph.marginal_covariance(40), covariances[40], atol=1e-3 * np.abs(covariances).max())


def test_several_poses_per_update_give_the_same_graph() -> None:
    one_by_one = chain(40)
    at_once = PoseGraph()
    for pose in one_by_one.all_poses():
        at_once.add_pose(pose)
    for factor in one_by_one.factors:
        at_once.add(factor)
    at_once.update()
    assert factors_in_gtsam(at_once) == factors_in_gtsam(one_by_one)
    np.testing.assert_allclose(
        optimize(at_once.factors, at_once.all_poses()).poses,
        optimize(one_by_one.factors, one_by_one.all_poses()).poses,
        atol=1e-7,
    )


def test_same_input_same_bits() -> None:
    np.testing.assert_array_equal(chain(50).all_poses(), chain(50).all_poses())
    np.testing.assert_array_equal(chain(50).marginal_covariances(), chain(50).marginal_covariances())


def test_removed_factor_is_gone_and_its_record_stays() -> None:
    graph = chain(10, FINE)
    before, count = graph.all_poses(), factors_in_gtsam(graph)
    false_loop = graph.add_closure(0, 9, match(np.array([50.0, 0.0, 0.0])), None)
    assert np.abs(graph.all_poses() - before).max() > 1.0
    graph.remove(false_loop)
    np.testing.assert_allclose(graph.all_poses(), before, atol=1e-4)
    assert factors_in_gtsam(graph) == count == len(graph.factors)
    assert graph.factor(false_loop).kind == "closure"
    with pytest.raises(GraphError, match="not in force"):
        graph.remove(false_loop)
    # What comes later still lands in its own place.
    again = graph.add_closure(0, 9, match(between(before[0], before[9])), None)
    graph.update()
    graph.remove(again)
    assert factors_in_gtsam(graph) == count


def test_a_factor_that_holds_the_graph_together_cannot_be_removed() -> None:
    graph = PoseGraph()
    graph.add_first_pose(np.zeros(3))
    graph.add_pose(STEP)
    only = graph.add_odometry(0, 1, STEP, COVARIANCE)
    graph.update()
    with pytest.raises(GraphError, match=r"odometry 0→1.*must stay"):
        graph.remove(only)
    np.testing.assert_allclose(graph.pose(1), STEP, atol=1e-9)


def test_restore_returns_to_the_snapshot_exactly() -> None:
    graph = chain(15)
    snapshot, before = graph.snapshot(), graph.all_poses()
    for _ in range(2):
        graph.add_closure(0, 14, match(np.array([9.0, 9.0, 1.0])), None)
        graph.add_pose(compose(graph.pose(14), STEP))
        graph.add_odometry(14, 15, STEP, COVARIANCE)
        graph.update()
        graph.restore(snapshot)
        np.testing.assert_array_equal(graph.all_poses(), before)
        assert len(graph) == 15
        assert len(graph.factors) == factors_in_gtsam(graph) == 29


@pytest.mark.parametrize("name", ["geman_mcclure", "dcs"])
def test_robust_kernel_withstands_a_false_loop(name: KernelName) -> None:
    graph = chain(30)
    honest = graph.all_poses()
    graph.add_closure(0, 29, match(np.array([30.0, -20.0, 1.0])), RobustKernel(name=name))
    robust = optimize(graph.factors, graph.all_poses()).poses
    plain = optimize(
        [
            *graph.factors[:-1],
            Factor(kind="closure", i=0, j=29, T_i_j=np.array([30.0, -20.0, 1.0]), covariance=COVARIANCE),
        ],
        honest,
    ).poses
    assert np.abs(robust - honest).max() < 0.02
    assert np.abs(plain - honest).max() > 1.0


@pytest.mark.parametrize("name", ["huber", "cauchy", "geman_mcclure", "dcs"])
def test_robust_kernels_leave_a_true_loop_alone(name: KernelName) -> None:
    graph = chain(10)
    true = between(graph.pose(0), graph.pose(9))
    poses = graph.all_poses()
    graph.add_closure(0, 9, match(true), RobustKernel(name=name, width=3.0))
    np.testing.assert_allclose(graph.all_poses(), poses, atol=1e-3)


def test_a_pose_tied_to_nothing_is_named_before_anything_happens() -> None:
    graph = chain(5)
    graph.add_pose(np.zeros(3))
    with pytest.raises(GraphError, match="pose 5 hangs on no factor"):
        graph.update()
    graph.add_odometry(4, 5, STEP, COVARIANCE)
    assert len(graph.all_poses()) == 6


def test_two_new_poses_tied_only_to_each_other_are_refused() -> None:
    graph = chain(5)
    graph.add_pose(np.zeros(3))
    graph.add_pose(np.zeros(3))
    graph.add_odometry(5, 6, STEP, COVARIANCE)
    with pytest.raises(GraphError, match="pose 5 hangs"):
        graph.update()
    graph.add_closure(2, 6, match(STEP), None)
    assert len(graph.all_poses()) == 7


class FailingISAM:
    """An iSAM2 whose updates fail as GTSAM's do: the new factors stay inside."""

    def __init__(self, isam: gtsam.ISAM2) -> None:
        self._isam = isam

    def update(self, *arguments: Any, **settings: Any) -> None:
        self._isam.update(*arguments, **settings)
        raise RuntimeError("Indeterminate linear system detected while working near variable\n3 (Symbol: 3).")

    def __getattr__(self, name: str) -> object:
        return getattr(self._isam, name)


@pytest.mark.parametrize("snapshot", [True, False])
def test_failing_update_is_retried_with_qr_and_counts_nothing_twice(snapshot: bool) -> None:
    graph = chain(12, PoseGraphConfig(snapshot_before_closure=snapshot))
    expected = chain(12)
    T = between(expected.pose(0), compose(expected.pose(11), expmap(np.full(3, 0.05))))
    expected.add_closure(0, 11, match(T), None)
    graph._isam = failing_once(graph, copyable=snapshot)
    graph.add_closure(0, 11, match(T), None)
    graph.update()
    assert graph.factorization == "QR"
    assert len(graph.factors) == factors_in_gtsam(graph) == 24
    same = optimize(expected.factors, expected.all_poses()).poses
    np.testing.assert_allclose(graph.all_poses(), same, atol=2e-3)
    graph.remove(23)
    assert factors_in_gtsam(graph) == 23


def failing_once(graph: PoseGraph, *, copyable: bool) -> gtsam.ISAM2:
    """The graph's iSAM2, made to fail at its next update."""
    if copyable:
        genuine = gtsam.ISAM2(graph._isam)
        graph._snapshot = snapshot_of(graph, genuine)  # type: ignore[method-assign]
    return FailingISAM(graph._isam)  # type: ignore[return-value]


def snapshot_of(graph: PoseGraph, genuine: gtsam.ISAM2) -> Callable[[], Snapshot]:
    failing = PoseGraph._snapshot

    def snapshot() -> Snapshot:
        broken, graph._isam = graph._isam, genuine
        try:
            return failing(graph)
        finally:
            graph._isam = broken

    return snapshot


@pytest.mark.parametrize("kind", ["closure", "odometry"])
def test_hopeless_update_is_undone_and_names_variable_and_factors(
    kind: FactorKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = chain(6)
    before, indices = graph.all_poses(), len(graph.factors)
    genuine = PoseGraph._rebuild

    def hopeless(self: PoseGraph, in_force: list[int], known: gtsam.Values) -> None:
        if len(in_force) > indices:
            raise RuntimeError("Indeterminate linear system detected while working near variable\n3 (Symbol: 3).")
        genuine(self, in_force, known)

    monkeypatch.setattr(PoseGraph, "_rebuild", hopeless)
    graph._isam = failing_once(graph, copyable=kind == "closure")
    graph.add_pose(compose(before[5], STEP))
    graph.add(Factor(kind="odometry", i=5, j=6, T_i_j=STEP, covariance=COVARIANCE))
    graph.add(Factor(kind=kind, i=3, j=6, T_i_j=STEP, covariance=COVARIANCE))
    with pytest.raises(GraphError, match=rf"near pose 3; factors at it: .*#7 odometry 3→4.*{kind} 3→6.*as it was"):
        graph.update()
    assert len(graph) == 6
    assert len(graph.factors) == indices == factors_in_gtsam(graph)
    np.testing.assert_allclose(graph.all_poses(), before, atol=1e-3)
    graph.add_pose(compose(before[5], STEP))
    graph.add_odometry(5, 6, STEP, COVARIANCE)
    np.testing.assert_allclose(graph.update(), compose(graph.pose(5), STEP), atol=1e-6)


def test_a_graph_rebuilt_from_its_records_is_the_same() -> None:
    graph = chain(25, FINE)
    again = PoseGraph.from_factors(graph.factors, graph.all_poses(), FINE)
    np.testing.assert_allclose(again.all_poses(), graph.all_poses(), atol=1e-4)
    assert factors_in_gtsam(again) == factors_in_gtsam(graph)


def test_chained_poses_follow_the_way_not_a_false_loop() -> None:
    graph = chain(12)
    false_loop = Factor(kind="closure", i=0, j=11, T_i_j=np.array([99.0, 0, 0]), covariance=1e-3 * COVARIANCE)
    poses = chained_poses([*graph.factors, false_loop], 12)
    assert np.abs(poses[:, :2]).max() < 20.0
    np.testing.assert_allclose(between(poses[3], poses[4]), graph.factors[8].T_i_j, atol=1e-9)  # the match, the tighter


def test_a_pose_may_hang_on_a_later_one() -> None:
    prior = Factor(kind="prior", i=None, j=3, T_i_j=STEP, covariance=COVARIANCE)
    steps = [Factor(kind="odometry", i=i, j=j, T_i_j=STEP, covariance=COVARIANCE) for i, j in ((0, 3), (3, 1), (1, 2))]
    check_determined([prior, *steps], 4)
    with pytest.raises(GraphError, match=r"2 of 4 poses .* the first is pose 1"):
        check_determined([prior, *steps[::2]], 4)


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ([], "none of the 0 factors is a prior"),
        ([Factor(kind="prior", i=None, j=0, T_i_j=STEP, covariance=COVARIANCE)], "1 of 2 poses .* the first is pose 1"),
        ([Factor(kind="odometry", i=0, j=5, T_i_j=STEP, covariance=COVARIANCE)], "odometry 0→5 joins a pose"),
    ],
)
def test_an_undetermined_graph_is_refused(factors: list[Factor], message: str) -> None:
    for refuse in (check_determined, chained_poses):
        with pytest.raises(GraphError, match=message):
            refuse(factors, 2)
    with pytest.raises(GraphError, match=message):
        optimize(factors, np.zeros((2, 3)))


@pytest.mark.parametrize("ask", [optimize, graph_error, marginal_covariances])
@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (np.zeros((1, 3)), "odometry 0→1 joins a pose that is not among the 1 there are"),
        (np.zeros((3, 2)), r"found poses of shape \(3, 2\), expected \(n, 3\)"),
        (np.zeros(3), r"found poses of shape \(3,\), expected \(n, 3\)"),
        (np.full((3, 3), np.nan), "found NaN or infinity in the poses, expected finite numbers"),
    ],
)
def test_poses_that_are_not_those_of_the_factors_are_refused(
    ask: Callable[[list[Factor], Array], object], poses: Array, message: str
) -> None:
    prior = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=COVARIANCE)
    steps = [Factor(kind="odometry", i=i, j=i + 1, T_i_j=STEP, covariance=COVARIANCE) for i in range(2)]
    with pytest.raises(GraphError, match=message):
        ask([prior, *steps], poses)


def test_a_factor_before_the_first_pose_is_no_prior() -> None:
    prior = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=COVARIANCE)
    stray = Factor(kind="odometry", i=-1, j=0, T_i_j=STEP, covariance=COVARIANCE)
    with pytest.raises(GraphError, match="odometry -1→0 joins a pose"):
        graph_error([prior, stray], np.zeros((1, 3)))


@pytest.mark.parametrize(
    "act",
    [
        lambda graph: graph.add_first_pose(np.zeros(3)),
        lambda graph: graph.add_odometry(0, 9, STEP, COVARIANCE),
        lambda graph: graph.add_odometry(1, 1, STEP, COVARIANCE),
        lambda graph: graph.add_odometry(0, -1, STEP, COVARIANCE),
        lambda graph: graph.add_odometry(0, 1, STEP * np.nan, COVARIANCE),
        lambda graph: graph.add_odometry(0, 1, STEP, np.zeros((3, 3))),
        lambda graph: graph.add_pose(np.array([0.0, np.inf, 0.0])),
        lambda graph: graph.pose(3),
        lambda graph: graph.pose(-1),
        lambda graph: graph.marginal_covariance(3),
        lambda graph: graph.remove(99),
    ],
)
def test_misuse_is_an_error_and_changes_nothing(act: Callable[[PoseGraph], object]) -> None:
    graph = chain(3)
    before = graph.all_poses()
    with pytest.raises(GraphError):
        act(graph)
    np.testing.assert_array_equal(graph.all_poses(), before)
    assert len(graph.factors) == factors_in_gtsam(graph) == 5


def test_an_empty_graph_answers() -> None:
    graph = PoseGraph()
    assert len(graph) == 0
    assert graph.all_poses().shape == (0, 3)
    assert graph.marginal_covariances().shape == (0, 3, 3)
    with pytest.raises(GraphError, match="no poses"):
        graph.update()


def test_first_pose_is_key_zero_and_counts() -> None:
    graph = PoseGraph()
    assert graph.add_first_pose(np.array([1.0, 2.0, -3.0])) == 0
    np.testing.assert_allclose(graph.update(), [1.0, 2.0, -3.0], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(graph.marginal_covariance(0))), 1e-3)


def test_records_refuse_what_makes_no_sense() -> None:
    with pytest.raises(GraphError, match="kind"):
        Factor(kind="guess", i=0, j=1, T_i_j=STEP, covariance=COVARIANCE)  # type: ignore[arg-type]
    with pytest.raises(GraphError, match="prior"):
        Factor(kind="prior", i=0, j=1, T_i_j=STEP, covariance=COVARIANCE)
    with pytest.raises(GraphError, match="robust kernel is one of"):
        RobustKernel(name="l1")  # type: ignore[arg-type]
    with pytest.raises(GraphError, match="width"):
        RobustKernel(name="dcs", width=0.0)


def test_records_do_not_change_with_the_arrays_they_were_made_of() -> None:
    T, covariance = STEP.copy(), COVARIANCE.copy()
    factor = Factor(kind="ice", i=0, j=1, T_i_j=T, covariance=covariance)
    T[:], covariance[:] = 7.0, 7.0
    np.testing.assert_array_equal(factor.T_i_j, STEP)
    np.testing.assert_array_equal(factor.covariance, COVARIANCE)


@pytest.mark.parametrize(
    "settings", [{"relinearize_skip": 0}, {"settle_iterations": -1}, {"factorization": "LU"}, {"prior_sigma": 0.0}]
)
def test_impossible_settings_are_named(settings: dict[str, object]) -> None:
    with pytest.raises(GraphError, match=next(iter(settings))):
        PoseGraphConfig(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "n_poses"), [("m3500-correlated", 760), ("mit-weak-loops", 808)])
def test_cholesky_gives_way_to_qr_on_ill_conditioned_graphs(data_dir: Path, name: str, n_poses: int) -> None:
    whole = read_g2o(data_dir / "posegraph" / f"{name}.g2o")
    factors = [factor for factor in whole.factors if max(factor.i or 0, factor.j) < n_poses]
    graph = PoseGraph(PoseGraphConfig(settle_iterations=0, snapshot_before_closure=False))
    newest = np.zeros(3)
    for key, at_key in enumerate(by_newest_pose(factors, n_poses)):
        odometry = next((factor.T_i_j for factor in at_key if factor.i == key - 1), None)
        graph.add_pose(whole.poses[key] if odometry is None else compose(newest, odometry))
        for factor in at_key:
            graph.add(factor)
        newest = graph.update()
    assert graph.factorization == "QR"
    assert len(graph.factors) == factors_in_gtsam(graph) == len(factors)
    poses = graph.all_poses()
    batch = optimize(factors, poses)
    # iSAM2 linearises anew only what moved by 0.1, so a batch from its answer gains little and moves nothing far.
    assert graph_error(factors, poses) < 1.2 * batch.error_after + 1.0
    assert np.abs(poses[:, :2] - batch.poses[:, :2]).max() < 0.1
    assert np.abs(wrap_angle(poses[:, 2] - batch.poses[:, 2])).max() < 0.05


def by_newest_pose(factors: list[Factor], n_poses: int) -> list[list[Factor]]:
    grouped: list[list[Factor]] = [[] for _ in range(n_poses)]
    for factor in factors:
        grouped[max(factor.i or 0, factor.j)].append(factor)
    return grouped

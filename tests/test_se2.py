"""SE(2) is a group, agrees with GTSAM, and its Jacobians with finite differences; near 0 and near π on purpose."""

import math
from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph import se2

Array = NDArray[np.float64]

ANGLES = st.one_of(
    st.floats(-math.pi, math.pi),
    st.floats(-1e-3, 1e-3),
    st.floats(-1e-9, 1e-9),
    st.floats(math.pi - 1e-6, math.pi),
    st.floats(-math.pi, -math.pi + 1e-6),
    st.sampled_from([0.0, math.pi, -math.pi, 1e-4, -1e-4, math.pi / 2]),
)
LENGTHS = st.floats(-50.0, 50.0)
POSES = st.builds(lambda x, y, h: np.array([x, y, h]), LENGTHS, LENGTHS, ANGLES)
BATCHES = st.integers(0, 2**32 - 1).map(lambda seed: random_poses(seed, 7))


def random_poses(seed: int, n: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-50, 50, (n, 2)), rng.uniform(-math.pi, math.pi, n)])


def assert_same_pose(found: Array, expected: Array, tolerance: float = 1e-9) -> None:
    assert found.shape == expected.shape
    np.testing.assert_allclose(found[..., :2], expected[..., :2], atol=tolerance, rtol=0)
    np.testing.assert_allclose(se2.wrap_angle(found[..., 2] - expected[..., 2]), 0.0, atol=tolerance)


def pose_of(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])


def random_covariance(seed: int) -> Array:
    root = np.random.default_rng(seed).normal(size=(3, 3))
    covariance: Array = root @ root.T + 0.1 * np.eye(3)
    return covariance


@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_lies_in_the_half_open_interval_and_means_the_same(angle: float) -> None:
    wrapped = se2.wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped - angle), 1.0, abs_tol=1e-12)
    assert wrapped == se2.wrap_angle(np.array([angle]))[0]


@given(ANGLES)
def test_wrapping_keeps_every_bit_of_an_angle_already_inside(angle: float) -> None:
    expected = math.pi if angle == -math.pi else angle
    assert se2.wrap_angle(angle) == expected


def test_minus_pi_becomes_pi_even_one_step_beyond() -> None:
    beyond = np.nextafter(math.pi, 4.0)
    np.testing.assert_array_equal(se2.wrap_angle(np.array([-math.pi, math.pi])), [math.pi, math.pi])
    assert -math.pi < se2.wrap_angle(float(beyond)) < -3.14
    assert 3.14 < se2.wrap_angle(float(-beyond)) <= math.pi


@given(POSES, POSES, POSES)
def test_composition_is_associative(a: Array, b: Array, c: Array) -> None:
    assert_same_pose(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@given(POSES)
def test_identity_and_inverse(a: Array) -> None:
    assert_same_pose(se2.compose(a, np.zeros(3)), a)
    assert_same_pose(se2.compose(np.zeros(3), a), a)
    assert_same_pose(se2.compose(a, se2.inverse(a)), np.zeros(3))
    assert_same_pose(se2.compose(se2.inverse(a), a), np.zeros(3))
    assert_same_pose(se2.inverse(se2.inverse(a)), a)


@given(POSES, POSES)
def test_between_is_inverse_times(a: Array, b: Array) -> None:
    assert_same_pose(se2.between(a, b), se2.compose(se2.inverse(a), b))
    assert_same_pose(se2.compose(a, se2.between(a, b)), b)


@given(POSES, POSES)
def test_points_follow_composition(a: Array, b: Array) -> None:
    points = np.array([[0.0, 0.0], [1.0, -2.0], [30.0, 4.0]])
    moved = se2.transform_points(a, se2.transform_points(b, points))
    np.testing.assert_allclose(moved, se2.transform_points(se2.compose(a, b), points), atol=1e-9)


@given(POSES)
def test_exp_undoes_log(a: Array) -> None:
    assert_same_pose(se2.expmap(se2.logmap(a)), a)


@given(st.floats(-20, 20), st.floats(-20, 20), ANGLES)
def test_log_undoes_exp(u: float, v: float, theta: float) -> None:
    xi = np.array([u, v, se2.wrap_angle(theta)])
    np.testing.assert_allclose(se2.logmap(se2.expmap(xi)), xi, atol=1e-8)


@given(POSES, st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_adjoint_moves_a_perturbation_to_the_other_side(a: Array, u: float, v: float, w: float) -> None:
    xi = np.array([u, v, w])
    assert_same_pose(se2.compose(a, se2.expmap(xi)), se2.compose(se2.expmap(se2.adjoint(a) @ xi), a), 1e-8)


@given(POSES, POSES)
def test_agrees_with_gtsam(a: Array, b: Array) -> None:
    first, second = gtsam.Pose2(*a), gtsam.Pose2(*b)
    assert_same_pose(se2.compose(a, b), pose_of(first.compose(second)))
    assert_same_pose(se2.between(a, b), pose_of(first.between(second)))
    assert_same_pose(se2.inverse(a), pose_of(first.inverse()))
    np.testing.assert_allclose(se2.adjoint(a), first.AdjointMap(), atol=1e-9)
    xi = np.array([b[0] / 50, b[1] / 50, 0.9 * b[2]])
    # GTSAM's exponential itself loses about 1e-6 to cancellation at turns of 1e-9 rad.
    assert_same_pose(se2.expmap(xi), pose_of(gtsam.Pose2.Expmap(xi)), 1e-5)
    assert_same_pose(se2.compose(a, se2.expmap(xi)), pose_of(first.retract(xi)), 1e-5)
    if abs(b[2]) < math.pi - 1e-7:
        np.testing.assert_allclose(se2.logmap(b), gtsam.Pose2.Logmap(second), atol=1e-4)


@given(BATCHES, BATCHES)
def test_batches_equal_single_poses(a: Array, b: Array) -> None:
    for operation in (se2.compose, se2.between):
        whole = operation(a, b)
        np.testing.assert_allclose(whole, [operation(p, q) for p, q in zip(a, b, strict=True)], atol=1e-12)
        np.testing.assert_allclose(operation(a[0], b), [operation(a[0], q) for q in b], atol=1e-12)
        np.testing.assert_allclose(operation(a, b[0]), [operation(p, b[0]) for p in a], atol=1e-12)
        assert operation(a[:, None], b[None]).shape == (7, 7, 3)
    for function in (se2.inverse, se2.expmap, se2.logmap, se2.adjoint):
        np.testing.assert_allclose(function(a), [function(p) for p in a], atol=1e-12)
    points = b[:, :2]
    each = [se2.transform_points(p, points) for p in a]
    np.testing.assert_allclose(se2.transform_points(a[:, None], points), each, atol=1e-12)


@pytest.mark.parametrize("pair_up", [se2.compose, se2.between])
def test_batches_broadcast_digit_for_digit(pair_up: Callable[[Array, Array], Array]) -> None:
    several, others = random_poses(0, 12).reshape(4, 3, 3)[:, ::2], random_poses(1, 4)
    several.flags.writeable = False
    found = pair_up(several, others[:, None])
    expected = [[pair_up(one, other) for one in row] for row, other in zip(several, others, strict=True)]
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(pair_up(others[0], others), [pair_up(others[0], other) for other in others])
    assert pair_up(np.empty((0, 3)), others[0]).shape == (0, 3)


@pytest.mark.parametrize("shape", [(2, 2), (2, 4), (2, 1)])
def test_poses_of_another_width_are_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"broadcast|3"):
        se2.compose(np.zeros((2, 3)), np.zeros(shape))


@pytest.mark.parametrize("theta", [0.0, 1e-12, 9.9e-5, 1.01e-4, -1e-3, math.pi, -3.1415926])
def test_batch_and_single_exp_and_log_agree_where_the_series_takes_over(theta: float) -> None:
    xi = np.array([1.3, -0.7, theta])
    np.testing.assert_allclose(se2.expmap(xi[None])[0], se2.expmap(xi), atol=1e-15)
    np.testing.assert_allclose(se2.logmap(xi[None])[0], se2.logmap(xi), atol=1e-15)


def test_exp_of_a_quarter_circle() -> None:
    # Driving along a circle of radius 2 m for a quarter turn ends at (2, 2), heading up.
    assert_same_pose(se2.expmap(np.array([math.pi, 0.0, math.pi / 2])), np.array([2.0, 2.0, math.pi / 2]))


def derivative(function: Callable[[Array], Array], at: Array) -> Array:
    """Central differences in the tangent spaces at the argument and at the result."""
    step, centre = 1e-6, function(at)
    columns = [
        (
            se2.logmap(se2.between(centre, function(se2.compose(at, se2.expmap(step * axis)))))
            - se2.logmap(se2.between(centre, function(se2.compose(at, se2.expmap(-step * axis)))))
        )
        / (2 * step)
        for axis in np.eye(3)
    ]
    return np.column_stack(columns)


@given(POSES, POSES)
def test_jacobians_equal_finite_differences(a: Array, b: Array) -> None:
    by_a, by_b = se2.compose_jacobians(a, b)
    np.testing.assert_allclose(by_a, derivative(lambda p: se2.compose(p, b), a), atol=1e-6, rtol=1e-6)
    np.testing.assert_allclose(by_b, derivative(lambda p: se2.compose(a, p), b), atol=1e-6, rtol=1e-6)
    by_a, by_b = se2.between_jacobians(a, b)
    np.testing.assert_allclose(by_a, derivative(lambda p: se2.between(p, b), a), atol=1e-6, rtol=1e-6)
    np.testing.assert_allclose(by_b, derivative(lambda p: se2.between(a, p), b), atol=1e-6, rtol=1e-6)


def test_jacobians_broadcast() -> None:
    a, b = random_poses(1, 5), random_poses(2, 5)
    for jacobians in (se2.compose_jacobians, se2.between_jacobians):
        whole = jacobians(a, b[0])
        for index in range(5):
            for one, many in zip(jacobians(a[index], b[0]), whole, strict=True):
                np.testing.assert_allclose(many[index], one, atol=1e-12)


@given(POSES, POSES)
def test_covariance_there_and_back_is_the_same(a: Array, b: Array) -> None:
    covariance = random_covariance(3)
    back = se2.inverse_covariance(se2.inverse(a), se2.inverse_covariance(a, covariance))
    np.testing.assert_allclose(back, covariance, atol=1e-6)
    # Composing with an exact pose and taking it off again changes nothing.
    carried = se2.compose_covariance(covariance, b, np.zeros((3, 3)))
    np.testing.assert_allclose(se2.compose_covariance(carried, se2.inverse(b), np.zeros((3, 3))), covariance, atol=1e-6)


def test_chain_covariance_of_a_straight_line_in_closed_form() -> None:
    # n steps of length d straight ahead, each with variances (a, b, w): x gathers n·a, the heading n·w, and the k-th
    # heading error swings the (n − k)·d that follow: y gathers n·b + w·d²·Σ(n − k)², and y with heading w·d·Σ(n − k).
    n, d, a, b, w = 6, 0.5, 0.01, 0.02, 0.003
    remaining = np.arange(n)[::-1]
    expected = np.array(
        [
            [n * a, 0.0, 0.0],
            [0.0, n * b + w * d**2 * (remaining**2).sum(), w * d * remaining.sum()],
            [0.0, w * d * remaining.sum(), n * w],
        ]
    )
    steps, covariances = np.tile([d, 0.0, 0.0], (n, 1)), np.tile(np.diag([a, b, w]), (n, 1, 1))
    np.testing.assert_allclose(se2.chain_covariance(steps, covariances), expected, atol=1e-12)
    np.testing.assert_array_equal(se2.chain_covariance(np.zeros((0, 3)), np.zeros((0, 3, 3))), np.zeros((3, 3)))


def test_transported_covariances_equal_a_sampled_cloud() -> None:
    rng = np.random.default_rng(5)
    a, b = np.array([1.0, 2.0, 0.7]), np.array([3.0, -1.0, -2.0])
    scale = 1e-6
    joint_root = rng.normal(size=(6, 6)) * scale
    joint = joint_root @ joint_root.T
    errors = rng.normal(size=(200_000, 6)) @ joint_root.T
    noisy_a, noisy_b = se2.compose(a, se2.expmap(errors[:, :3])), se2.compose(b, se2.expmap(errors[:, 3:]))
    cloud = np.cov(se2.logmap(se2.between(se2.between(a, b), se2.between(noisy_a, noisy_b))).T)
    found = se2.between_covariance(a, joint[:3, :3], b, joint[3:, 3:], joint[:3, 3:])
    np.testing.assert_allclose(found, cloud, atol=0.02 * np.abs(cloud).max())
    independent = se2.between_covariance(a, joint[:3, :3], b, joint[3:, 3:])
    assert np.abs(independent - cloud).max() > 0.05 * np.abs(cloud).max()


def test_two_poses_of_a_chain_give_the_covariance_of_the_step_between_them() -> None:
    # b = a · step: with the cross covariance taken into account, what lies before a cancels.
    a, step = np.array([4.0, -3.0, 1.0]), np.array([0.8, 0.1, 0.4])
    before, own = random_covariance(7), random_covariance(8) * 0.01
    b = se2.compose(a, step)
    covariance_b = se2.compose_covariance(before, step, own)
    carry, _ = se2.compose_jacobians(a, step)
    found = se2.between_covariance(a, before, b, covariance_b, cross=before @ carry.T)
    np.testing.assert_allclose(found, own, atol=1e-10)

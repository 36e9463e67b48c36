"""The feature map: association, fusion, promotion, anchoring, and forgetting what is no longer there."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from frontends.scan import Scan, ScanGeometry
from iceg.ice.features import CORNER, END_OF_WALL, INTERSECTION, Features
from iceg.maps import _association_kernels as kernels
from iceg.maps import _landmark_kernels
from iceg.maps import feature_map as feature_map_module
from iceg.maps.config import FeatureMapConfig, FeatureMapError
from iceg.maps.feature_map import FeatureMap, Landmarks, build_feature_map
from tests.kernels import from_python
from tests.walls import distances

close_pairs = from_python(kernels._close_pairs)
ascending = from_python(kernels._ascending)
first_from = from_python(_landmark_kernels._first_from)
wrap = from_python(kernels._wrap)
wrap_line = from_python(kernels._wrap_line)

F64 = NDArray[np.float64]
NAN = math.nan
HOME = np.zeros(3)
BEARINGS = np.radians(np.arange(-90.0, 91.0))


def laser(mount: ArrayLike = (0.0, 0.0, 0.0)) -> ScanGeometry:
    return ScanGeometry(
        bearings=BEARINGS, range_min=0.05, range_max=20.0, T_robot_laser=np.array(mount, dtype=np.float64)
    )


def scan_of(*walls: tuple[float, float, float, float], mount: ArrayLike = (0.0, 0.0, 0.0), reach: float = 20.0) -> Scan:
    """What the laser sees of walls (x, y, x, y), in the robot frame; NaN beyond reach."""
    geometry = laser(mount)
    ranges = distances(np.array(walls).reshape(-1, 4), geometry.T_robot_laser, BEARINGS)
    return Scan(ranges=np.where(ranges < reach, ranges, np.nan).astype(np.float32), geometry=geometry)


def features_of(*rows: tuple[int, float, float, float, float], sigma: float = 0.02, real: bool = True) -> Features:
    """Features from rows kind, x, y, clockwise heading, counter-clockwise heading."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return Features(
        kinds=table[:, 0].astype(np.int8),
        positions=table[:, 1:3],
        directions=table[:, 3:],
        covariances=np.tile(sigma**2 * np.eye(2), (len(table), 1, 1)),
        direction_variances=np.full(len(table), 0.02**2),
        distances=np.hypot(table[:, 1], table[:, 2]),
        real=np.full(len(table), real),
    )


def seen_from(T_map_key: F64, *rows: tuple[int, float, float, float, float]) -> Features:
    """The same with rows given in the map frame."""
    x, y, heading = T_map_key
    cos, sin = math.cos(heading), math.sin(heading)
    return features_of(
        *(
            (k, cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x), a - heading, b - heading)
            for k, px, py, a, b in rows
        )
    )


NOTHING = features_of()
BACK = (8.0, -20.0, 8.0, 20.0)  # a far wall, so that beams return
WALL = (3.0, -1.0, 3.0, 1.0)  # a free-standing wall ahead, both ends in sight
ENDS = ((END_OF_WALL, 3.0, -1.0, NAN, math.pi / 2), (END_OF_WALL, 3.0, 1.0, -math.pi / 2, NAN))


def observed(times: int, features: Features, scan: Scan, feature_map: FeatureMap | None = None) -> FeatureMap:
    feature_map = feature_map or FeatureMap()
    first = int(feature_map.record().last_seen.max(initial=-1)) + 1
    for key in range(first, first + times):
        feature_map.observe(key, HOME, features, scan)
    return feature_map


# Association and fusion


def test_features_seen_again_from_elsewhere_are_the_same_landmarks() -> None:
    world = (
        (CORNER, 4.0, 2.0, 0.3, 1.8),
        (CORNER, 4.0, -2.0, 2.0, 3.3),
        (END_OF_WALL, 5.0, 0.5, NAN, 1.0),
        (INTERSECTION, 6.0, 1.0, 0.0, 1.5),
    )
    poses = np.stack([np.linspace(0, 2, 20), np.linspace(0, -1, 20), np.linspace(-0.3, 0.4, 20)], axis=1)
    scan = scan_of(BACK)
    feature_map = build_feature_map(poses, [seen_from(pose, *world) for pose in poses], [scan] * 20)
    landmarks = feature_map.landmarks()
    np.testing.assert_array_equal(landmarks.kinds, [row[0] for row in world])
    np.testing.assert_allclose(landmarks.positions, [row[1:3] for row in world], atol=1e-9)
    difference = landmarks.directions - np.array([row[3:] for row in world])
    np.testing.assert_allclose(np.sin(difference[np.isfinite(difference)]), 0, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(landmarks.directions), [[0, 0], [0, 0], [1, 0], [0, 0]])
    np.testing.assert_array_equal(landmarks.seen, 20)
    np.testing.assert_array_equal(landmarks.missed, 0)
    np.testing.assert_array_equal(landmarks.first_seen, 0)
    np.testing.assert_array_equal(landmarks.last_seen, 19)
    np.testing.assert_array_equal(landmarks.anchors, 0)


def fuse_slowly(p: F64, P: F64, z: F64, R: F64, p_robot: F64, config: FeatureMapConfig) -> tuple[F64, F64]:
    """The Kalman update in matrices, in the frame of the observing robot."""
    across = np.array([-p_robot[1], p_robot[0]])
    P = P + config.drift_sigma**2 * np.eye(2)
    noise = R + config.pose_sigma**2 * np.eye(2) + config.heading_sigma**2 * np.outer(across, across)
    gain = P @ np.linalg.inv(P + noise)
    return p + gain @ (z - p), (np.eye(2) - gain) @ P


@settings(max_examples=50)
@given(st.integers(0, 10**6))
def test_fusion_equals_the_filter_in_matrices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    config = FeatureMapConfig(max_distance=2.0, gate=1e6)
    feature_map = FeatureMap(config)
    poses = rng.uniform([-1, -1, -3], [1, 1, 3], (6, 3))
    p_map, P_map = np.zeros(2), np.zeros((2, 2))
    for key, pose in enumerate(poses):
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        rotation = np.array([[cos, -sin], [sin, cos]])
        z_map = np.array([3.0, 1.0]) + rng.normal(0, 0.05, 2)
        root = rng.normal(0, 0.05, (2, 2))
        R = root @ root.T + 1e-4 * np.eye(2)
        z = rotation.T @ (z_map - pose[:2])
        direction = np.array([[0.5 - pose[2], NAN]])
        feature_map.observe(
            key,
            pose,
            Features(
                kinds=np.array([END_OF_WALL], np.int8),
                positions=z[None],
                directions=direction,
                covariances=R[None],
                direction_variances=np.array([1e-3]),
                distances=np.array([3.0]),
                real=np.array([True]),
            ),
            scan_of(),
        )
        if key == 0:
            p_map, P_map = z_map, rotation @ R @ rotation.T
        else:
            p, P = fuse_slowly(rotation.T @ (p_map - pose[:2]), rotation.T @ P_map @ rotation, z, R, z, config)
            p_map, P_map = rotation @ p + pose[:2], rotation @ P @ rotation.T
    landmarks = feature_map.landmarks()
    assert len(landmarks) == 1
    np.testing.assert_allclose(landmarks.positions[0], p_map, atol=1e-9)
    np.testing.assert_allclose(landmarks.covariances[0], P_map, atol=1e-12)
    assert (np.linalg.eigvalsh(landmarks.covariances[0]) > 0).all()


@pytest.mark.parametrize(
    ("other", "same"),
    [
        pytest.param((CORNER, 3.03, 1.0, 0.1, 1.6), True, id="same corner"),
        pytest.param((CORNER, 3.0, 1.5, 0.0, 1.5), False, id="too far"),
        pytest.param((CORNER, 3.0, 1.2, 0.0, 1.5), False, id="farther than the covariances allow"),
        pytest.param((CORNER, 3.0, 1.0, 0.5, 2.0), False, id="turned"),
        pytest.param((CORNER, 3.0, 1.0, 0.0, 2.1), False, id="another opening"),
        pytest.param((CORNER, 3.0, 1.0, 1.5, 0.0), False, id="its other side"),
        pytest.param((END_OF_WALL, 3.0, 1.0, 0.0, NAN), True, id="its clockwise wall alone"),
        pytest.param((END_OF_WALL, 3.0, 1.0, NAN, 1.5), True, id="its counter-clockwise wall alone"),
        pytest.param((END_OF_WALL, 3.0, 1.0, NAN, 0.0), False, id="a wall on the wrong side"),
        pytest.param((INTERSECTION, 3.0, 1.0, 0.0, 1.5), False, id="intersection"),
    ],
)
def test_a_corner_is_recognised_by_gate_and_type(other: tuple[int, float, float, float, float], same: bool) -> None:
    feature_map = observed(1, features_of((CORNER, 3.0, 1.0, 0.0, 1.5)), scan_of())
    observed(1, features_of(other), scan_of(), feature_map)
    assert len(feature_map) == (1 if same else 2)


def test_intersections_have_neither_orientation_nor_order() -> None:
    feature_map = observed(1, features_of((INTERSECTION, 3.0, 1.0, 0.1, 1.5)), scan_of())
    for row in ((0.1 + math.pi, 1.5), (1.5, 0.1), (1.5 - math.pi, 0.1 + math.pi)):
        observed(1, features_of((INTERSECTION, 3.0, 1.0, *row)), scan_of(), feature_map)
    assert feature_map.landmarks().seen.tolist() == [4]
    observed(1, features_of((INTERSECTION, 3.0, 1.0, 0.1, 0.9)), scan_of(), feature_map)
    assert len(feature_map) == 2


def test_each_landmark_gets_one_feature_the_nearest_first() -> None:
    feature_map = observed(1, features_of((CORNER, 3.0, 0.0, 0.0, 1.5), (CORNER, 3.0, 0.12, 0.0, 1.5)), scan_of())
    both = features_of((CORNER, 3.0, 0.11, 0.0, 1.5), (CORNER, 3.0, 0.02, 0.0, 1.5), (CORNER, 3.0, 0.06, 0.0, 1.5))
    observed(1, both, scan_of(), feature_map)
    landmarks = feature_map.landmarks()
    np.testing.assert_array_equal(landmarks.seen, [2, 2, 1])
    assert 0 < landmarks.positions[0, 1] < 0.02
    assert 0.11 < landmarks.positions[1, 1] < 0.12


def test_directions_are_fused_across_the_turn() -> None:
    feature_map = observed(1, features_of((CORNER, 3.0, 1.0, math.pi - 0.05, 1.5)), scan_of())
    observed(30, features_of((CORNER, 3.0, 1.0, -math.pi + 0.03, 1.5)), scan_of(), feature_map)
    assert len(feature_map) == 1
    direction = feature_map.landmarks().directions[0, 0]
    assert abs(math.remainder(direction - (math.pi + 0.03), 2 * math.pi)) < 0.01
    assert feature_map.landmarks().direction_variances[0, 0] < 1e-4


@pytest.mark.parametrize("wall", [0, 1])
def test_an_end_of_wall_becomes_a_corner_when_its_second_wall_appears(wall: int) -> None:
    corner = (0.2, 1.9)
    alone = [NAN, NAN]
    alone[wall] = corner[wall]
    feature_map = observed(3, features_of((END_OF_WALL, 3.0, 1.0, alone[0], alone[1])), scan_of())
    assert feature_map.landmarks().kinds.tolist() == [END_OF_WALL]
    assert np.isnan(feature_map.landmarks().direction_variances[0, 1 - wall])
    observed(1, features_of((CORNER, 3.0, 1.0, *corner)), scan_of(), feature_map)
    landmarks = feature_map.landmarks()
    assert landmarks.kinds.tolist() == [CORNER]
    np.testing.assert_allclose(landmarks.directions[0], corner)
    assert np.isfinite(landmarks.direction_variances).all()
    other = [NAN, NAN]
    other[1 - wall] = corner[1 - wall]
    observed(1, features_of((END_OF_WALL, 3.0, 1.0, other[0], other[1])), scan_of(), feature_map)
    assert feature_map.landmarks().seen.tolist() == [5]
    assert feature_map.landmarks().kinds.tolist() == [CORNER]


def test_weak_uncertain_and_far_features_make_no_landmarks() -> None:
    row = (CORNER, 3.0, 1.0, 0.0, 1.5)
    assert len(observed(1, features_of(row, real=False), scan_of())) == 0
    assert len(observed(1, features_of(row, sigma=0.5), scan_of())) == 0
    assert len(observed(1, features_of((CORNER, 19.0, 1.0, 0.0, 1.5)), scan_of())) == 0


# Time validity


def test_the_landmarks_of_a_wall_taken_away_expire() -> None:
    feature_map = observed(10, features_of(*ENDS), scan_of(WALL, BACK))
    assert len(feature_map.landmarks()) == 2
    for key in range(10, 60):
        feature_map.observe(key, HOME, NOTHING, scan_of(BACK))
    assert len(feature_map.landmarks()) == 0
    record = feature_map.record()
    assert len(record) == 2
    assert (record.seen == 10).all()
    assert (record.missed == record.expired_at - 9).all()
    assert (record.expired_at < 35).all()
    feature_map.observe(60, HOME, features_of(*ENDS), scan_of(WALL, BACK))
    assert len(feature_map.landmarks()) == 2  # put back: new landmarks, the old ones stay on record
    assert len(feature_map) == 4


def test_the_better_known_a_landmark_the_longer_it_takes() -> None:
    lifetimes = []
    for times in (1, 2, 30):
        feature_map = observed(times, features_of(*ENDS), scan_of(WALL, BACK))
        for key in range(times, times + 100):
            feature_map.observe(key, HOME, NOTHING, scan_of(BACK))
        lifetimes.append(int(feature_map.record().missed[0]))
    assert 3 <= lifetimes[0] < lifetimes[1] < lifetimes[2] <= 25


@pytest.mark.parametrize(
    ("scan", "why"),
    [
        (scan_of((1.5, -3.0, 1.5, 3.0), BACK), "occluded by something nearer"),
        (scan_of((1.5, -0.45, 1.5, -0.55), (1.5, 0.45, 1.5, 0.55), BACK), "each end just occluded"),
        (scan_of(), "no beam returns"),
    ],
)
def test_what_cannot_be_seen_does_not_expire(scan: Scan, why: str) -> None:
    feature_map = observed(5, features_of(*ENDS), scan_of(WALL, BACK))
    for key in range(5, 205):
        feature_map.observe(key, HOME, NOTHING, scan)
    assert len(feature_map.landmarks()) == 2, why
    assert (feature_map.landmarks().missed == 0).all(), why


@pytest.mark.parametrize(
    ("T_map_key", "why"),
    [
        ((0.0, 0.0, math.pi), "behind the robot"),
        ((-9.0, 0.0, 0.0), "out of range"),
        ((3.0, -4.0, math.pi / 2), "wall seen edge-on"),
    ],
)
def test_what_lies_outside_the_visible_area_does_not_expire(T_map_key: tuple[float, float, float], why: str) -> None:
    feature_map = observed(5, features_of(*ENDS), scan_of(WALL, BACK))
    open_space = Scan(ranges=np.full(181, 15.0, np.float32), geometry=laser())
    for key in range(5, 105):
        feature_map.observe(key, np.array(T_map_key), NOTHING, open_space)
    assert len(feature_map.landmarks()) == 2, why
    assert (feature_map.landmarks().missed == 0).all(), why


def test_a_landmark_seen_now_and_then_stays_one_seen_rarely_goes() -> None:
    for period, stays in ((3, True), (20, False)):
        feature_map = FeatureMap()
        for key in range(200):
            features = features_of(*ENDS) if key % period == 0 else NOTHING
            feature_map.observe(key, HOME, features, scan_of(BACK))
        assert (0 in feature_map.landmarks().ids) is stays


def test_a_weak_feature_in_its_place_neither_confirms_nor_refutes() -> None:
    feature_map = observed(5, features_of(*ENDS), scan_of(WALL, BACK))
    for key in range(5, 105):
        feature_map.observe(key, HOME, features_of(*ENDS, real=False), scan_of(BACK))
    landmarks = feature_map.landmarks()
    assert landmarks.seen.tolist() == [5, 5]
    assert landmarks.missed.tolist() == [0, 0]


def test_visibility_is_judged_from_the_laser_not_from_the_robot() -> None:
    mount = (0.0, 2.0, 0.0)
    screen = (1.5, -1.0, 1.5, 0.6)  # between robot and wall end, but not between laser and wall end
    feature_map = observed(5, features_of(ENDS[1]), scan_of(WALL, BACK, mount=mount))
    for key in range(5, 60):
        feature_map.observe(key, HOME, NOTHING, scan_of(screen, BACK, mount=mount))
    assert len(feature_map.landmarks()) == 0
    from_robot = observed(5, features_of(ENDS[1]), scan_of(WALL, BACK))
    for key in range(5, 60):
        from_robot.observe(key, HOME, NOTHING, scan_of(screen, BACK))
    assert len(from_robot.landmarks()) == 1


# Anchors


def compose(T_a_b: F64, T_b_c: F64) -> F64:
    cos, sin = math.cos(T_a_b[2]), math.sin(T_a_b[2])
    x, y, heading = T_b_c
    return np.array([T_a_b[0] + cos * x - sin * y, T_a_b[1] + sin * x + cos * y, T_a_b[2] + heading])


def two_landmarks() -> tuple[FeatureMap, F64]:
    poses = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.0]])
    feature_map = FeatureMap()
    feature_map.observe(0, poses[0], features_of((CORNER, 2.0, 1.0, 0.5, 2.0)), scan_of())
    feature_map.observe(1, poses[1], features_of((END_OF_WALL, 1.0, -2.0, NAN, 0.3)), scan_of())
    return feature_map, poses


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3.1, 3.1))
def test_landmarks_move_with_the_whole_trajectory(x: float, y: float, turn: float) -> None:
    feature_map, poses = two_landmarks()
    before = feature_map.landmarks(poses)
    T = np.array([x, y, turn])
    after = feature_map.landmarks(np.array([compose(T, pose) for pose in poses]))
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    np.testing.assert_allclose(after.positions, before.positions @ rotation.T + [x, y], atol=1e-9)
    np.testing.assert_allclose(after.covariances, rotation @ before.covariances @ rotation.T, atol=1e-12)
    difference = after.directions - before.directions - turn
    np.testing.assert_allclose(np.sin(difference[np.isfinite(difference)]), 0, atol=1e-9)


def test_a_moved_key_pose_moves_its_own_landmarks_only() -> None:
    feature_map, poses = two_landmarks()
    moved = poses.copy()
    moved[1] += [0.5, -0.2, 0.0]
    difference = feature_map.landmarks(moved).positions - feature_map.landmarks(poses).positions
    np.testing.assert_allclose(difference, [[0.0, 0.0], [0.5, -0.2]], atol=1e-12)
    feature_map.move(moved)
    np.testing.assert_allclose(feature_map.landmarks().positions, feature_map.landmarks(moved).positions)
    feature_map.observe(2, moved[1], features_of((END_OF_WALL, 1.0, -2.0, NAN, 0.3)), scan_of())
    assert feature_map.landmarks().seen.tolist() == [1, 2]


def test_the_map_grows_beyond_its_first_capacity() -> None:
    feature_map = FeatureMap()
    for key in range(300):
        rows = [(CORNER, 2.0 + i, 1.0, 0.0, 1.5) for i in range(4)]
        feature_map.observe(key, np.array([0.0, 100.0 * key, 0.0]), features_of(*rows), scan_of())
    landmarks = feature_map.landmarks()
    assert len(landmarks) == len(feature_map) == 1200
    np.testing.assert_array_equal(landmarks.anchors, np.repeat(np.arange(300), 4))
    np.testing.assert_allclose(landmarks.positions[::4, 1], 100.0 * np.arange(300) + 1.0)


def test_only_what_has_not_expired_is_looked_at() -> None:
    feature_map = observed(3, features_of(*ENDS), scan_of(WALL, BACK))
    assert feature_map._valid.tolist() == [0, 1]
    observed(60, NOTHING, scan_of(BACK), feature_map)
    assert (feature_map.record().expired_at >= 0).all()
    observed(1, features_of(*ENDS), scan_of(WALL, BACK), feature_map)
    assert feature_map._valid.tolist() == [2, 3]
    np.testing.assert_array_equal(np.flatnonzero(feature_map.record().expired_at < 0), feature_map._valid)


def test_landmarks_serve_as_features_to_match_against() -> None:
    features = two_landmarks()[0].landmarks().features()
    assert len(features) == 2
    assert features.real.all()
    assert features.kinds.tolist() == [CORNER, END_OF_WALL]
    np.testing.assert_allclose(features.direction_variances, 0.02**2)
    assert len(FeatureMap().landmarks().features()) == 0


@pytest.mark.parametrize("pose", [(NAN, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_a_pose_that_is_not_finite_is_refused(pose: tuple[float, float, float]) -> None:
    with pytest.raises(FeatureMapError, match=r"key pose 7 is .* expected"):
        FeatureMap().observe(7, np.array(pose), NOTHING, scan_of())


def test_too_few_key_poses_are_refused() -> None:
    with pytest.raises(FeatureMapError, match="anchored to key pose 1, given are 1"):
        two_landmarks()[0].landmarks(np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("name", "value"),
    [("gate", 0.0), ("pose_sigma", -1.0), ("detection_probability", 0.01), ("expiry", 0.6), ("visible_range", 0.0)],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    settings: dict[str, Any] = {name: value}
    with pytest.raises(FeatureMapError, match=name):
        FeatureMapConfig(**settings)


# Kernels


def close_slowly(positions: F64, near: F64, reach: float) -> set[tuple[int, int]]:
    return {(f, j) for f, p in enumerate(positions) for j, q in enumerate(near) if np.sum((p - q) ** 2) <= reach**2}


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(0, 60), st.integers(0, 60))
def test_close_pairs_equal_their_slow_twin(seed: int, n_features: int, n_near: int) -> None:
    rng = np.random.default_rng(seed)
    positions, near = rng.uniform(-2, 2, (n_features, 2)), rng.uniform(-2, 2, (n_near, 2))
    rows = [(CORNER, x, y, 0.0, 1.5) for x, y in positions]
    pairs = close_pairs(feature_map_module._records([features_of(*rows)]), near, 0.8)
    assert len(pairs[0]) == len(set(zip(*(column.tolist() for column in pairs), strict=True)))
    assert set(zip(*(column.tolist() for column in pairs), strict=True)) == close_slowly(positions, near, 0.8)


@given(st.floats(-20, 20))
def test_angles_are_wrapped(angle: float) -> None:
    assert -math.pi <= wrap(angle) <= math.pi
    assert abs(math.remainder(wrap(angle) - angle, 2 * math.pi)) < 1e-9
    assert abs(wrap_line(angle)) <= math.pi / 2
    assert abs(math.remainder(wrap_line(angle) - angle, math.pi)) < 1e-9


@given(st.lists(st.sampled_from([-1.0, 0.0, 0.5, 2.0, math.inf, NAN]), max_size=12))
def test_the_order_of_a_few_values_is_that_of_a_stable_sort(values: list[float]) -> None:
    numbers = np.array(values, dtype=np.float64)
    stable = [i for i in np.argsort(numbers, kind="stable") if math.isfinite(numbers[i])]
    assert ascending(numbers).tolist() == stable


@given(st.lists(st.integers(-5, 5), max_size=12), st.integers(-12, 12))
def test_the_first_that_is_not_below_a_value_is_found(numbers: list[int], twice: int) -> None:
    ascending_numbers = np.sort(np.array(numbers, dtype=np.float64))
    assert first_from(ascending_numbers, 0.5 * twice) == np.searchsorted(ascending_numbers, 0.5 * twice)


@pytest.mark.parametrize("field_of_view", [80.0, 179.0, 180.0, 181.0, 270.0, 359.0])
def test_only_what_lies_within_the_field_of_view_is_missed(field_of_view: float) -> None:
    bearings = np.radians(np.arange(-179.5, 180.0, 5.0))
    around = [(CORNER, 3.0 * math.cos(b), 3.0 * math.sin(b), b + 1.5, b - 1.5) for b in bearings]
    beams = np.radians(np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, 361))
    geometry = ScanGeometry(bearings=beams, range_min=0.05, range_max=20.0, T_robot_laser=np.array([0.0, 0.0, 0.3]))
    feature_map = FeatureMap()
    feature_map.observe(0, HOME, features_of(*around), scan_of())
    feature_map.observe(1, HOME, NOTHING, Scan(ranges=np.full(361, 9.0, np.float32), geometry=geometry))
    off_axis = np.abs(np.degrees(np.arctan2(np.sin(bearings - 0.3), np.cos(bearings - 0.3))))
    missed = feature_map.record().missed
    assert (missed[off_axis > 0.5 * field_of_view] == 0).all()
    assert (missed[off_axis < 0.5 * field_of_view - 5.0] == 1).all()


@pytest.mark.parametrize("at_once", [2, 1000])
def test_key_scans_entered_together_make_the_map_they_make_one_by_one(
    monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    monkeypatch.setattr(feature_map_module, "_AT_ONCE", at_once)
    rng = np.random.default_rng(1)
    poses = np.column_stack([0.3 * np.arange(12), rng.normal(0.0, 0.1, 12), rng.normal(0.0, 0.05, 12)])
    world = [(CORNER, x, y, 0.3, 1.8) for x, y in rng.uniform(-1.0, 6.0, (40, 2))]
    features = [seen_from(pose, *(world[i] for i in rng.permutation(40)[: rng.integers(0, 30)])) for pose in poses]
    other_mount = scan_of(BACK, mount=(0.2, 0.0, 0.1))
    scans = [scan_of(BACK)] * 5 + [other_mount] * 4 + [scan_of(BACK) for _ in range(3)]
    together = build_feature_map(poses, features, scans).record()
    one_by_one = FeatureMap()
    for key, one in enumerate(zip(poses, features, scans, strict=True)):
        one_by_one.observe(key, *one)
    alone = one_by_one.record()
    assert 0 < len(together) < sum(map(len, features))
    assert together.missed.max() > 0
    for name in Landmarks.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))

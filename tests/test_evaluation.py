"""The figures we print are those of the benchmark's definitions."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Scan
from graph.se2 import between, compose
from iceg.evaluation.consistency import chi_square_quantiles, consistency, nees, pose_nees
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import (
    Relations,
    error_statistics,
    nearest_scans,
    on_odometry_grid,
    read_relations,
    read_relations_csv,
    relation_errors,
    triangle_errors,
)
from iceg.evaluation.surface import correlation_surface
from iceg.evaluation.trajectory import align, poses_of_scans, read_reference_csv, read_truth_csv, trajectory_errors
from iceg.ice.matcher import IceMatcher
from iceg.tables import TableError

Array = NDArray[np.float64]


def random_walk(seed: int, n: int) -> Array:
    rng = np.random.default_rng(seed)
    poses = np.zeros((n, 3))
    for k in range(1, n):
        poses[k] = compose(poses[k - 1], rng.normal([0.3, 0.0, 0.0], [0.1, 0.02, 0.4]))
    return poses


def matrix(pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


def heading(T: Array) -> float:
    return float(np.arctan2(T[1, 0], T[0, 0]))


def make_relations(scans_i: list[int], scans_j: list[int], T_i_j: Array) -> Relations:
    return Relations(
        scans_i=np.array(scans_i), scans_j=np.array(scans_j), T_i_j=T_i_j, dropped=0, path=Path("known.relations.csv")
    )


@given(st.integers(0, 1000))
def test_both_forms_of_the_relation_error_follow_their_definitions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = random_walk(seed, 12)
    scans_i, scans_j = rng.integers(0, 12, 8).tolist(), rng.integers(0, 12, 8).tolist()
    known = rng.normal(0, [0.5, 0.5, 2.0], (8, 3))
    relations = make_relations(scans_i, scans_j, known)
    metric = relation_errors(poses, relations)
    cartographer = relation_errors(poses, relations, form="cartographer")
    for k, (i, j) in enumerate(zip(scans_i, scans_j, strict=True)):
        estimated = np.linalg.inv(matrix(poses[i])) @ matrix(poses[j])
        # The benchmark's own evaluator subtracts the relation vectors; Cartographer multiplies by the inverse.
        assert metric.translation[k] == pytest.approx(float(np.linalg.norm(estimated[:2, 2] - known[k, :2])), abs=1e-9)
        error = estimated @ np.linalg.inv(matrix(known[k]))
        assert cartographer.translation[k] == pytest.approx(float(np.linalg.norm(error[:2, 2])), abs=1e-9)
        assert metric.rotation[k] == pytest.approx(abs(heading(error)), abs=1e-9)
        assert cartographer.rotation[k] == pytest.approx(abs(heading(error)), abs=1e-9)


def test_a_heading_error_of_a_relation_counts_once_in_one_form_and_as_a_lever_in_the_other() -> None:
    poses = np.array([[0.0, 0, 0], [2, 0, 0.1]])
    relations = make_relations([0], [1], np.array([[2.0, 0, 0]]))
    assert relation_errors(poses, relations).translation == pytest.approx(0.0)
    expected = 2 * np.hypot(np.cos(0.1) - 1, np.sin(0.1))
    assert relation_errors(poses, relations, form="cartographer").translation == pytest.approx(expected)


def test_statistics_are_sample_statistics() -> None:
    statistics = error_statistics(np.array([1.0, 2.0, 3.0, 6.0]))
    assert statistics.mean == 3.0
    assert statistics.std == pytest.approx(np.sqrt((4 + 1 + 0 + 9) / 3))
    assert statistics.median == 2.5
    assert statistics.p95 == pytest.approx(3 + 0.85 * 3)
    assert statistics.max == 6.0
    assert np.isnan(error_statistics(np.array([1.0])).std)


def test_relations_beyond_the_trajectory_are_refused() -> None:
    with pytest.raises(EvaluationError, match="reach scan 7, but the trajectory has 3 rows"):
        relation_errors(np.zeros((3, 3)), make_relations([0], [7], np.zeros((1, 3))))


def test_only_certain_relations_count(tmp_path: Path) -> None:
    path = tmp_path / "a.relations.csv"
    path.write_text("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,1,1,0,0,1\n1,2,5,5,1,0\n2,4,0.5,0,-3,1\n")
    relations = read_relations_csv(path)
    assert (relations.scans_i.tolist(), relations.scans_j.tolist(), relations.dropped) == ([0, 2], [1, 4], 1)
    np.testing.assert_array_equal(relations.T_i_j, [[1, 0, 0], [0.5, 0, -3]])


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("", TableError, ":1: found the header '', expected 'scan_i,"),
        ("a,b\n1,2\n", TableError, ":1: found the header 'a,b'"),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n", TableError, "holds no rows"),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,1,1,0\n", TableError, ":2: found 4 values, expected 6"),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,1,1,0,0,1\n0,1,one,0,0,1\n", TableError, ":3: .*'one'"),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,1,inf,0,0,1\n", TableError, ":2: .*finite"),
        (
            "scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,1,1,0,0,0\n",
            EvaluationError,
            "none of its 1 relations is certain",
        ),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0.5,1,1,0,0,1\n", EvaluationError, "row 1: found scan 0.5"),
        ("scan_i,scan_j,x_m,y_m,theta_rad,certain\n0,-1,1,0,0,1\n", EvaluationError, "row 1: found scan -1"),
    ],
)
def test_a_bad_relations_file_is_named(tmp_path: Path, text: str, error: type[Exception], message: str) -> None:
    path = tmp_path / "bad.relations.csv"
    path.write_text(text)
    with pytest.raises(error, match=message):
        read_relations_csv(path)


def test_stamps_are_tied_to_scans_only_when_beyond_doubt() -> None:
    stamps = np.array([10.0, 10.2, 10.1, 10.3, 10.3, 10.302])
    queries = np.array([10.0, 10.105, 10.3, 10.15, 10.301, 10.302, 9.0])
    scans, certain = nearest_scans(queries, stamps)
    # 10.3 is held by two scans, 10.15 lies midway and 10.301 between neighbours, 9.0 is nobody's.
    assert certain.tolist() == [True, True, False, False, False, True, False]
    assert scans[certain].tolist() == [0, 2, 5]


@given(st.lists(st.floats(0, 5), min_size=1, max_size=12), st.lists(st.floats(-1, 6), min_size=1, max_size=12))
def test_tying_stamps_agrees_with_looking_at_every_scan(stamps: list[float], queries: list[float]) -> None:
    scans, certain = nearest_scans(np.array(queries), np.array(stamps))
    for query, scan, sure in zip(queries, scans, certain, strict=True):
        distances = sorted((abs(stamp - query), index) for index, stamp in enumerate(stamps))
        first, second = distances[0], distances[1] if len(distances) > 1 else (np.inf, -1)
        assert sure == (first[0] <= 0.02 and second[0] > 0 and second[0] >= 2 * first[0])
        assert not sure or scan == first[1]


def test_original_relations_are_tied_to_the_log_and_the_rest_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.relations"
    path.write_text("# comment\n10.0 10.2 1 2 0 0 0 0.5\n10.0 99.0 1 2 0 0 0 0.5\n")
    relations = read_relations(path, np.array([10.0, 10.1, 10.2]))
    assert (relations.scans_i.tolist(), relations.scans_j.tolist(), relations.dropped) == ([0], [2], 1)
    np.testing.assert_array_equal(relations.T_i_j, [[1, 2, 0.5]])
    with pytest.raises(EvaluationError, match="none of its 2 relations has stamps of this log"):
        read_relations(path, np.array([500.0, 501.0]))


@pytest.mark.parametrize(
    ("text", "message"), [("", "holds no rows"), ("1 2 3\n", ":1: found 3 values"), ("1 2 3 4 5 6 7 x\n", ":1: .*'x'")]
)
def test_bad_original_relations_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.relations"
    path.write_text(text)
    with pytest.raises(TableError, match=message):
        read_relations(path, np.zeros(3))


def test_relations_of_three_scans_are_held_against_each_other() -> None:
    T_0_1, T_1_2 = np.array([1.0, 0.0, math.pi / 2]), np.array([2.0, 0.0, 0.1])
    T_0_2 = compose(T_0_1, T_1_2) + np.array([0.03, 0.04, 0.2])
    relations = Relations(
        scans_i=np.array([0, 1, 0, 5]),
        scans_j=np.array([1, 2, 2, 6]),
        T_i_j=np.array([T_0_1, T_1_2, T_0_2, np.zeros(3)]),
        dropped=0,
        path=Path("relations.csv"),
    )
    errors = triangle_errors(relations)
    np.testing.assert_allclose(errors.translation, [0.05])
    np.testing.assert_allclose(errors.rotation, [0.2])


def test_relations_that_are_odometry_and_steps_of_a_grid_are_known() -> None:
    rng = np.random.default_rng(5)
    odometry = random_walk(3, 41)
    steps = between(odometry[:-1], odometry[1:])
    angle, cells = rng.uniform(0, 2 * np.pi, 40), rng.integers(-1, 2, (40, 2))
    c, s = np.cos(angle), np.sin(angle)
    shifts = 0.05 * np.column_stack([c * cells[:, 0] - s * cells[:, 1], s * cells[:, 0] + c * cells[:, 1]])
    shifts[:5] *= 0.9  # between the points of the grid, or on odometry itself
    shifts[5] = (0.3, 0.0)  # too far from odometry to be judged
    relations = Relations(
        scans_i=np.arange(40),
        scans_j=np.arange(1, 41),
        T_i_j=steps + np.column_stack([shifts, rng.normal(0, 0.1, 40)]),
        dropped=0,
        path=Path("relations.csv"),
    )
    expected = np.delete(np.arange(40) >= 5, 5) | (np.delete(shifts, 5, axis=0) == 0).all(axis=1)
    np.testing.assert_array_equal(on_odometry_grid(relations, odometry, 0.05), expected)
    assert 0 < np.count_nonzero(~expected) < 6


@given(st.integers(0, 1000), st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)))
def test_a_moved_trajectory_has_no_error(seed: int, motion: tuple[float, float, float]) -> None:
    reference = random_walk(seed, 20)
    errors = trajectory_errors(compose(np.array(motion), reference), reference)
    assert errors.ate_rmse == pytest.approx(0, abs=1e-9)
    assert errors.ate_max == pytest.approx(0, abs=1e-9)
    assert errors.rot_rmse == pytest.approx(0, abs=1e-9)


@settings(max_examples=30)
@given(st.integers(0, 1000))
def test_alignment_is_the_least_squares_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    reference = random_walk(seed, 15)
    estimated = compose(rng.normal(0, [5, 5, 2]), reference) + rng.normal(0, 0.3, (15, 3))
    best = align(estimated, reference)
    # Umeyama's solution by singular values, the form published for any dimension.
    a, b = estimated[:, :2] - estimated[:, :2].mean(0), reference[:, :2] - reference[:, :2].mean(0)
    u, _, vt = np.linalg.svd(b.T @ a)
    R = u @ np.diag([1.0, np.linalg.det(u @ vt)]) @ vt
    np.testing.assert_allclose(best[2], np.arctan2(R[1, 0], R[0, 0]), atol=1e-9)
    rmse = trajectory_errors(estimated, reference).ate_rmse
    for step in rng.normal(0, 0.05, (10, 3)):
        moved = compose(best + step, estimated)
        assert np.sqrt(((moved - reference)[:, :2] ** 2).sum(1).mean()) >= rmse


def test_errors_along_each_axis_are_those_of_the_reference_frame() -> None:
    reference = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]])
    estimated = reference + np.array([[0.1, 0, 0.2], [-0.1, 0, -0.2], [0.1, 0, 0.2], [-0.1, 0, -0.2]])
    errors = trajectory_errors(estimated, reference)
    # The alignment leaves these errors as they are: their mean and their moment about the centre vanish.
    assert errors.x_mean_abs == pytest.approx(0.1)
    assert errors.y_mean_abs == pytest.approx(0)
    assert errors.x_var == pytest.approx(0.01)
    assert errors.ate_rmse == pytest.approx(0.1)
    assert errors.rot_rmse == pytest.approx(0.2)
    assert errors.n == 4


def test_a_single_pose_cannot_be_aligned() -> None:
    with pytest.raises(EvaluationError, match="at least 2"):
        trajectory_errors(np.zeros((1, 3)), np.zeros((1, 3)))


def test_reference_and_truth_files(tmp_path: Path) -> None:
    reference, truth = tmp_path / "a.reference.csv", tmp_path / "a.truth.csv"
    reference.write_text("scan,x_m,y_m,theta_rad\n2,1,2,0.5\n")
    truth.write_text("t_s,x_m,y_m,theta_rad\n0.1,1,2,0.5\n0.2,3,4,0.6\n")
    scans, poses = read_reference_csv(reference)
    assert scans.tolist() == [2]
    np.testing.assert_array_equal(poses, [[1, 2, 0.5]])
    np.testing.assert_array_equal(read_truth_csv(truth), [[1, 2, 0.5], [3, 4, 0.6]])
    with pytest.raises(TableError, match="expected 't_s,x_m,y_m,theta_rad'"):
        read_truth_csv(reference)
    with pytest.raises(EvaluationError, match="reaches scan 2, but the trajectory has 2 rows"):
        poses_of_scans(np.zeros((2, 3)), scans, reference)
    with pytest.raises(TableError, match="cannot be read"):
        read_truth_csv(tmp_path / "missing.csv")
    reference.write_text("scan,x_m,y_m,theta_rad\n2,1,2,0.5\n2.5,1,2,0.5\n")
    with pytest.raises(EvaluationError, match=r"a\.reference\.csv: row 2: found scan 2\.5, expected whole numbers"):
        read_reference_csv(reference)


def test_nees_of_errors_drawn_from_their_covariance_is_three() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) * [0.1, 0.3, 0.02]
    covariance = root @ root.T
    values = nees(rng.normal(size=(20_000, 3)) @ root.T, np.broadcast_to(covariance, (20_000, 3, 3)))
    summary = consistency(values)
    assert summary.mean_low < summary.mean < summary.mean_high
    assert summary.median == pytest.approx(2.366, abs=0.06)
    assert summary.share_within_95 == pytest.approx(0.95, abs=0.01)


def test_nees_agrees_with_the_inverse() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        root, error = rng.normal(size=(3, 3)), rng.normal(size=3)
        covariance = root @ root.T + 0.1 * np.eye(3)
        assert nees(error, covariance) == pytest.approx(error @ np.linalg.inv(covariance) @ error)


def test_a_covariance_that_is_none_is_refused() -> None:
    with pytest.raises(EvaluationError, match="not positive definite"):
        nees(np.zeros(3), np.diag([1.0, -1.0, 1.0]))


def test_nees_of_poses_does_not_depend_on_the_frames() -> None:
    rng = np.random.default_rng(5)
    truth = random_walk(5, 10)
    estimated = truth + rng.normal(0, 0.01, (10, 3))
    covariances = np.broadcast_to(np.diag([1e-4, 2e-4, 3e-4]), (10, 3, 3))
    values = pose_nees(estimated, truth, covariances)
    assert values.shape == (9,)
    moved = pose_nees(compose([3, -2, 1.0], estimated), compose([-7, 1, 2.5], truth), covariances)
    np.testing.assert_allclose(values, moved, rtol=1e-9)


def test_each_pose_is_judged_by_its_own_covariance() -> None:
    # Straight ahead, each pose after the first off by as many centimetres as its standard deviation says.
    sigmas = np.array([0.5, 0.01, 0.02, 0.03])
    estimated = np.array([[k + sigma, 0.0, 0.0] for k, sigma in enumerate(sigmas)])
    estimated[0, 0] = 0.0
    true = np.array([[float(k), 0.0, 0.0] for k in range(4)])
    np.testing.assert_allclose(pose_nees(estimated, true, sigmas[:, None, None] ** 2 * np.eye(3)), 1.0)


def test_errors_are_taken_in_the_robot_frame_of_the_estimate() -> None:
    # Heading north, 0.1 m too far north: an error along the robot's own x, where the covariance is wide.
    estimated = np.array([[0.0, 0, 0], [0, 2.1, np.pi / 2]])
    truth = np.array([[0.0, 0, 0], [0, 2.0, np.pi / 2]])
    covariances = np.broadcast_to(np.diag([0.01, 1e-6, 1e-6]), (2, 3, 3))
    assert pose_nees(estimated, truth, covariances) == pytest.approx([1.0])


def test_chi_square_quantiles_are_those_of_the_tables() -> None:
    assert chi_square_quantiles(np.array([0.025, 0.5, 0.95, 0.975]), 3) == pytest.approx(
        [0.215795, 2.365974, 7.814728, 9.348404], abs=1e-6
    )


def test_no_pose_has_no_consistency() -> None:
    with pytest.raises(EvaluationError, match="no pose"):
        consistency(np.zeros(0))


def test_the_two_formats_of_a_real_log_agree(data_dir: Path) -> None:
    by_scan = read_relations_csv(data_dir / "mit-csail.relations.csv")
    # Scans of that log whose stamps the relations name; the stamps of all others are not needed to tell them apart.
    table = np.loadtxt(data_dir / "mit-csail.relations")
    stamps = np.full(by_scan.scans_j.max() + 1, -1e9) - np.arange(by_scan.scans_j.max() + 1)
    stamps[by_scan.scans_i], stamps[by_scan.scans_j] = table[:, 0], table[:, 1]
    by_stamp = read_relations(data_dir / "mit-csail.relations", stamps)
    np.testing.assert_array_equal(by_stamp.scans_i, by_scan.scans_i)
    np.testing.assert_array_equal(by_stamp.scans_j, by_scan.scans_j)
    np.testing.assert_allclose(by_stamp.T_i_j, by_scan.T_i_j, atol=1e-6)


def test_between_is_the_relation_form(data_dir: Path) -> None:
    relations = read_relations_csv(data_dir / "intel.relations.csv")
    poses = random_walk(0, 14_000)
    errors = relation_errors(poses, relations)
    known = make_relations(
        relations.scans_i.tolist(),
        relations.scans_j.tolist(),
        between(poses[relations.scans_i], poses[relations.scans_j]),
    )
    assert relation_errors(poses, known).translation.max() == 0
    assert len(errors.translation) == len(relations) == 2237


def test_a_correlation_surface_peaks_at_the_match_and_knows_the_corridor() -> None:
    beams = np.radians(np.arange(-90, 91))
    with np.errstate(divide="ignore"):
        scan = Scan.from_ranges(1.0 / np.abs(np.sin(beams)), field_of_view=np.pi, range_max=15.0)
    matcher = IceMatcher()
    corridor = matcher.prepare([scan], np.zeros((1, 3)))
    shifts, scores = correlation_surface(matcher, corridor, scan, np.zeros(3), half_width=0.1, half_cells=10)
    assert shifts[10] == pytest.approx(0.0)
    assert scores.shape == (21, 21)
    assert np.abs(shifts[scores.max(axis=1).argmax()]) <= 0.01
    across, along = scores[:, 10], scores[10]
    assert across[0] < 0.5 * across[10]
    assert along[0] > 0.9 * along[10]

"""Distances between points of a map, and whether their standard deviations are right."""

from dataclasses import replace

import numpy as np
import pytest

import iceg
from frontends.simulator.simulation import simulate
from graph.factors import Factor
from graph.problem import Problem
from graph.se2 import compose, transform_points
from iceg.config import Config
from iceg.evaluation.consistency import chi_square_quantiles
from iceg.maps.config import GridConfig
from iceg.run_result.distance import DistanceError, Sighting
from iceg.run_result.joint_covariance import JointCovariance
from iceg.run_result.slam_result import SlamResult
from iceg.slam.broken_path.displacement import Displacement

_COARSE = Config(grid=GridConfig(resolution=0.5))
_SEEDS = range(20, 25)
_PAIRS = 60


@pytest.fixture(scope="module")
def result() -> SlamResult:
    return iceg.run(simulate("room", 0).log, _COARSE)


def _chain(n: int) -> JointCovariance:
    """Poses along a bent path, each known from the one before."""
    step, covariance = np.array([1.0, 0.1, 0.3]), np.diag([0.02, 0.01, 0.005]) ** 2
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(compose(poses[-1], step))
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=1e-8 * np.eye(3))]
    factors += [Factor(kind="odometry", i=k, j=k + 1, T_i_j=step, covariance=covariance) for k in range(n - 1)]
    marginals = Problem.of(factors, n).marginal_covariances(np.array(poses))
    return JointCovariance(poses=np.array(poses), marginals=marginals, information=None, factors=factors)


def test_the_variance_of_a_figure_of_two_poses_is_that_of_their_joint_covariance() -> None:
    joint = _chain(6)
    factor = Factor(kind="closure", i=1, j=4, T_i_j=np.zeros(3), covariance=1e8 * np.eye(3))
    full = Problem.of([*joint.factors, factor], 6).joint_covariances(joint.poses)[-1]
    gradients = np.array([[0.3, -1.0, 2.0], [0.5, 0.7, -1.1]])
    expected = gradients.ravel() @ full @ gradients.ravel()
    assert joint.variance(np.array([1, 4]), gradients) == pytest.approx(expected, rel=1e-3)


def test_a_displacement_changes_distances_across_it_alone() -> None:
    chain, across = _chain(6), np.array([4.0, 9.0, 0.25])
    joint = replace(chain, displacements=(Displacement(key=3, variances=across),))

    def variances(i: int, j: int) -> tuple[float, float]:
        """Of the distance between two poses, without the displacement and with it."""
        apart = joint.poses[j, :2] - joint.poses[i, :2]
        along = apart / np.hypot(*apart)
        cos, sin = np.cos(joint.poses[[i, j], 2]), np.sin(joint.poses[[i, j], 2])
        ahead, aside = cos * along[0] + sin * along[1], cos * along[1] - sin * along[0]
        gradients = np.column_stack([[-ahead[0], ahead[1]], [-aside[0], aside[1]], [0.0, 0.0]])
        keys = np.array([i, j])
        return chain.variance(keys, gradients), joint.variance(keys, gradients)

    for i, j in ((0, 2), (3, 5), (4, 5)):
        without, displaced = variances(i, j)
        assert displaced == pytest.approx(without, rel=1e-9)
    without, displaced = variances(2, 3)
    heading = joint.poses[3, 2] - np.arctan2(*(joint.poses[3, :2] - joint.poses[2, :2])[::-1])
    expected = across[0] * np.cos(heading) ** 2 + across[1] * np.sin(heading) ** 2  # it turns about itself
    assert displaced - without == pytest.approx(expected, rel=1e-9)


def test_deviations_are_right_over_many_runs_against_the_truth() -> None:
    means = []
    for seed in _SEEDS:
        simulation = simulate("room", seed)
        means.append(_mean_nees(iceg.run(simulation.log, _COARSE), simulation.truth, np.random.default_rng(seed)))
    low, high = chi_square_quantiles(np.array([0.025, 0.975]), len(means)) / len(means)
    assert low < np.mean(means) < high


def _mean_nees(result: SlamResult, truth: np.ndarray, rng: np.random.Generator) -> float:
    """Mean squared error of distances between points that two poses saw, in their variances."""
    squares = []
    for i, j in rng.choice(result.key_scans, (_PAIRS, 2)):
        ends = [(int(k), int(rng.choice(np.flatnonzero(np.isfinite(result.log.ranges[k]))))) for k in (i, j)]
        seen = [Sighting.of_beam(result.log, scan, beam) for scan, beam in ends]
        # What the laser errs is in the points, and not in the poses: it is left out on both sides.
        a, b = (Sighting(scan=one.scan, p_robot=one.p_robot, is_return=False) for one in seen)
        true = [transform_points(truth[one.scan], one.p_robot) for one in seen]
        found = result.distance(a, b)
        if i != j:
            squares.append(((found.length - np.hypot(*(true[1] - true[0]))) / found.deviation) ** 2)
    return float(np.mean(squares))


def test_of_two_points_of_one_scan_only_the_laser_is_unsure(result: SlamResult) -> None:
    scan = int(result.key_scans[3])
    first, last = np.flatnonzero(np.isfinite(result.log.ranges[scan]))[[0, -1]]
    a, b = (Sighting.of_beam(result.log, scan, int(beam)) for beam in (first, last))
    found = result.distance(a, b)
    assert found.length == pytest.approx(float(np.hypot(*(a.p_robot - b.p_robot))))
    laser = result.summary["laser"]
    assert laser is not None
    assert 0.0 < found.deviation < 1.5 * laser["noise_m"] + 2.0 * laser["noise_per_metre"] * 30.0


def test_places_of_the_map_are_those_that_scans_saw(result: SlamResult) -> None:
    scan = int(result.key_scans[-1])
    beam = int(np.flatnonzero(np.isfinite(result.log.ranges[scan]))[5])
    seen = Sighting.of_beam(result.log, scan, beam)
    x, y = transform_points(result.trajectory[scan], seen.p_robot)
    found = result.sighting(float(x), float(y))
    assert found.is_return
    place = transform_points(result.trajectory[found.scan], found.p_robot)
    assert float(np.hypot(*(place - (x, y)))) <= 0.1
    assert str(result.distance((float(x), float(y)), seen)).endswith(" m")


def test_where_nobody_looked_there_is_no_distance(result: SlamResult) -> None:
    with pytest.raises(DistanceError, match=r"no key scan looked at \(900\.00, 900\.00\)"):
        result.distance((900.0, 900.0), (0.0, 0.0))
    with pytest.raises(DistanceError, match="beam -1 of scan 0"):
        Sighting.of_beam(result.log, 0, -1)
    nowhere = Sighting(scan=10**6, p_robot=np.zeros(2), is_return=False)
    with pytest.raises(DistanceError, match="found scan 1000000, expected one of"):
        result.distance(nowhere, (0.0, 0.0))

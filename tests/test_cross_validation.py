"""Leaving one factor out in closed form against doing it, and whether honest covariances come out as honest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.batch import optimize
from graph.errors import IcegError
from graph.factors import Factor, FactorKind, RobustKernel
from graph.g2o import write_g2o
from graph.problem import Problem
from graph.se2 import adjoint, between, compose, expmap, logmap
from iceg.cli import main
from iceg.evaluation.cross_validation import cross_validation, cross_validation_report, leave_one_out
from iceg.evaluation.errors import EvaluationError

Array = NDArray[np.float64]

WHEELS, MATCH = np.diag([0.03, 0.02, 0.01]) ** 2, np.diag([0.01, 0.015, 0.006]) ** 2


def correlated(rng: np.random.Generator, covariance: Array) -> Array:
    return np.asarray(adjoint(rng.uniform(-0.5, 0.5, 3)) @ covariance @ adjoint(rng.uniform(-0.5, 0.5, 3)).T)


def noisy(rng: np.random.Generator, kind: FactorKind, i: int, j: int, truth: Array, covariance: Array) -> Factor:
    skew = adjoint(rng.uniform(-0.5, 0.5, 3))
    honest = skew @ covariance @ skew.T
    xi = np.linalg.cholesky(honest) @ rng.normal(size=3)
    return Factor(kind=kind, i=i, j=j, T_i_j=compose(between(truth[i], truth[j]), expmap(-xi)), covariance=honest)


def ring(n: int, seed: int, scale: float = 1.0) -> tuple[list[Factor], Array]:
    """A round trip by wheels and by matches, closed in many places, its noise that of its covariances; the optimum."""
    rng = np.random.default_rng(seed)
    truth = [np.zeros(3)]
    for _ in range(n - 1):
        truth.append(compose(truth[-1], np.array([0.5, 0.0, 4.0 * np.pi / n])))
    poses = np.array(truth)
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=np.eye(3) * 1e-6)]
    for k in range(1, n):
        factors.append(noisy(rng, "odometry", k - 1, k, poses, scale * WHEELS))
        factors.append(noisy(rng, "ice", k - 1, k, poses, scale * MATCH))
    half = n // 2
    factors += [noisy(rng, "closure", k - half, k, poses, scale * MATCH) for k in range(half, n, 2)]
    return factors, optimize(factors, poses).poses


def left_out_by_solving_again(factors: list[Factor], poses: Array, index: int) -> float:
    """χ² of one factor against the optimum of all others."""
    factor, others = factors[index], factors[:index] + factors[index + 1 :]
    assert factor.i is not None
    optimum = optimize(others, poses).poses
    innovation = logmap(between(factor.T_i_j, between(optimum[factor.i], optimum[factor.j])))
    # The covariance of a prediction, from an all but powerless factor in the place of the one left out.
    blind = replace(factor, covariance=np.eye(3) * 1e6, kernel=None)
    problem = Problem.of([*others, blind], len(poses))
    joint = problem.joint_covariances(optimum)[-1]
    by_first = -adjoint(between(optimum[factor.j], optimum[factor.i]))
    jacobian = np.hstack([by_first, np.eye(3)])
    covariance = factor.covariance + jacobian @ joint @ jacobian.T
    return float(innovation @ np.linalg.solve(covariance, innovation))


def test_joint_covariances_are_those_of_gtsam() -> None:
    import gtsam

    from graph.gtsam_bridge import to_gtsam_graph, to_gtsam_values

    factors, poses = ring(12, seed=3)
    joint = Problem.of(factors, len(poses)).joint_covariances(poses)
    marginals = gtsam.Marginals(to_gtsam_graph(factors), to_gtsam_values(poses))
    for factor, found in zip(factors, joint, strict=True):
        if factor.i is None:
            assert not found[:3, :].any()
            continue
        keys = gtsam.KeyVector([factor.i, factor.j])
        theirs = marginals.jointMarginalCovariance(keys)
        blocks = [[theirs.at(a, b) for b in (factor.i, factor.j)] for a in (factor.i, factor.j)]
        np.testing.assert_allclose(found, np.block(blocks), rtol=1e-5, atol=1e-9)


def test_the_closed_form_is_that_of_solving_again() -> None:
    # The noise is small, so that the two differ by little more than what is linearised.
    factors, poses = ring(14, seed=1, scale=1e-4)
    found = leave_one_out(factors, poses)
    for index in range(1, len(factors)):
        brute = left_out_by_solving_again(factors, poses, index)
        assert found.chi_square[index] == pytest.approx(brute, rel=1e-2, abs=1e-3), str(factors[index])


def test_so_it_is_for_a_closure_that_faded() -> None:
    factors, poses = ring(14, seed=2, scale=1e-4)
    kernel = RobustKernel(name="dcs", width=5.0)
    wrong = replace(factors[-1], T_i_j=compose(factors[-1].T_i_j, np.array([0.002, -0.001, 0.0])), kernel=kernel)
    factors = [*factors[:-1], wrong]
    poses = optimize(factors, poses).poses
    found = leave_one_out(factors, poses)
    assert 0.0 < found.weights[-1] < 0.2
    assert found.chi_square[-1] == pytest.approx(left_out_by_solving_again(factors, poses, len(factors) - 1), rel=0.02)
    assert cross_validation(factors, poses)["closure"].faded == 1


def test_a_factor_that_alone_holds_a_pose_is_not_judged() -> None:
    # 0 – 1 by two factors, 1 – 2 by one.
    step = np.array([1.0, 0.0, 0.1])
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=np.eye(3) * 1e-6)]
    factors += [Factor(kind="odometry", i=0, j=1, T_i_j=step, covariance=WHEELS)]
    factors += [Factor(kind="ice", i=0, j=1, T_i_j=compose(step, np.array([0.05, 0.0, 0.0])), covariance=MATCH)]
    factors += [Factor(kind="odometry", i=1, j=2, T_i_j=step, covariance=WHEELS)]
    poses = optimize(factors, np.zeros((3, 3))).poses
    found = leave_one_out(factors, poses)
    # Two measurements of one step, 5 cm apart: each sees the other with the sum of both variances.
    expected = 0.05**2 / (WHEELS[0, 0] + MATCH[0, 0])
    np.testing.assert_allclose(found.chi_square, [np.nan, expected, expected, np.nan], rtol=1e-6)
    np.testing.assert_allclose(found.redundancy, [0.0, 0.5, 0.1, 0.0], atol=0.3)
    report = cross_validation(factors, poses)
    assert (report["odometry"].judged.n, report["odometry"].unchecked) == (1, 1)


@pytest.mark.parametrize(("claimed", "expected"), [(1.0, 3.0), (0.25, 12.0), (4.0, 0.75)])
def test_honest_covariances_come_out_as_honest(claimed: float, expected: float) -> None:
    factors, poses = ring(300, seed=5)
    factors = [factors[0], *(replace(f, covariance=claimed * f.covariance) for f in factors[1:])]
    for kind, found in cross_validation(factors, poses).items():
        assert found.judged.mean == pytest.approx(expected, rel=0.25), kind
        assert found.unchecked == 0


def test_one_kind_too_sure_is_found_out() -> None:
    factors, optimum = ring(300, seed=6)
    factors = [replace(f, covariance=f.covariance / 9.0) if f.kind == "closure" else f for f in factors]
    poses = optimize(factors, optimum).poses
    found = cross_validation(factors, poses)
    assert found["closure"].judged.mean > found["closure"].judged.mean_high
    assert found["closure"].judged.mean > 1.5 * found["odometry"].judged.mean


def test_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    factors, poses = ring(60, seed=7)
    write_g2o(tmp_path / "graph.g2o", poses, factors)
    assert main(["eval", str(tmp_path), "--consistency"]) == 0
    shown = capsys.readouterr().out
    assert "each factor against all the others" in shown
    for kind in ("odometry", "ICE", "closure"):
        assert f"{kind} factors, NEES, mean (3 is right)" in shown
    report = cross_validation_report(tmp_path)
    assert report["ice_n"] == 59
    assert report["ice_nees_mean"] == pytest.approx(cross_validation(factors, poses)["ice"].judged.mean, rel=1e-3)
    assert main(["eval", str(tmp_path), "--consistency", "--truth", "x.csv"]) == 2
    (tmp_path / "trajectory.tum").write_text("0.0 0 0 0 0 0 0 1\n")
    capsys.readouterr()
    assert main(["eval", str(tmp_path / "trajectory.tum"), "--consistency"]) == 1
    assert "give the folder of a run, or a g2o file" in capsys.readouterr().err
    assert main(["eval", str(tmp_path)]) == 2
    assert "found none of --truth, --reference, --relations and --consistency" in capsys.readouterr().err


@pytest.mark.parametrize("edges", ["", "VERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"])
def test_a_graph_in_which_nothing_is_known_twice_is_named(tmp_path: Path, edges: str) -> None:
    (tmp_path / "graph.g2o").write_text(f"VERTEX_SE2 0 0 0 0\n{edges}")
    with pytest.raises(EvaluationError, match=r"graph\.g2o: found no factor that others check"):
        cross_validation_report(tmp_path)


def test_a_folder_without_a_graph_is_named(tmp_path: Path) -> None:
    with pytest.raises(IcegError, match=r"graph\.g2o"):
        cross_validation_report(tmp_path)

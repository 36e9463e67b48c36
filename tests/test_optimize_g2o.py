"""Any pose graph file solved: as a library and from the command line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graph.errors import GraphError
from graph.factors import Factor
from graph.g2o import G2oGraph, read_g2o, write_g2o
from graph.optimize_g2o import OptimizeOptions, format_report, optimize_g2o
from graph.se2 import between, compose
from iceg.cli import main

COVARIANCE = np.diag([0.05, 0.05, 0.02]) ** 2


def ring(with_false: bool) -> G2oGraph:
    """Twice round a ring of 24 poses of ids 100, 102 …; closures to the first lap, and a false one on request."""
    step = np.array([0.5, 0.0, np.pi / 12])
    truth = [np.zeros(3)]
    for _ in range(47):
        truth.append(compose(truth[-1], step))
    poses = np.array(truth)
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=poses[0], covariance=np.eye(3) * 1e-6)]
    drifting = compose(step, np.array([0.01, 0.0, 0.004]))
    factors += [Factor(kind="odometry", i=k, j=k + 1, T_i_j=drifting, covariance=COVARIANCE) for k in range(47)]
    factors += [
        Factor(kind="closure", i=k, j=k + 24, T_i_j=between(poses[k], poses[k + 24]), covariance=COVARIANCE)
        for k in range(0, 24, 3)
    ]
    if with_false:
        factors.append(Factor(kind="closure", i=2, j=20, T_i_j=np.array([9.0, 9.0, 2.0]), covariance=COVARIANCE))
    start = [np.zeros(3)]
    for _ in range(47):
        start.append(compose(start[-1], drifting))
    return G2oGraph(ids=100 + 2 * np.arange(48), poses=np.array(start), factors=tuple(factors))


@pytest.mark.parametrize(
    "options",
    [
        OptimizeOptions(gnc=True),
        OptimizeOptions(pcm=True),
        OptimizeOptions(kernel="dcs"),
        OptimizeOptions(kernel="geman_mcclure", incremental=True),
        OptimizeOptions(gnc=True, pcm=True, incremental=True),
    ],
)
def test_every_defence_rejects_the_false_edge_and_names_it(options: OptimizeOptions) -> None:
    solved = optimize_g2o(ring(with_false=True), options)
    assert [(edge.id_i, edge.id_j) for edge in solved.rejected] == [(104, 140)]
    assert "104 -> 140" in format_report(solved)
    clean = optimize_g2o(ring(with_false=False))
    assert not clean.rejected
    np.testing.assert_allclose(solved.poses, clean.poses, atol=0.02)
    assert solved.final_error < solved.initial_error


def test_incremental_and_batch_agree() -> None:
    graph = ring(with_false=False)
    batch, grown = optimize_g2o(graph), optimize_g2o(graph, OptimizeOptions(incremental=True))
    np.testing.assert_allclose(batch.poses, grown.poses, atol=1e-5)


def test_the_vertices_in_the_file_need_not_be_any_good() -> None:
    graph = ring(with_false=False)
    lost = replace(graph, poses=np.random.default_rng(0).normal(0.0, 5.0, graph.poses.shape))
    np.testing.assert_allclose(optimize_g2o(lost).poses, optimize_g2o(graph).poses, atol=1e-5)


def test_command_line_round_trip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph = ring(with_false=True)
    source, target = tmp_path / "in.g2o", tmp_path / "out.g2o"
    write_g2o(source, graph.poses, graph.factors, graph.ids)
    assert main(["optimize", str(source), "-o", str(target), "--gnc", "--pcm"]) == 0
    told = capsys.readouterr().out
    assert "48 vertices, 47 edges along the way, 9 closures" in told
    assert "1 closures do not hold" in told
    again = read_g2o(target)
    assert again.ids.tolist() == graph.ids.tolist()
    assert len(again.factors) == len(graph.factors) - 1
    assert main(["optimize", str(tmp_path / "missing.g2o"), "-o", str(target)]) == 1
    assert "missing.g2o: cannot be read as a pose graph" in capsys.readouterr().err


def test_a_solution_that_cannot_be_written_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph, source = ring(with_false=False), tmp_path / "in.g2o"
    write_g2o(source, graph.poses, graph.factors, graph.ids)
    for target in (tmp_path, tmp_path / "nowhere" / "out.g2o", source / "out.g2o"):
        assert main(["optimize", str(source), "-o", str(target)]) == 1
        told = capsys.readouterr().err
        assert told.startswith(f"iceg: {target}: cannot be written")
        assert told.count("\n") == 1


def test_a_graph_that_cannot_be_solved_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = tmp_path / "in.g2o", tmp_path / "out.g2o"
    source.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 2 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
    assert main(["optimize", str(source), "-o", str(target)]) == 1
    assert capsys.readouterr().err.startswith(f"iceg: {source}: 1 of 3 poses are connected to no prior")
    assert main(["optimize", str(source), "-o", str(target), "--kernel-width", "-1"]) == 2
    assert "found --kernel-width -1.0, expected a positive number" in capsys.readouterr().err
    before = source.read_bytes()
    assert main(["optimize", str(source), "-o", str(source)]) == 2
    assert source.read_bytes() == before


def test_vertices_that_hang_in_the_air_are_named_as_in_the_file() -> None:
    graph = ring(with_false=False)
    loose = replace(graph, factors=tuple(f for f in graph.factors if 40 not in (f.i, f.j)))
    with pytest.raises(GraphError, match="1 of 48 poses are connected to no prior, the first is pose 180"):
        optimize_g2o(loose)


@pytest.mark.parametrize(
    "options",
    [
        OptimizeOptions(incremental=True),
        OptimizeOptions(pcm=True),
        OptimizeOptions(gnc=True, pcm=True, incremental=True),
    ],
)
def test_a_part_that_a_closure_alone_ties_on_is_solved(options: OptimizeOptions) -> None:
    truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [2.0, 1.0, 0.6]])
    factors = (
        Factor(kind="prior", i=None, j=0, T_i_j=truth[0], covariance=COVARIANCE),
        Factor(kind="closure", i=0, j=2, T_i_j=truth[2], covariance=COVARIANCE),
        Factor(kind="odometry", i=1, j=2, T_i_j=between(truth[1], truth[2]), covariance=COVARIANCE),
    )
    solved = optimize_g2o(G2oGraph(ids=np.arange(3), poses=np.zeros((3, 3)), factors=factors), options)
    assert not solved.rejected
    np.testing.assert_allclose(solved.poses, truth, atol=1e-6)


@pytest.mark.parametrize(("name", "optimum"), [("mit-weak-loops", 20.61)])
def test_weak_loops_are_solved_incrementally_too(data_dir: Path, name: str, optimum: float) -> None:
    graph = read_g2o(data_dir / "posegraph" / f"{name}.g2o")
    for incremental in (False, True):
        assert optimize_g2o(graph, OptimizeOptions(incremental=incremental)).final_error < optimum

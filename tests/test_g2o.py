"""g2o out and in: the same factors, the same optimum; other people's files; errors with path and line."""

import contextlib
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from graph.batch import optimize
from graph.factors import Factor, FactorKind, KernelName, RobustKernel
from graph.g2o import FIX_SIGMA, G2oError, read_g2o, write_g2o
from graph.pose_graph import PoseGraph

Array = NDArray[np.float64]


def random_covariance(rng: np.random.Generator) -> Array:
    root = rng.normal(size=(3, 3)) * [0.1, 0.05, 0.02]
    covariance: Array = root @ root.T + 1e-4 * np.eye(3)
    return covariance


def random_factors(seed: int, n: int) -> list[Factor]:
    """A prior, a noisy chain with two factors per step, and closures with every kernel."""
    rng = np.random.default_rng(seed)

    def factor(kind: FactorKind, i: int | None, j: int, kernel: RobustKernel | None = None) -> Factor:
        T_i_j = np.array([0.7 * (j - (i or 0)), 0.0, 0.0]) + rng.normal(0, 0.02, 3)
        return Factor(kind=kind, i=i, j=j, T_i_j=T_i_j, covariance=random_covariance(rng), kernel=kernel)

    names: list[KernelName] = ["huber", "cauchy", "geman_mcclure", "dcs"]
    steps = [factor(kind, i, i + 1) for i in range(n - 1) for kind in ("odometry", "ice")]
    closures = [
        factor("closure", 0, n - 1 - k, RobustKernel(name=name, width=float(rng.uniform(0.5, 3))))
        for k, name in enumerate(names)
    ]
    return [factor("prior", None, 0), *steps, *closures]


def assert_same_factors(found: tuple[Factor, ...], expected: list[Factor]) -> None:
    assert [(f.kind, f.i, f.j, f.kernel) for f in found] == [(f.kind, f.i, f.j, f.kernel) for f in expected]
    np.testing.assert_array_equal([f.T_i_j for f in found], [f.T_i_j for f in expected])
    covariances = np.array([f.covariance for f in expected])
    np.testing.assert_allclose([f.covariance for f in found], covariances, rtol=1e-9, atol=1e-14)


@given(st.integers(0, 2**32 - 1))
def test_round_trip_keeps_every_factor_kind_and_kernel(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    path = tmp_path_factory.mktemp("g2o") / "graph.g2o"
    factors, poses = random_factors(seed, 8), np.random.default_rng(seed).normal(size=(8, 3))
    write_g2o(path, poses, factors)
    back = read_g2o(path)
    assert_same_factors(back.factors, factors)
    np.testing.assert_array_equal(back.poses, poses)
    np.testing.assert_array_equal(back.ids, np.arange(8))


def test_reading_back_gives_the_same_optimum(tmp_path: Path) -> None:
    factors = random_factors(4, 30)
    start = np.column_stack([np.arange(30) * 0.7, np.zeros((30, 2))])
    expected = optimize(factors, start)
    graph = PoseGraph.from_factors(factors, start)
    write_g2o(tmp_path / "graph.g2o", graph.all_poses(), graph.factors)
    back = read_g2o(tmp_path / "graph.g2o")
    found = optimize(back.factors, back.poses)
    assert found.error_after == pytest.approx(expected.error_after, rel=1e-6)
    np.testing.assert_allclose(found.poses, expected.poses, atol=1e-4)


def test_the_same_graph_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.g2o", "b.g2o"):
        write_g2o(tmp_path / name, np.zeros((8, 3)), random_factors(2, 8))
    assert (tmp_path / "a.g2o").read_bytes() == (tmp_path / "b.g2o").read_bytes()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.g2o", "b.g2o"]


def test_a_failing_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(G2oError, match=r"graph\.g2o: cannot be written: no space"):
        write_g2o(path, np.zeros((8, 3)), random_factors(2, 8))
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_gtsam_reads_what_we_write(tmp_path: Path) -> None:
    factors = random_factors(5, 6)
    write_g2o(tmp_path / "graph.g2o", np.arange(18.0).reshape(6, 3) / 10, factors)
    graph, values = gtsam.readG2o(str(tmp_path / "graph.g2o"))
    edges = [factor for factor in factors if factor.i is not None]
    assert graph.size() == len(edges)
    assert values.size() == 6
    for index, edge in enumerate(edges):
        read: Any = graph.at(index)
        assert list(read.keys()) == [edge.i, edge.j]
        np.testing.assert_allclose(read.noiseModel().covariance(), edge.covariance, rtol=1e-6)
        measured = read.measured()
        np.testing.assert_allclose([measured.x(), measured.y(), measured.theta()], edge.T_i_j, atol=1e-12)


def test_off_diagonal_information_goes_where_the_format_says(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text("EDGE_SE2 0 1 1 2 0.5 10 1 2 20 3 30\n")
    (prior, edge), poses = read_g2o(path).factors, read_g2o(path).poses
    np.testing.assert_allclose(
        np.linalg.inv(edge.covariance), np.array([[10.0, 1.0, 2.0], [1.0, 20.0, 3.0], [2.0, 3.0, 30.0]]), rtol=1e-9
    )
    np.testing.assert_allclose(poses, np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]]))
    assert (prior.kind, prior.j, edge.kind) == ("prior", 0, "odometry")


def test_ids_with_gaps_become_indices(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text("VERTEX_SE2 40 1 0 0\nVERTEX_SE2 7 0 0 0\nFIX 40\n\nEDGE_SE2 7 40 1 0 0 1 0 0 1 0 1\n")
    graph = read_g2o(path)
    assert graph.ids.tolist() == [7, 40]
    assert graph.poses[:, 0].tolist() == [0, 1]
    prior, edge = graph.factors
    assert (prior.j, edge.i, edge.j, edge.kind) == (1, 0, 1, "closure")
    np.testing.assert_allclose(prior.T_i_j, [1, 0, 0])
    np.testing.assert_allclose(prior.covariance, np.eye(3) * FIX_SIGMA**2)


@pytest.mark.parametrize(
    "remark",
    [
        "measured twice",
        "odometry from wheel encoders",
        "closure l1 1.0",
        "prior knowledge",
        "closure huber 1.0 by hand",
    ],
)
def test_comments_of_others_are_passed_over(tmp_path: Path, remark: str) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(f"# made = by hand\n# and = so on\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1 # {remark}\n#\n")
    _, edge = read_g2o(path).factors
    assert (edge.kind, edge.kernel) == ("odometry", None)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("VERTEX_SE2 0 0 0\n", 1, "found 3 fields after VERTEX_SE2, expected 4"),
        ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", 2, "edge to vertex 1, which the file does not define"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\n", 2, "vertex 0 a second time"),
        ("\nVERTEX_SE2 zero 0 0 0\n", 2, "'zero', expected a vertex id"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 99999999999999999999 1 0 0\n", 2, "found 99999999999999999999, expected"),
        ("VERTEX_SE2 0 0 0 0,5\n", 1, "'0,5', expected a number"),
        ("VERTEX_SE2 0 0 nan 0\n", 1, "nan, expected a finite number"),
        ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", 1, "found VERTEX_SE3:QUAT, expected one of VERTEX_SE2"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 0 0 1\n", 1, "information matrix is positive definite"),
        ("EDGE_SE2 0 0 1 0 0 1 0 0 1 0 1\n", 1, "joined to itself"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1 # prior\n", 1, "only a prior"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1 # closure dcs wide\n", 1, "'wide', expected a number"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1 # closure dcs\n", 1, "expected KIND or KIND KERNEL WIDTH"),
        ("VERTEX_SE2 0 0 0 0\nFIX 3\n", 2, "FIX 3, which the file does not define"),
        ("VERTEX_SE2 0 0 0 0\nFIX\n", 2, "found 0 fields after FIX"),
    ],
)
def test_errors_name_path_line_found_and_expected(tmp_path: Path, text: str, line: int, message: str) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    with pytest.raises(G2oError, match=rf"bad\.g2o:{line}.*: .*") as caught:
        read_g2o(path)
    assert message in str(caught.value)


def test_errors_of_whole_files(tmp_path: Path) -> None:
    empty, binary, split = tmp_path / "empty.g2o", tmp_path / "binary.g2o", tmp_path / "split.g2o"
    empty.write_text("# nothing\n")
    binary.write_bytes(b"\xff\xfe\x00")
    split.write_text("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 5 6 1 0 0 1 0 0 1 0 1\n")
    for path, message in [
        (tmp_path / "missing.g2o", "No such file"),
        (empty, "neither vertices nor edges"),
        (binary, "not a text file"),
        (split, "2 of 4 poses are connected to no prior"),
    ]:
        with pytest.raises(G2oError, match=rf"{path.name}: .*{message}"):
            read_g2o(path)


@given(st.text(alphabet="VERTEX_SE2DGFIXPRO 0123456789.-e#=\nkind", max_size=200))
def test_any_text_is_read_or_refused_with_the_library_error(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.mktemp("g2o") / "any.g2o"
    path.write_text(text)
    with contextlib.suppress(G2oError):
        graph = read_g2o(path)
        assert len(graph.ids) == len(graph.poses) > 0


@pytest.mark.parametrize(
    ("name", "n_poses", "n_edges", "largest_error"),
    [
        ("manhattanOlson3500", 3500, 5598, 73.1),
        ("intel", 1728, 2512, 22.6),
        ("m3500-correlated", 3500, 5453, 1776.0),
        ("mit-weak-loops", 808, 827, 386.0),
    ],
)
def test_public_graphs_are_read_and_solved(
    data_dir: Path, name: str, n_poses: int, n_edges: int, largest_error: float
) -> None:
    graph = read_g2o(data_dir / "posegraph" / f"{name}.g2o")
    assert (len(graph.poses), len(graph.factors)) == (n_poses, n_edges + 1)
    result = optimize(graph.factors, graph.poses)
    assert result.error_after < largest_error

"""The factor graph of a run for other solvers: plain g2o, and serialised by GTSAM."""

from pathlib import Path

from graph.errors import reason
from graph.g2o import G2oGraph, read_g2o, write_g2o
from graph.publish import publishing
from iceg.export.options import ExportError, ExportOptions
from iceg.results import whole_results

GTSAM_FILES = ("factors.txt", "values.txt")


def write_plain_g2o(directory: Path, path: Path, options: ExportOptions) -> None:
    """Key poses and all factors with their information matrices."""
    del options
    graph = _graph(directory)
    write_g2o(path, graph.poses, graph.factors)


def write_gtsam(directory: Path, path: Path, options: ExportOptions) -> None:
    """A folder of `factors.txt` and `values.txt`: a `NonlinearFactorGraph` with its robust kernels, and the key poses.

    `gtsam.NonlinearFactorGraph().deserialize(text)` reads the one in Python, `gtsam::deserialize` in C++; `Values`
    likewise.
    """
    from graph.gtsam_bridge import to_gtsam_graph, to_gtsam_values

    del options
    graph = _graph(directory)
    texts = to_gtsam_graph(graph.factors).serialize(), to_gtsam_values(graph.poses).serialize()
    try:
        with publishing(path, replaces=GTSAM_FILES) as staging:
            for name, text in zip(GTSAM_FILES, texts, strict=True):
                (staging / name).write_text(text, encoding="ascii", newline="\n")
    except OSError as err:
        raise ExportError(f"{path}: cannot be written: {reason(err)}") from err


def _graph(directory: Path) -> G2oGraph:
    with whole_results(directory):
        return read_g2o(directory / "graph.g2o")

"""Draw the figures of the explanation pages from the embedded log: `python scripts/explanation_figures.py`."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import iceg
from graph.se2 import compose
from iceg.evaluation.surface import correlation_surface
from iceg.evaluation.trajectory import align, read_truth_csv
from iceg.slam.config import FinishConfig
from iceg.slam.joint_config import JointRefinementConfig

PAGES = Path(__file__).parent.parent / "docs" / "explanation"
SCAN = 400


def main() -> None:
    """Run the log with and without joint refinement, and draw."""
    log, truth = iceg.read_log(iceg.demo_log_path()), read_truth_csv(iceg.demo_truth_path())
    _save(_matching(log, truth), "ice.png")
    _save(_surface(log, truth), "covariances.png")
    refined = iceg.run(log)
    graph_alone = iceg.run(log, iceg.Config(finish=FinishConfig(joint=JointRefinementConfig(enabled=False))))
    _save(_closures(refined), "closures.png")
    _save(_errors({"the graph alone": graph_alone, "poses and walls": refined}, truth), "joint-refinement.png")


def _save(figure: Figure, name: str) -> None:
    figure.savefig(PAGES / name, dpi=110)
    Image.open(PAGES / name).convert("RGB").quantize(128).save(PAGES / name, optimize=True)


def _matching(log: iceg.Log, truth: np.ndarray) -> Figure:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.3, 1))
    scan, earlier, matcher = log.scan(SCAN), np.arange(SCAN - 60, SCAN, 6), iceg.IceMatcher()
    iceg.plot.scan_features(scan, iceg.extract_features(scan), left)
    reference = matcher.prepare([log.scan(int(k)) for k in earlier], truth[earlier])
    guess = compose(truth[SCAN], np.array([0.4, -0.3, np.radians(30.0)]))
    match = matcher.match(reference, scan, guess, np.diag([0.4, 0.4, 0.4]) ** 2)
    assert isinstance(match, iceg.RelativePose)
    iceg.plot.alignment(reference.surfels[:, :2], scan, guess, match.T_ref_cur, right)
    return figure


def _surface(log: iceg.Log, truth: np.ndarray) -> Figure:
    figure = Figure(figsize=(5.2, 4.4), layout="constrained")
    scan, earlier, matcher = log.scan(SCAN), np.arange(SCAN - 60, SCAN, 6), iceg.IceMatcher()
    reference = matcher.prepare([log.scan(int(k)) for k in earlier], truth[earlier])
    match = matcher.match(reference, scan, truth[SCAN], np.diag([0.1, 0.1, 0.1]) ** 2)
    assert isinstance(match, iceg.RelativePose)
    shifts, scores = correlation_surface(matcher, reference, scan, match.T_ref_cur, half_width=0.03)
    iceg.plot.correlation_surface(shifts, shifts, scores, figure.subplots(), np.zeros(2), match.covariance)
    return figure


def _closures(result: iceg.SlamResult) -> Figure:
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    iceg.plot.closures(result, figure.subplots())
    return figure


def _errors(results: dict[str, iceg.SlamResult], truth: np.ndarray) -> Figure:
    figure = Figure(figsize=(9, 3), layout="constrained")
    values = {}
    for name, result in results.items():
        aligned = compose(align(result.trajectory, truth), result.trajectory)
        values[name] = 1000.0 * np.hypot(*(aligned - truth)[:, :2].T)
    stamps = next(iter(results.values())).log.stamps
    iceg.plot.curves(stamps, values, figure.subplots(), label="position error [mm]")
    return figure


if __name__ == "__main__":
    main()

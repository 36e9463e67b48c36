"""The recall benchmark: on a simulated log whose truth gives the relations, and on real pairs of passes."""

from pathlib import Path

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.simulator.simulation import simulate
from graph.odometry import OdometryModel
from graph.se2 import between
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.recall import recall_benchmark
from iceg.evaluation.relations import Relations, read_relations_csv
from iceg.ice.config import IceConfig
from iceg.ice.matcher import IceMatcher
from iceg.slam.config import FrontEndConfig
from iceg.slam.tracking.log_tracking import track_log


def some(relations: Relations, kept: slice) -> Relations:
    return Relations(
        scans_i=relations.scans_i[kept],
        scans_j=relations.scans_j[kept],
        T_i_j=relations.T_i_j[kept],
        dropped=0,
        path=relations.path,
    )


def test_two_passes_of_a_room_are_found_and_features_are_what_finds_them() -> None:
    simulation = simulate("room", seed=1)
    log, truth = simulation.log, simulation.truth
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    near = [
        (i, j)
        for i in range(0, len(log), 10)
        for j in range(i + 201, len(log), 10)
        if np.hypot(*(truth[i] - truth[j])[:2]) < 1.5
    ][:40]
    scans_i, scans_j = np.array(near).T
    relations = Relations(
        scans_i=scans_i, scans_j=scans_j, T_i_j=between(truth[scans_i], truth[scans_j]), dropped=0, path=Path("truth")
    )
    result = recall_benchmark(log, relations, track, 1.0, np.radians(45.0), seed=2)
    assert result.n == len(near)
    assert result.recall > 0.95
    assert result.success > 0.9
    assert result.median_error < 0.03
    again = recall_benchmark(log, relations, track, 1.0, np.radians(45.0), seed=2)
    np.testing.assert_array_equal(result.translation_errors, again.translation_errors)
    without = recall_benchmark(
        log, relations, track, 1.0, np.radians(45.0), seed=2, matcher=IceMatcher(IceConfig(use_features=False))
    )
    assert without.recall < 0.3
    assert without.success < result.success


def test_relations_within_one_pass_are_refused() -> None:
    simulation = simulate("room", seed=1)
    relations = Relations(
        scans_i=np.array([0, 10]), scans_j=np.array([5, 200]), T_i_j=np.zeros((2, 3)), dropped=0, path=Path("near.csv")
    )
    track = track_log(simulation.log.select(slice(5)), IceMatcher(), OdometryModel(), FrontEndConfig())
    with pytest.raises(EvaluationError, match=r"near\.csv: none of its 2 relations joins two passes"):
        recall_benchmark(simulation.log, relations, track, 1.0, 1.0)


@pytest.mark.parametrize(("window_m", "window_deg"), [(1.0, 45.0), (3.0, 180.0)])
def test_real_passes_are_found(data_dir: Path, window_m: float, window_deg: float) -> None:
    log = read_log(data_dir / "mit-csail.clf.gz")
    track = track_log(log, IceMatcher(), OdometryModel(), FrontEndConfig())
    relations = some(read_relations_csv(data_dir / "mit-csail.relations.csv"), slice(None, None, 2))
    result = recall_benchmark(log, relations, track, window_m, np.radians(window_deg))
    assert result.n > 50
    assert result.recall >= 0.96
    assert result.success >= 0.88

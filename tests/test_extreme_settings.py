"""Settings at the ends of their ranges: refused where they are read, or a run that ends and says numbers."""

import warnings
from functools import cache

import numpy as np
import pytest

from frontends.logs import read_log
from frontends.scan import Log
from iceg.config import ConfigError, parse_config
from iceg.demo import demo_log_path
from iceg.pipeline import run


@cache
def _log() -> Log:
    """The first rooms of the embedded one."""
    return read_log(demo_log_path()).select(np.arange(300))


@pytest.mark.parametrize(
    "setting",
    [
        "front_end.calibration.least_noise.along_floor = 1e6",
        "front_end.calibration.min_floor = inf",
        "front_end.split_half.usual_distance2 = 1e-9",
        "front_end.sweep.pair_distance = 0.0",
        "front_end.tracking.unknown_odometry.heading_floor = 1e-9",
        "finish.joint.independence = 1e-9",
        "finish.joint.min_residual = 0.0",
        "graph.prior_sigma = 1e6",
        "ice.local_map.sharpen = 1e6",
        "loops.odometry_inflation = 0.0",
        "loops.relocalisation.maps.cell = inf",
        "loops.relocalisation.maps.most_cells = 1_000_000",
        "loops.relocalisation.maps.resolution = inf",
        "loops.view_distance = inf",
        "odometry.across_floor = 1e6",
        "feature_map.edge_on = inf",
    ],
)
def test_what_no_run_can_work_with_is_refused_with_what_is_expected(setting: str) -> None:
    key, _, value = setting.partition(" = ")
    name = key.rpartition(".")[2]
    number = f"{float(value)}" if "_" not in value else value.replace("_", "")
    with pytest.raises(ConfigError, match=rf"^here: .*{name} {number}, expected a .*number") as refusal:
        parse_config(setting, "here")
    assert key.rpartition(".")[0] in str(refusal.value)


@pytest.mark.parametrize(
    "settings",
    [
        "front_end.sweep = {min_points = 1, min_pairs = 1, gate = 1e6, max_share = 1e6}",
        "front_end.split_half = {window = 1, usual_distance2 = 0.01, min_distance2 = 100.0}",
        "front_end.calibration.sudden = {distance = 0.0, turn = 0.0, factor = 0.0}",
        "front_end.calibration = {window = 1, persistence_lags = 3, outlier_sigmas = 0.0}",
        "finish.joint = {elongation = 0.0, cell_facing = 1e6}",
        "finish.joint = {over_relaxation = 1e6, facing = 0.0}",
        "finish.joint = {correlated_points = 1.0, max_thinning = 1, max_points = 1}",
        "loops.failures = {unknown_distance = 1e-3, unknown_turn = 1e3}",
    ],
)
def test_a_run_at_the_ends_of_what_is_allowed_ends_with_numbers(settings: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = run(_log(), parse_config(settings, "here"))
    for numbers in (found.trajectory, found.covariances):
        assert np.isfinite(numbers).all()

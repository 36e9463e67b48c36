"""`iceg run --matcher NAME`: every matcher of the literature in the same pipeline, on the first metres of a room."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.logs.carmen import write_carmen
from frontends.matchers import MATCHERS
from frontends.simulator.simulation import Simulation, simulate
from iceg.cli import main
from iceg.config import Config, ConfigError, MatcherName, parse_config, read_config
from iceg.evaluation.paper import first_scans
from iceg.evaluation.trajectory import trajectory_errors
from iceg.pipeline import run
from iceg.results import RESULT_FILES
from iceg.run_folder import read_run_folder
from iceg.slam.stages import Stages

N_SCANS = 120
NAMES: tuple[MatcherName, ...] = get_args(MatcherName)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return first_scans(simulate("room", seed=3), N_SCANS)


@pytest.fixture(scope="module")
def log_file(simulation: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "room.clf"
    write_carmen(path, simulation.log)
    return path


def test_the_names_are_ice_and_every_matcher_of_the_literature() -> None:
    assert set(NAMES) == {"ice", *MATCHERS}
    assert Config().matcher == "ice"


@pytest.mark.parametrize("name", NAMES)
def test_each_matcher_runs_the_whole_pipeline(
    name: MatcherName, log_file: Path, simulation: Simulation, tmp_path: Path
) -> None:
    assert main(["run", str(log_file), "-o", str(tmp_path), "--matcher", name]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(RESULT_FILES)
    assert read_config(tmp_path / "config.toml").matcher == name
    poses = read_run_folder(tmp_path).trajectory.poses
    error = trajectory_errors(poses, simulation.truth).ate_rmse
    by_wheels = trajectory_errors(simulation.log.odometry, simulation.truth).ate_rmse
    assert error < 0.05, f"{name}: {error:.3f} m, odometry alone {by_wheels:.3f} m"


def test_the_settings_choose_and_a_matcher_passed_in_overrides_them(simulation: Simulation) -> None:
    def trajectory(config: Config) -> NDArray[np.float64]:
        return run(simulation.log, config).trajectory

    by_icp = trajectory(Config(matcher="icp"))
    assert not np.array_equal(by_icp, trajectory(Config()))
    passed_in = run(simulation.log, Config(matcher="csm"), stages=Stages(matcher=MATCHERS["icp"]())).trajectory
    np.testing.assert_array_equal(passed_in, by_icp)


def test_an_unknown_matcher_is_named_with_the_known_ones(
    log_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match="matcher"):
        parse_config('matcher = "icq"')
    with pytest.raises(SystemExit):
        main(["run", str(log_file), "-o", str(tmp_path), "--matcher", "icq"])
    assert "plicp" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []

"""Lasers that a scene or the command line can name."""

from dataclasses import replace
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from frontends.simulator.lasers import LASERS, like_which
from frontends.simulator.scene import load_scene, parse_scene, write_scene
from frontends.simulator.simulation import simulate
from frontends.simulator.world import SimulatorError
from iceg.cli.tools import Simulate

ROUTE = "start 0 0 0\ngoto 1 0\nbox 0 0 6 4\n"


@pytest.mark.parametrize("name", LASERS)
def test_a_scene_names_its_laser(name: str, tmp_path: Path) -> None:
    scene = parse_scene(f"{ROUTE}laser {name} range_std=0.02 sweep_time=-0.05\n", Path("named.world"))
    assert scene.laser.geometry.n_beams == LASERS[name]().geometry.n_beams
    assert (scene.laser.range_std, scene.laser.sweep_time) == (0.02, -0.05)
    write_scene(tmp_path / "again.world", scene)
    again = load_scene(str(tmp_path / "again.world")).laser
    assert again.range_std == 0.02
    np.testing.assert_array_equal(again.geometry.bearings, scene.laser.geometry.bearings)


@pytest.mark.parametrize("name", LASERS)
def test_a_laser_is_known_again(name: str) -> None:
    assert like_which(replace(LASERS[name](), range_std=0.5))[0] == name


def test_a_laser_that_nobody_knows() -> None:
    with pytest.raises(SimulatorError, match=r"named.world:4: found a laser 'velodyne', expected one of sick, "):
        parse_scene(f"{ROUTE}laser velodyne\n", Path("named.world"))


def test_a_sweep_longer_than_the_period() -> None:
    with pytest.raises(SimulatorError, match=r"named.world:4: laser.sweep_time must be no longer than the period"):
        parse_scene(f"{ROUTE}laser lds-01 sweep_time=-0.3\n", Path("named.world"))


@pytest.mark.parametrize("name", LASERS)
def test_each_records_a_log_that_does_not_say_how_it_sweeps(name: str) -> None:
    laser = LASERS[name]()
    scene = parse_scene(ROUTE, Path("box.world"))
    log = simulate(scene, laser=laser).log
    assert log.sweep is None
    assert np.isfinite(log.ranges).mean() > 0.5
    np.testing.assert_allclose(np.diff(log.stamps), laser.period)


def test_the_command_line_offers_them_all() -> None:
    offered = get_args(get_args(get_type_hints(Simulate)["laser"])[0])
    assert offered == tuple(LASERS)

"""Writing CARMEN logs: what is written is read back, whole and always the same."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from frontends.logs import LogError, read_log
from frontends.logs.carmen import write_carmen
from frontends.scan import Log, ScanGeometry

Pose = tuple[float, float, float]


def simulated(n_scans: int, n_beams: int, seed: int, T_robot_laser: NDArray[np.float64], view: float = math.pi) -> Log:
    random = np.random.default_rng(seed)
    ranges = random.uniform(0.5, 19.0, (n_scans, n_beams)).astype(np.float32)
    ranges[random.random(ranges.shape) < 0.1] = np.nan
    odometry = random.uniform(-30, 30, (n_scans, 3))
    odometry[:, 2] = random.uniform(-math.pi, math.pi, n_scans)
    return Log(
        ranges=ranges,
        odometry=odometry,
        stamps=np.array([1e9 + 0.2 * scan for scan in range(n_scans)]),
        geometry=ScanGeometry(
            bearings=np.linspace(-view / 2, view / 2, n_beams),
            range_min=0.02,
            range_max=20.0,
            T_robot_laser=T_robot_laser,
        ),
        path=Path("simulated"),
    )


@given(
    n_scans=st.integers(1, 6),
    n_beams=st.sampled_from([181, 361, 50]),
    seed=st.integers(0, 1000),
    mount=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0)),
    suffix=st.sampled_from([".clf", ".clf.gz"]),
    view=st.sampled_from([math.pi, math.radians(270.0), 2.0]),
)
@settings(max_examples=40)
def test_writing_and_reading_back(
    tmp_path_factory: pytest.TempPathFactory,
    n_scans: int,
    n_beams: int,
    seed: int,
    mount: Pose,
    suffix: str,
    view: float,
) -> None:
    log = simulated(n_scans, n_beams, seed, np.array(mount), view)
    path = tmp_path_factory.mktemp("round") / f"robot{suffix}"
    write_carmen(path, log)
    back = read_log(path, range_max=20.0)
    assert_allclose(back.ranges, log.ranges, atol=6e-4)
    assert_allclose(back.odometry, log.odometry, atol=1e-6)
    assert_allclose(back.stamps, log.stamps, atol=1e-6)
    assert_allclose(back.geometry.T_robot_laser, mount, atol=5e-5)
    assert_allclose(back.geometry.bearings, log.geometry.bearings, atol=1e-9)
    assert back.geometry.range_max == 20.0


def test_writing_is_whole_or_not_at_all_and_always_the_same(tmp_path: Path) -> None:
    log = simulated(3, 181, 0, np.zeros(3))
    first, second = tmp_path / "a.clf.gz", tmp_path / "b.clf.gz"
    write_carmen(first, log)
    write_carmen(second, log)
    assert first.read_bytes() == second.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.clf.gz", "b.clf.gz"]
    uneven = dataclasses.replace(log.geometry, bearings=np.linspace(-1.2, 1.2, 181) ** 3)
    with pytest.raises(LogError, match="found unevenly spread beams"):
        write_carmen(first, dataclasses.replace(log, geometry=uneven))
    with pytest.raises(LogError, match="cannot be written"):
        write_carmen(tmp_path / "no" / "folder.clf", log)

"""The mapper: scan by scan what a run does, in the end the same to the byte, and errors that name the scan."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import iceg
from frontends.growing_log import GrowingLog
from frontends.scan import Log, ScanError
from graph.growing_rows import GrowingRows
from graph.se2 import between
from iceg.mapper import Event, Mapper, MapperUpdate

N_SCANS = 700
_WRITTEN = ("trajectory.tum", "graph.g2o", "map.pgm", "covariances.csv", "closures.csv", "features.geojson")


def first_part(log: Log, n_scans: int) -> Log:
    return Log(
        ranges=log.ranges[:n_scans],
        odometry=log.odometry[:n_scans],
        stamps=log.stamps[:n_scans],
        geometry=log.geometry,
        path=log.path,
    )


def mapped(log: Log, *, with_odometry: bool = True) -> tuple[Mapper, list[MapperUpdate]]:
    mapper = Mapper(log.geometry, name=log.path.name)
    updates = [
        mapper.add(log.ranges[scan], log.odometry[scan] if with_odometry else None, float(log.stamps[scan]))
        for scan in range(len(log))
    ]
    return mapper, updates


@pytest.fixture(scope="module")
def log() -> Log:
    """A lap of the embedded log, with loops in it."""
    return first_part(iceg.read_log(iceg.demo_log_path()), N_SCANS)


@pytest.fixture(scope="module")
def lap(log: Log) -> tuple[Mapper, list[MapperUpdate]]:
    return mapped(log)


@pytest.fixture(scope="module")
def result(log: Log) -> iceg.SlamResult:
    return iceg.run(log)


def test_the_finish_is_a_run_to_the_byte(
    lap: tuple[Mapper, list[MapperUpdate]], result: iceg.SlamResult, tmp_path: Path
) -> None:
    iceg.write_results(lap[0].finish(), tmp_path / "mapper", report=False)
    iceg.write_results(result, tmp_path / "run", report=False)
    for name in _WRITTEN:
        assert (tmp_path / "mapper" / name).read_bytes() == (tmp_path / "run" / name).read_bytes(), name


def test_the_poses_on_the_way_are_near_those_of_a_run(
    lap: tuple[Mapper, list[MapperUpdate]], result: iceg.SlamResult
) -> None:
    mapper, updates = lap
    at_once = np.array([update.pose for update in updates])
    offsets = np.hypot(*between(result.trajectory, at_once)[:, :2].T)
    assert np.median(offsets) < 0.05
    assert offsets.max() < 0.3
    by_now = np.hypot(*between(result.trajectory, mapper.result().trajectory)[:, :2].T)
    assert by_now.max() < 0.2


def test_the_events_tell_what_happened(lap: tuple[Mapper, list[MapperUpdate]]) -> None:
    mapper, updates = lap
    events = [update.event for update in updates]
    assert events[0] is Event.FIRST
    assert Event.FIRST not in events[1:]
    assert events.count(Event.LOOP_CLOSED) > 0
    assert events.count(Event.MATCHED) > N_SCANS / 2
    keys = [update.scan for update in updates if update.is_key_scan]
    result = mapper.result()
    np.testing.assert_array_equal(keys, result.key_scans)
    assert [update.scan for update in updates] == list(range(N_SCANS))
    np.testing.assert_allclose(updates[-1].pose, result.trajectory[-1], atol=1e-9)


def test_covariances_are_those_of_the_graph_at_key_scans_and_more_behind_them(
    lap: tuple[Mapper, list[MapperUpdate]],
) -> None:
    _, updates = lap
    covariances = np.array([update.covariance for update in updates])
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 1, 2), atol=1e-15)
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()
    for before, after in pairwise(updates[1:]):
        if before.is_key_scan and after.event is Event.MATCHED:
            assert after.covariance[2, 2] > before.covariance[2, 2]


def test_the_maps_show_what_was_seen(lap: tuple[Mapper, list[MapperUpdate]], result: iceg.SlamResult) -> None:
    now = lap[0].map()
    assert now.grid.resolution == result.grid.resolution
    walls, walls_of_run = ((grid.occupancy() > 0.65).sum() for grid in (now.grid, result.grid))
    assert walls == pytest.approx(walls_of_run, rel=0.2)
    assert len(now.landmarks.settled()) == pytest.approx(len(result.landmarks.settled()), rel=0.3)


def test_what_it_says_on_the_way_does_not_depend_on_being_asked_for_more(log: Log) -> None:
    asked, quiet = (Mapper(log.geometry) for _ in range(2))
    for scan in range(250):
        one, other = (m.add(log.ranges[scan], log.odometry[scan], float(log.stamps[scan])) for m in (asked, quiet))
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-6)
        assert one.event is other.event
        if scan % 60 == 59:
            asked.result()
            asked.map()


def test_it_needs_no_odometry(log: Log, result: iceg.SlamResult) -> None:
    mapper, updates = mapped(first_part(log, 300), with_odometry=False)
    at_once = np.array([update.pose for update in updates])
    offsets = np.hypot(*between(result.trajectory[:300], at_once)[:, :2].T)
    assert offsets.max() < 0.3
    assert not mapper.result().log.has_odometry


def test_a_covered_laser_is_told_and_odometry_carries_on(log: Log) -> None:
    mapper, updates = mapped(first_part(log, 120))
    blind = np.full(log.geometry.n_beams, np.nan)
    covered = [mapper.add(blind, log.odometry[scan], float(log.stamps[scan])) for scan in range(120, 130)]
    assert {update.event for update in covered} == {Event.COVERED}
    assert np.trace(covered[-1].covariance) > np.trace(updates[-1].covariance)


def test_the_noise_of_the_laser_is_learned_after_a_hundred_scans(log: Log) -> None:
    few = first_part(log, 140)
    noise = np.random.default_rng(5).normal(scale=0.06, size=few.ranges.shape)
    noisy = replace(few, ranges=(few.ranges + noise).astype(np.float32))
    mapper, updates = mapped(noisy)
    assert [update.scan for update in updates] == list(range(140))
    laser = mapper.result().summary["laser"]
    assert laser is not None
    assert laser["noise_m"] == pytest.approx(0.06, rel=0.3)
    offsets = np.hypot(*between(iceg.run(noisy).trajectory, np.array([update.pose for update in updates]))[:, :2].T)
    assert offsets.max() < 0.3


@pytest.mark.parametrize(
    ("ranges", "odometry", "stamp", "message"),
    [
        (np.ones(7), np.zeros(3), 1.0, r"ranges of shape \(7,\), expected \(\d+,\)"),
        (None, np.array([0.0, np.nan, 0.0]), 1.0, "found NaN or infinity in odometry, expected finite numbers"),
        (None, np.zeros(2), 1.0, r"found odometry of shape \(2,\), expected \(3,\)"),
        (None, np.array([1e12, 0.0, 0.0]), 1.0, r"scan 20: odometry: found"),
        (None, np.zeros(3), np.inf, "found NaN or infinity in stamps"),
        (None, None, 1.0, "found none odometry at scan 20, expected some"),
        (None, np.zeros(3), None, "found none stamps at scan 20, expected some"),
    ],
)
def test_what_is_no_scan_is_refused_and_left_out(
    log: Log,
    ranges: NDArray[np.float64] | None,
    odometry: NDArray[np.float64] | None,
    stamp: float | None,
    message: str,
) -> None:
    growing = GrowingLog(log.geometry, Path("log"))
    for scan in range(20):
        growing.append(log.ranges[scan], log.odometry[scan], float(log.stamps[scan]))
    with pytest.raises(ScanError, match=message):
        growing.append(log.ranges[20] if ranges is None else ranges, odometry, stamp)
    growing.append(log.ranges[20], log.odometry[20], float(log.stamps[0]))  # a stamp may step back
    np.testing.assert_array_equal(growing.log().ranges, log.ranges[:21])


def test_without_a_scan_there_is_nothing_to_tell(log: Log) -> None:
    for ask in (Mapper.map, Mapper.result, Mapper.finish):
        with pytest.raises(ScanError, match="found no scan, expected at least one"):
            ask(Mapper(log.geometry))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(allow_nan=False), max_size=300))
def test_rows_that_grow_are_the_rows_that_came(values: list[float]) -> None:
    growing: GrowingRows[np.float64] = GrowingRows((2,), np.float64)
    seen = growing.rows
    for value in values:
        growing.append([value, -value])
    assert len(growing) == len(values)
    assert len(seen) == 0
    np.testing.assert_array_equal(growing.rows, np.array([[v, -v] for v in values]).reshape(-1, 2))

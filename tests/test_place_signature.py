"""What a place looks like: counted right, the same however the place is turned, and enough to find it again."""

from dataclasses import replace
from math import atan2, cos, floor, hypot, pi, sin, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.simulator.simulation import simulate
from graph.odometry import OdometryModel
from graph.se2 import compose, transform_points
from iceg.ice.matcher import IceMatcher
from iceg.slam.closure_config import PlaceSignatureConfig
from iceg.slam.closures import _signature_kernels as kernels
from iceg.slam.closures.place_signature import PlaceSignatures, place_signatures
from iceg.slam.config import FrontEndConfig
from iceg.slam.track import Track
from iceg.slam.tracking.log_tracking import track_log


@pytest.fixture(scope="module")
def seen() -> tuple[Track, NDArray[np.float64]]:
    """Track of the office, and the true poses of its key scans."""
    office = simulate("office", seed=1)
    track = track_log(office.log, IceMatcher(), OdometryModel(), FrontEndConfig())
    return track, np.asarray(office.truth[[key.index for key in track.keys]])


def _random_features(rng: np.random.Generator, n: int) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    kinds = rng.integers(0, 3, n).astype(np.int8)
    rows = np.zeros((n, 10))
    rows[:, :2] = rng.uniform(-4, 4, (n, 2))
    rows[:, 2:4] = rng.uniform(-pi, pi, (n, 2))
    rows[kinds == 1, 2] = np.nan
    return kinds, rows


def _counted_slowly(
    kinds: NDArray[np.int8], rows: NDArray[np.float64], hits: NDArray[np.float64], bins: int
) -> NDArray[np.float64]:
    reach, cell, sectors, closest = 6.0, 0.4, 6, 0.3
    histogram = np.zeros(bins)

    def direction(row: NDArray[np.float64]) -> float:
        walls = [angle for angle in row[2:4] if not np.isnan(angle)]
        return atan2(sum(map(sin, walls)), sum(map(cos, walls)))

    def sector(angle: float) -> int:
        return floor(angle / (2 * pi) * sectors + 0.5) % sectors

    for i in range(len(kinds)):
        for j in range(i + 1, len(kinds)):
            dx, dy = rows[j, :2] - rows[i, :2]
            distance = hypot(dx, dy)
            if not closest <= distance < reach:
                continue
            ends = sorted(
                [
                    int(kinds[i]) * sectors + sector(direction(rows[i]) - atan2(dy, dx)),
                    int(kinds[j]) * sectors + sector(direction(rows[j]) - atan2(dy, dx) - pi),
                ]
            )
            lower = floor(distance / cell)
            share = distance / cell - lower
            word = (ends[0] * 3 * sectors + ends[1]) * (int(reach / cell) + 2) + lower
            weight = sqrt(min(4.0, hits[i]) * min(4.0, hits[j]))
            histogram[word * 2654435761 % bins] += weight * (1 - share)
            histogram[(word + 1) * 2654435761 % bins] += weight * share
    return histogram


def test_pairs_are_counted_as_the_slow_way_counts_them() -> None:
    rng = np.random.default_rng(3)
    kinds, rows = _random_features(rng, 25)
    hits = rng.integers(1, 9, 25).astype(float)
    histogram = np.zeros(128)
    kernels.count_pairs(kinds, rows, hits, kernels.Words(0.3, 6.0, 0.4, 6, 4.0), histogram)
    np.testing.assert_allclose(histogram, _counted_slowly(kinds, rows, hits, 128), rtol=1e-12, atol=1e-12)
    assert histogram.sum() > 0


def test_distances_are_counted_as_numpy_counts_them() -> None:
    rng = np.random.default_rng(4)
    points, starts = rng.uniform(-3, 3, (400, 2)), np.array([0, 150, 150, 400])
    poses = np.array([[0.5, -0.2, 0.3], [0.0, 0.0, 0.0], [-1.0, 2.0, 2.5]])
    placed = np.vstack([transform_points(poses[k], points[starts[k] : starts[k + 1]]) for k in range(3)])
    first = {
        tuple(cell): point
        for cell, point in zip(np.floor(placed[::-1] / 0.4).tolist(), placed[::-1], strict=True)
        if np.hypot(*point) < 4.0
    }
    thinned = np.array(list(first.values()))
    assert 50 < len(thinned) < 300
    apart = np.hypot(*(thinned[:, None] - thinned[None, :]).transpose(2, 0, 1))[np.triu_indices(len(thinned), 1)]
    histogram = np.zeros(20)
    kernels.count_distances(points, starts, poses, 4.0, 0.4, 0.25, histogram)
    np.testing.assert_array_equal(histogram, np.histogram(apart[apart < 5.0], bins=20, range=(0.0, 5.0))[0])


def test_a_turned_and_moved_track_has_the_same_signatures(seen: tuple[Track, NDArray[np.float64]]) -> None:
    keys = seen[0].keys[:80]
    moved = [replace(key, T_track_robot=compose([30.0, -7.0, 2.0], key.T_track_robot)) for key in keys]
    here, there = (
        place_signatures(keys, IceMatcher(), 4, PlaceSignatureConfig()),
        place_signatures(moved, IceMatcher(), 4, PlaceSignatureConfig()),
    )
    np.testing.assert_array_equal(here.keys, there.keys)
    np.testing.assert_allclose(here.rows, there.rows, atol=1e-4)


def test_a_place_is_most_like_itself_and_likeness_has_no_direction(seen: tuple[Track, NDArray[np.float64]]) -> None:
    signatures = place_signatures(seen[0].keys, IceMatcher(), 4, PlaceSignatureConfig())
    everything = np.arange(len(signatures.keys))
    likeness = signatures.likeness(everything)
    np.testing.assert_allclose(likeness, likeness.T, atol=1e-5)
    assert (likeness.argmax(axis=1) == everything).mean() > 0.95


def test_likeness_in_blocks_is_the_product_of_the_signatures() -> None:
    rng = np.random.default_rng(0)
    for m, width in ((70, 1064), (40, 30_000)):
        signatures = PlaceSignatures(keys=np.arange(m), rows=rng.normal(size=(m, width)).astype(np.float32))
        queries = rng.permutation(m)[: m - 3]
        np.testing.assert_allclose(
            signatures.likeness(queries), signatures.rows[queries] @ signatures.rows.T, atol=1e-5 * width
        )


def test_sequences_are_compared_in_both_directions(seen: tuple[Track, NDArray[np.float64]]) -> None:
    signatures = place_signatures(seen[0].keys, IceMatcher(), 4, PlaceSignatureConfig())
    likeness = signatures.likeness(np.arange(len(signatures.keys)))
    one, other = 20, 60
    steps = np.arange(-2, 3)
    same, opposite = likeness[one + steps, other + steps].mean(), likeness[one + steps, other - steps].mean()
    found = signatures.likeness_along(np.array([one]), np.array([other]), 2)
    assert found[0] == pytest.approx(max(same, opposite), abs=1e-5)


def test_places_driven_by_again_the_same_way_are_among_the_three_most_similar(
    seen: tuple[Track, NDArray[np.float64]],
) -> None:
    track, truth = seen
    signatures = place_signatures(track.keys, IceMatcher(), 4, PlaceSignatureConfig())
    poses = truth[signatures.keys]
    path = np.cumsum([key.motion.distance for key in track.keys])[signatures.keys]
    apart = np.hypot(*(poses[:, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    turned = np.abs((poses[:, None, 2] - poses[None, :, 2] + pi) % (2 * pi) - pi)
    earlier = path[:, None] - path[None, :] > 8.0
    again = np.flatnonzero((earlier & (apart < 1.0) & (turned < 0.5)).any(axis=1))
    likeness = np.where(earlier, signatures.likeness(np.arange(len(path))), -1.0)
    found = [(apart[k, np.argsort(-likeness[k])[:3]] < 2.5).any() for k in again]
    assert len(again) >= 5
    assert np.mean(found) >= 0.8

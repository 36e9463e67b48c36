"""What a place looks like, in numbers that do not depend on where the robot believes to be.

The signature of a place is made of a local map of several key scans. Pairs of its features are words (kinds, distance,
bearings relative to the walls), weighed by how rare they are in the log, as in text retrieval; the distances between
all its points (the shape distribution D2 of Osada et al., Shape distributions, 2002) tell its free space. Both stay the
same when the place is turned or moved.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graph.arrays import Float32s, Floats, Ints
from graph.elementary import log
from graph.se2 import between
from iceg.ice import _hypothesis_kernels as hypothesis_kernels
from iceg.ice.features import FeatureRows
from iceg.ice.matcher import IceMatcher, Observation
from iceg.ice.sweeps import joined, starts_of
from iceg.slam.closure_config import PlaceSignatureConfig
from iceg.slam.closures import _signature_kernels as kernels
from iceg.slam.track import KeyScan


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSignatures:
    """The places of a log.

    Attributes:
        keys: (m,) the key pose in the middle of each place, increasing.
        rows: (m, d) float32 signatures; the product of two is their likeness, at most 1 + 0.3.
    """

    keys: Ints
    rows: Float32s

    def likeness(self, queries: Ints) -> Float32s:
        """(q, m) how much each of these places, given by their row, looks like every place."""
        return kernels.likeness(self.rows[queries], self.rows)

    def likeness_along(self, ones: Ints, others: Ints, half: int) -> Float32s:
        """(n,) how similar pairs are with `half` places on either side, driven the same or the opposite way."""

        def likeness(step: int, way: int) -> Float32s:
            last = len(self.rows) - 1
            one, other = np.clip(ones + step, 0, last), np.clip(others + way * step, 0, last)
            return np.asarray((self.rows[one] * self.rows[other]).sum(axis=1))

        steps = range(-half, half + 1)
        means = [np.mean([likeness(step, way) for step in steps], axis=0) for way in (1, -1)]
        return np.asarray(np.maximum(*means), dtype=np.float32)


def place_signatures(
    keys: Sequence[KeyScan], matcher: IceMatcher, spacing: int, config: PlaceSignatureConfig
) -> PlaceSignatures:
    """Signatures of the places along a track.

    Args:
        keys: its key scans; only poses of neighbours relative to each other count.
        matcher: extracts the features.
        spacing: key scans from one place to the next.
        config: what makes a place, and of what its signature is made.
    """
    middles = np.arange(0, len(keys), spacing, dtype=np.int64)
    T_track_keys = np.array([key.T_track_robot for key in keys])
    words, shapes = np.zeros((len(middles), config.word_bins)), np.zeros((len(middles), config.distance_bins))
    latest: deque[Observation] = deque(maxlen=2 * config.half + 1)
    seen = 0
    for row, middle in enumerate(middles.tolist()):
        first, end = max(0, middle - config.half), min(len(keys), middle + config.half + 1)
        T_middle_members = between(T_track_keys[middle], T_track_keys[first:end])
        latest.extend(matcher.observe(key.scan) for key in keys[max(seen, first) : end])
        seen = end
        observations = list(latest)[first - end :]
        _count_words([observation.features for observation in observations], T_middle_members, config, words[row])
        points = [observation.points.points for observation in observations[:: config.point_every]]
        kernels.count_distances(
            joined(points),
            starts_of(points),
            T_middle_members[:: config.point_every],
            config.point_reach,
            config.point_cell,
            config.distance_cell,
            shapes[row],
        )
    rarity = log(len(middles) / np.maximum(1, np.count_nonzero(words, axis=0)))
    looks = _unit(np.sqrt(words) * rarity)
    shape = np.sqrt(shapes)
    shape = _unit(shape - shape.mean(axis=0)) * np.sqrt(config.shape_weight)
    return PlaceSignatures(keys=middles, rows=np.hstack([looks, shape]).astype(np.float32))


def _count_words(
    features: list[FeatureRows], T_middle_members: Floats, config: PlaceSignatureConfig, histogram: Floats
) -> None:
    """Count the pairs among the features that several scans of the place saw."""
    most = config.max_features
    kinds, rows, hits = np.empty(most, np.int8), np.empty((most, 10)), np.empty(most)
    n = hypothesis_kernels.merge_features(
        joined([of_scan.kinds for of_scan in features]),
        joined([of_scan.rows for of_scan in features]),
        starts_of([of_scan.kinds for of_scan in features]),
        T_middle_members,
        config.merge_radius,
        kinds,
        rows,
        hits,
        0,
    )
    kept = (hits[:n] >= config.min_scans) & (rows[:n, 8] > 0.5)
    words = kernels.Words(
        config.word_closest, config.word_reach, config.word_cell, config.word_sectors, config.word_max_hits
    )
    kernels.count_pairs(kinds[:n][kept], rows[:n][kept], hits[:n][kept], words, histogram)


def _unit(rows: Floats) -> Floats:
    length = np.sqrt((rows * rows).sum(axis=1, keepdims=True))
    return np.asarray(rows / np.maximum(1e-12, length), dtype=np.float64)

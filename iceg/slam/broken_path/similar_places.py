"""Pairs of similar places: where to look for loop closures when the path cannot say."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph.arrays import Float32s, Floats, Ints
from iceg.ice.matcher import IceMatcher
from iceg.slam.closures.candidates import ANCHOR_SPACING
from iceg.slam.closures.place_signature import PlaceSignatures, place_signatures
from iceg.slam.config import LoopClosureConfig
from iceg.slam.track import Track

_PLACES_AT_ONCE = 512
"""Rows of the matrix of likeness in memory at a time."""


def similar_places(track: Track, judge: IceMatcher, parts: Ints, config: LoopClosureConfig) -> list[tuple[int, int]]:
    """Pairs of key poses of parts that nothing joins whose places are similar.

    Half of them where the place itself is, half where the neighbouring places are, too: among hundreds of similar
    places, as along the doors of a corridor (perceptual aliasing), only a sequence tells.

    Args:
        track: key scans.
        judge: prepares them.
        parts: (k,) which part each key pose belongs to.
        config: how many are wanted, and how much path must lie between the two.

    Returns:
        The earlier and the later key pose of each pair, the most similar first.
    """
    signatures = place_signatures(track.keys, judge, ANCHOR_SPACING, config.signatures)
    places = signatures.keys
    path = track.path[places]
    likeness_of, pairs = _most_similar(signatures, path, parts[places], config)
    if not len(pairs):
        return []
    along = signatures.likeness_along(pairs[:, 1], pairs[:, 0], config.signatures.sequence)
    order = np.argsort(np.minimum(_ranks(likeness_of), _ranks(along)), kind="stable")[: config.places]
    return [(int(places[old]), int(places[new])) for old, new in pairs[order].tolist()]


def _most_similar(
    signatures: PlaceSignatures, path: Floats, parts: Ints, config: LoopClosureConfig
) -> tuple[Floats, Ints]:
    """Likeness (n,) and rows (n, 2) of the pairs of an earlier and a later place, a few for each later one."""
    likeness_of, rows = [], []
    for first in range(0, len(path), _PLACES_AT_ONCE):
        queries = np.arange(first, min(first + _PLACES_AT_ONCE, len(path)))
        likeness = signatures.likeness(queries)
        apart = parts[queries, None] != parts[None, :]
        earlier = path[queries, None] - path[None, :] > config.min_path
        likeness[~(apart & earlier)] = 0.0
        for query, row in zip(queries.tolist(), likeness, strict=True):
            best = _best(row, config.places_each, config.relocalisation.same_pass)
            likeness_of += [value for value, _ in best]
            rows += [(other, query) for _, other in best]
    return np.array(likeness_of), np.array(rows, dtype=np.int64)


def _best(likeness: Float32s, wanted: int, same_pass: int) -> list[tuple[float, int]]:
    """The most similar places and how much, the best of each pass."""
    found = []
    for _ in range(wanted):
        best = int(likeness.argmax())
        if likeness[best] <= 0.0:
            break
        found.append((float(likeness[best]), best))
        likeness[max(0, best - same_pass) : best + same_pass + 1] = 0.0
    return found


def _ranks(values: NDArray[np.floating[Any]]) -> Ints:
    """(n,) place of each value among all, the largest first."""
    ranks = np.empty(len(values), dtype=np.int64)
    ranks[np.argsort(-values, kind="stable")] = np.arange(len(values))
    return ranks

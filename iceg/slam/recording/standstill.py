"""Odometry that stands still although the robot moves, and does not make up for it: it is dead."""

import numpy as np

from graph.arrays import Float32s, Floats
from iceg.slam.recording.steps import is_moving
from iceg.slam.run_warning import RunWarning
from iceg.slam.tracking_config import StandstillConfig


def dead_intervals(odometry: Floats, ranges: Float32s, config: StandstillConfig) -> list[tuple[int, int]]:
    """Intervals of a log over which the odometry stands still while the scans say that the robot moves.

    Args:
        odometry: (n, 3) at each scan.
        ranges: (n, n_beams) [m], NaN where nothing came back.
        config: how much must change.

    Returns:
        First and last scan of each; between them, odometry says nothing.
    """
    moves = np.flatnonzero(is_moving(odometry)).tolist()
    standstills = zip([0, *(move + 1 for move in moves)], [*moves, len(odometry) - 1], strict=True)
    return [
        (first, last)
        for first, last in standstills
        if last - first > config.unjudged and scans_change(ranges[first : last + 1], config)
    ]


def describe_dead(first: int, last: int) -> RunWarning:
    """An interval without odometry in a sentence for a person."""
    sentence = (
        f"the odometry stands still from scan {first} to scan {last} while the scans change: it is not believed there"
    )
    return RunWarning(kind="odometry stands still", sentence=sentence, scan=first)


def scans_change(ranges: Float32s, config: StandstillConfig) -> bool:
    """Whether several scans differ from the one that sees most by more than noise and passers-by explain."""
    samples = np.unique(np.linspace(config.ends, len(ranges) - 1 - config.ends, config.samples + 1).astype(int))
    fullest = samples[np.argmax(np.count_nonzero(np.isfinite(ranges[samples]), axis=1))]
    changes = _changes(ranges[fullest], ranges[samples], config)
    if np.count_nonzero(changes > config.min_change) < config.changed_samples:
        return False
    noise = float(np.median(_changes(ranges[samples - 1], ranges[samples], config)))
    if noise == np.inf:  # no laser loses most beams from one scan to the next
        return True
    return int(np.sum(changes > max(config.min_change, config.min_change_factor * noise))) >= config.changed_samples


def _changes(before: Float32s, after: Float32s, config: StandstillConfig) -> Floats:
    """Change of the beams that return in one of two scans or in both, the least but for a few; 0 if one sees little.

    A beam that returns in one of them alone has changed by more than any range can, as at the trunks of a wood.

    Args:
        before: (n_beams,) or (n, n_beams) [m].
        after: (n, n_beams) [m].
        config: how many may be changed less, and how many each scan must see.

    Returns:
        (n,) [m].
    """
    returns = np.isfinite(before), np.isfinite(after)
    seen = np.count_nonzero(returns[0] | returns[1], axis=1)
    fewer = np.minimum(*(np.count_nonzero(one, axis=-1) for one in returns))
    differences = np.where(returns[0] | returns[1], np.inf, -np.inf)
    np.abs(np.subtract(after, before), out=differences, where=returns[0] & returns[1])
    differences.sort(axis=1)
    rows = np.flatnonzero(fewer > config.min_seen * differences.shape[1])
    unseen = differences.shape[1] - seen[rows]
    at = unseen + (config.unchanged_share * (seen[rows] - 1)).astype(np.int64)
    changes = np.zeros(len(differences))
    changes[rows] = differences[rows, at]
    return changes

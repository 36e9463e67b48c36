"""Closures forbidden between scans, as a question about key poses."""

from collections.abc import Sequence

from iceg.corrections.corrections import Forbidden
from iceg.slam.loop_closure import Forbids
from iceg.slam.track import Track


def forbids(forbidden: Sequence[Forbidden], track: Track) -> Forbids:
    """Whether a closure between an earlier and a later key pose is forbidden.

    The closure between two scans is the one of the key poses they are tied to; one between intervals joins key scans
    of both.

    Args:
        forbidden: by a person; scans counted as the track counts them.
        track: key scans.
    """
    pairs, intervals = set(), []
    scans = track.key_scans
    for each in forbidden:
        if each.is_single:
            i, j = track.key_of_scan[[each.one[0], each.other[0]]].tolist()
            pairs |= {(i, j), (j, i)}
        else:
            one, other = ((scans >= first) & (scans <= last) for first, last in (each.one, each.other))
            intervals.append((one, other))

    def is_forbidden(key_old: int, key_new: int) -> bool:
        if (key_old, key_new) in pairs:
            return True
        return any((one[key_old] and other[key_new]) or (other[key_old] and one[key_new]) for one, other in intervals)

    return is_forbidden

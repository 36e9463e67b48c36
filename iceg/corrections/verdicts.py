"""`closures.csv` handed back: what its verdicts ask for that a run has decided otherwise."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from iceg.corrections.corrections import Corrections, Forbidden, GivenVerdict, Pinned
from iceg.corrections.manual_closures import ManualClosure
from iceg.slam.closures.attempt import Attempt
from iceg.slam.track import Track


def from_verdicts(corrections: Corrections, attempts: Sequence[Attempt], track: Track) -> Corrections:
    """The same corrections, the rows handed back as what they ask for.

    A row of a closure that the run has tried forbids it where it says "rejected" and the run believed it, has it
    believed where it says "accepted" and the run did not, and pins it where it says "pinned". Other rows are closures
    by hand of an earlier run.

    Args:
        corrections: scans counted as the track counts them.
        attempts: what the run has tried.
        track: key scans.
    """
    tried = {(track.keys[a.key_old].index, track.keys[a.key_new].index): a for a in attempts}
    seen: Counter[tuple[int, int]] = Counter()
    forbidden, added, pinned = list(corrections.forbidden), list(corrections.added), list(corrections.pinned)
    for row in corrections.verdicts:
        scans = (row.scan_i, row.scan_j)
        seen[scans] += 1
        attempt = tried.get(scans) if seen[scans] == 1 else None
        if row.verdict == "removed":
            continue
        if attempt is None:
            if row.verdict != "rejected":
                added.append(_by_hand(row))
        elif row.verdict == "rejected":
            if attempt.accepted:
                one, other = ((scan, scan) for scan in scans)
                forbidden.append(Forbidden(one=one, other=other, is_single=True, where=row.where))
        elif attempt.match is None:
            added.append(_by_hand(row))
        elif row.verdict == "pinned":
            pinned.append(Pinned(scan_i=row.scan_i, scan_j=row.scan_j, where=row.where))
        elif not attempt.accepted:
            added.append(replace(_by_hand(row), T_i_j=attempt.match.T_ref_cur))
    return replace(corrections, forbidden=tuple(forbidden), added=tuple(added), pinned=tuple(pinned), verdicts=())


def _by_hand(row: GivenVerdict) -> ManualClosure:
    return ManualClosure(
        scan_i=row.scan_i,
        scan_j=row.scan_j,
        T_i_j=row.T_i_j,
        pinned=row.verdict == "pinned",
        where=row.where,
    )

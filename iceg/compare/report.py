"""What a comparison of two runs says in the terminal."""

import math

from iceg.compare.comparison import BEYOND, Comparison

_MOST = 10


def format_comparison(comparison: Comparison, names: tuple[str, str]) -> str:
    """Lines for a terminal: figures, the worst intervals, the first closures that only one run has.

    Args:
        comparison: of the runs.
        names: of run A and run B.
    """
    lone = comparison.lone_closures
    beyond = 100 * float((comparison.sigmas > BEYOND).mean())
    lines = [
        f"A: {names[0]}",
        f"B: {names[1]}",
        f"  distance, mean [m]                  {comparison.mean_distance:10.4f}",
        f"  distance, largest [m]               {comparison.largest_distance:10.4f}",
        f"  key poses beyond both claims [%]    {beyond:10.1f}",
        f"  closures in both                    {comparison.shared_closures:10d}",
        f"  closures only in A                  {sum(closure.only_in == 'A' for closure in lone):10d}",
        f"  closures only in B                  {sum(closure.only_in == 'B' for closure in lone):10d}",
    ]
    if comparison.intervals:
        lines.append(f"Where they differ by more than {BEYOND:.2f} σ:")
        lines.append("        scans          distance [m]  turn [°]      σ  at scan")
        for interval in comparison.intervals[:_MOST]:
            scans = f"{interval.first_scan}-{interval.last_scan}"
            lines.append(
                f"  {scans:>15}  {interval.distance:16.4f}  {math.degrees(interval.turn):8.2f}  {interval.sigmas:5.1f}"
                f"  {interval.worst_scan:7d}"
            )
        lines += _and_more(len(comparison.intervals))
    if lone:
        lines.append("Closures that only one has:")
        lines += [
            f"  {closure.only_in}: {closure.scan_i} and {closure.scan_j}; the other: {closure.elsewhere}"
            for closure in lone[:_MOST]
        ]
        lines += _and_more(len(lone))
    return "\n".join(lines)


def _and_more(n: int) -> list[str]:
    return [f"  … and {n - _MOST} more"] if n > _MOST else []

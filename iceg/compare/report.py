"""What a comparison of two runs says in the terminal."""

import math

from iceg.compare.comparison import BEYOND, Comparison

_MOST = 10


def format_comparison(comparison: Comparison, names: tuple[str, str]) -> str:
    """Lines for a terminal: figures, the worst stretches, the first closures that only one run has.

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
    if comparison.stretches:
        lines.append(f"Where they differ by more than {BEYOND:.2f} σ:")
        lines.append("        scans          distance [m]  turn [°]      σ  at scan")
        for stretch in comparison.stretches[:_MOST]:
            scans = f"{stretch.first_scan}-{stretch.last_scan}"
            lines.append(
                f"  {scans:>15}  {stretch.distance:16.4f}  {math.degrees(stretch.turn):8.2f}  {stretch.sigmas:5.1f}"
                f"  {stretch.worst_scan:7d}"
            )
        lines += _and_more(len(comparison.stretches))
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

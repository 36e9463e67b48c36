"""What a run has learned of the laser, the odometry and itself, in words."""

import math
from collections.abc import Iterator, Mapping
from typing import Any


def learned_payload(summary: Mapping[str, Any], *, has_odometry: bool) -> list[dict[str, str]]:
    """Name and value of each, for the page.

    Args:
        summary: of the run, under the names of `summary.json`.
        has_odometry: whether the log has any.
    """
    pairs = [*_laser(summary["laser"]), *_sweep(summary["sweep"])]
    if has_odometry:
        pairs += _odometry(summary["odometry"])
    if "gyro" in summary:
        pairs += _gyro(summary["gyro"])
    pairs.append(("Variances of matches", f"× {summary['match_covariance_scale']:.2f}, as halves of scans agree"))
    pairs += [(f"Chosen: {subject}", str(choice)) for subject, choice in summary["chosen"].items()]
    return [{"name": name, "value": value} for name, value in pairs]


def _laser(laser: Mapping[str, float] | None) -> Iterator[tuple[str, str]]:
    if laser is None:
        yield "Laser noise", "unknown, too few beams meet walls"
        return
    noise, slope = 1000 * laser["noise_m"], 1000 * laser["noise_per_metre"]
    yield "Laser noise", f"{noise:.1f} mm{f' and {slope:.1f} mm per metre' if slope >= 0.05 else ''}"
    yield "Typical range", f"{laser['typical_range_m']:.2f} m"
    yield "Beams without a return", f"{100 * laser['no_return_share']:.1f} %"
    yield "Stray returns", f"{100 * laser['outlier_share']:.1f} %"


def _sweep(sweep: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if sweep.get("duration_s") is None:
        return
    applied = "beams moved accordingly" if sweep.get("applied") else "too little to move beams for"
    yield "Sweep of the laser", f"{1000 * sweep['duration_s']:.0f} ms, from the {sweep['source']}; {applied}"


def _odometry(odometry: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "Odometry, distances", f"{_percent(odometry['translation_scale'])}"
    yield "Odometry, turns", f"{_percent(odometry['heading_scale'])}"
    yield "Odometry, drift to the side", f"{math.degrees(odometry['heading_per_metre_rad']):+.2f} ° per metre"
    yield (
        "Odometry behind the scans",
        f"{odometry['translation_shift_scans']:+.2f} scans, turns {odometry['heading_shift_scans']:+.2f}",
    )
    x, y, heading = odometry["T_odometry_laser"]
    yield "Laser, from where it is taken to sit", f"{_signed(100 * x, 1)} cm ahead, {_signed(100 * y, 1)} cm left"
    yield "… turned to the left by", f"{_signed(math.degrees(heading), 2)} °"


def _gyro(gyro: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What the matches say of the gyro, see `GyroFinding.record`."""
    yield "Gyro", "used for the heading" if gyro["used"] else f"not used: {gyro['reason']}"
    if "rad_per_unit" not in gyro:
        return
    scales = ", ".join(_signed(scale, 3) for scale in gyro["rad_per_unit"])
    yield "Gyro, turn per unit about x, y, z", f"{scales} rad"
    has_times = "delay_s" in gyro
    bias = math.degrees(gyro["bias_rad_per_s" if has_times else "bias_rad_per_scan"])
    yield "Gyro, bias", f"{_signed(bias, 3)} ° per {'second' if has_times else 'scan'}"
    delay = f"{_signed(1000 * gyro['delay_s'], 0)} ms" if has_times else f"{_signed(gyro['delay_scans'], 2)} scans"
    yield "Gyro behind the scans", delay
    left, without = (math.degrees(gyro[name]) for name in ("turn_std_rad", "turn_std_of_constant_velocity_rad"))
    yield "Gyro, scatter of a turn", f"{left:.2f} °, {without:.2f} ° without it"


def _signed(value: float, decimals: int) -> str:
    """With its sign, but none for what rounds to zero."""
    rounded = round(value, decimals)
    return f"{rounded:+.{decimals}f}" if rounded else f"{0.0:.{decimals}f}"


def _percent(scale: float) -> str:
    return f"{_signed(100 * scale, 2)} % to be added"

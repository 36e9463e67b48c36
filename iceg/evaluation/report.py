"""The figures of an evaluation under their published names, as a table for people or as JSON."""

import json
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from iceg.evaluation.consistency import DEGREES_OF_FREEDOM, Consistency
from iceg.evaluation.relations import Relations, error_statistics, relation_errors
from iceg.evaluation.relative_error import RelativeError, path_lengths, relative_error
from iceg.evaluation.trajectory import TrajectoryErrors

_DECIMALS = 5
_SMALL = 1e-4  # figures below this get three digits, whatever their size

_JSON_ONLY = {"nees_low", "nees_high"}
"""Bounds for independent errors, which those along one path are not: the verdict in words says what can be said."""

_LABELS = {
    "n": "compared",
    "dropped": "left out, not tied to one scan",
    "trans_mean": "translation, mean [m]",
    "trans_std": "translation, std [m]",
    "trans_median": "translation, median [m]",
    "trans_p95": "translation, 95th percentile [m]",
    "trans_max": "translation, max [m]",
    "rot_mean_deg": "rotation, mean [°]",
    "rot_std_deg": "rotation, std [°]",
    "rot_median_deg": "rotation, median [°]",
    "rot_p95_deg": "rotation, 95th percentile [°]",
    "rot_max_deg": "rotation, max [°]",
    "cartographer_trans_mean": "translation in Cartographer's form, mean [m]",
    "cartographer_trans_std": "translation in Cartographer's form, std [m]",
    "cartographer_trans_median": "translation in Cartographer's form, median [m]",
    "cartographer_trans_p95": "translation in Cartographer's form, 95th percentile [m]",
    "cartographer_trans_max": "translation in Cartographer's form, max [m]",
    "ate_rmse": "absolute trajectory error, rmse [m]",
    "ate_max": "absolute trajectory error, max [m]",
    "x_mean_abs": "x, mean absolute error [m]",
    "y_mean_abs": "y, mean absolute error [m]",
    "x_var": "x, variance of the error [m²]",
    "y_var": "y, variance of the error [m²]",
    "rot_rmse_deg": "heading, rmse [°]",
    "matched": "share of the poses paired",
    "nees_n": "key poses with a covariance",
    "nees_mean": f"NEES, mean ({DEGREES_OF_FREEDOM} is right)",
    "nees_median": "NEES, median (2.37 is right)",
    "nees_share_95": "share inside the 95 % region (0.95 is right)",
}
_FACTOR_LABELS = {
    "n": "judged",
    "nees_mean": f"NEES, mean ({DEGREES_OF_FREEDOM} is right)",
    "nees_low": "NEES, 95 % interval of the mean if independent, low",
    "nees_high": "NEES, 95 % interval of the mean if independent, high",
    "nees_median": "NEES, median (2.37 is right)",
    "share_95": "share inside the 95 % region (0.95 is right)",
    "unchecked": "that nothing else checks",
    "faded": "out of force",
}
RELATIVE_METRES = (1.0, 10.0)
RELATIVE_SECONDS = (1.0, 10.0)
"""What relative errors are told over."""
for _separation in (*(f"{metres:g}m" for metres in RELATIVE_METRES), *(f"{s:g}s" for s in RELATIVE_SECONDS)):
    _shown = f"over {_separation[:-1]} {_separation[-1]}"
    _LABELS |= {
        f"rpe_{_separation}_trans_rmse": f"relative error {_shown}, rmse [m]",
        f"rpe_{_separation}_rot_rmse_deg": f"relative error {_shown}, heading, rmse [°]",
    }
for _kind, _name in (("odometry", "odometry"), ("ice", "ICE"), ("closure", "closure")):
    _LABELS |= {f"{_kind}_{figure}": f"{_name} factors, {label}" for figure, label in _FACTOR_LABELS.items()}


def relations_report(T_map_robot: NDArray[np.float64], relations: Relations) -> dict[str, float]:
    """Both forms of the benchmark error; the rotation is the same in both.

    Args:
        T_map_robot: (n_scans, 3), one pose per scan.
        relations: what is known.

    Raises:
        EvaluationError: the relations reach beyond the trajectory.
    """
    metric = relation_errors(T_map_robot, relations)
    cartographer = relation_errors(T_map_robot, relations, form="cartographer")
    trans, rot = error_statistics(metric.translation), error_statistics(np.degrees(metric.rotation))
    other = error_statistics(cartographer.translation)
    return {
        "n": len(relations),
        "trans_mean": trans.mean,
        "trans_std": trans.std,
        "trans_median": trans.median,
        "trans_p95": trans.p95,
        "trans_max": trans.max,
        "rot_mean_deg": rot.mean,
        "rot_std_deg": rot.std,
        "rot_median_deg": rot.median,
        "rot_p95_deg": rot.p95,
        "rot_max_deg": rot.max,
        "cartographer_trans_mean": other.mean,
        "cartographer_trans_std": other.std,
        "cartographer_trans_median": other.median,
        "cartographer_trans_p95": other.p95,
        "cartographer_trans_max": other.max,
        "dropped": relations.dropped,
    }


def trajectory_report(errors: TrajectoryErrors) -> dict[str, float]:
    """Absolute trajectory errors, angles in degrees."""
    return {
        "n": errors.n,
        "ate_rmse": errors.ate_rmse,
        "ate_max": errors.ate_max,
        "x_mean_abs": errors.x_mean_abs,
        "y_mean_abs": errors.y_mean_abs,
        "x_var": errors.x_var,
        "y_var": errors.y_var,
        "rot_rmse_deg": math.degrees(errors.rot_rmse),
    }


def relative_report(
    T_map_robot: NDArray[np.float64], T_world_robot: NDArray[np.float64], stamps: NDArray[np.float64]
) -> dict[str, float]:
    """Relative pose errors over metres of the true path and over seconds, angles in degrees.

    Args:
        T_map_robot: (n, 3) the estimate.
        T_world_robot: (n, 3) the truth of the same moments.
        stamps: (n,) [s], increasing where the poses follow each other.

    Returns:
        Nothing of separations that no two of the poses have.
    """
    order = np.argsort(stamps, kind="stable")
    estimated, true, seconds = T_map_robot[order], T_world_robot[order], stamps[order]
    metres = path_lengths(true)
    report: dict[str, float] = {}
    for along, unit, separations in ((metres, "m", RELATIVE_METRES), (seconds, "s", RELATIVE_SECONDS)):
        for separation in separations:
            error = relative_error(estimated, true, along, separation)
            report |= _relative_figures(f"rpe_{separation:g}{unit}", error) if error.n else {}
    return report


def _relative_figures(name: str, error: RelativeError) -> dict[str, float]:
    return {
        f"{name}_trans_rmse": error.translation_rmse,
        f"{name}_rot_rmse_deg": math.degrees(error.rotation_rmse),
    }


def consistency_report(summary: Consistency) -> dict[str, float]:
    """Honesty of the covariances."""
    return {
        "nees_n": summary.n,
        "nees_mean": summary.mean,
        "nees_median": summary.median,
        "nees_share_95": summary.share_within_95,
        "nees_low": summary.mean_low,
        "nees_high": summary.mean_high,
    }


def format_json(report: Mapping[str, float | str]) -> str:
    """One JSON object, five decimals or three digits; what is not defined (the deviation of one value) is null."""
    return json.dumps({name: _plain(value) for name, value in report.items()}, allow_nan=False, ensure_ascii=False)


def format_table(report: Mapping[str, float], title: str) -> str:
    """Lines of label and figure under a title; figures that only their JSON needs are left out."""
    labels = {name: _LABELS.get(name, name) for name in report if name not in _JSON_ONLY}
    width = max(len(label) for label in labels.values())
    lines = [f"  {label:<{width}}  {_format_figure(report[name]):>12}" for name, label in labels.items()]
    return "\n".join([title, *lines])


def _plain(value: float | str) -> float | str | None:
    if isinstance(value, str):
        return value
    return _rounded(value) if math.isfinite(value) else None


def _format_figure(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    if not math.isfinite(value):
        return "-"
    return f"{value:.2e}" if 0.0 < abs(value) < _SMALL else f"{value:.{_DECIMALS}f}"


def _rounded(value: float) -> float:
    return float(f"{value:.2e}") if 0.0 < abs(value) < _SMALL else round(value, _DECIMALS)

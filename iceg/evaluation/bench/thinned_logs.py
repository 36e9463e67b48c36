"""What ICE's features buy where odometry is poor: every fifth scan of a log, with and without them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frontends.logs import read_log
from frontends.scan import Log
from iceg.config import Config
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.relations import Relations, error_statistics, read_relations_csv, relation_errors
from iceg.ice.config import IceConfig
from iceg.pipeline import run
from iceg.slam.config import FinishConfig, LoopClosureConfig

THINNING = 5


def thinned(log: Log, phase: int, step: int = THINNING) -> Log:
    """Every `step`-th scan of a log, starting with scan `phase`: the robot moves that much more between scans."""
    return log.select(slice(phase, None, step))


def thinned_relations(relations: Relations, phase: int, step: int = THINNING) -> Relations:
    """The relations both of whose scans are left, by their new indices."""
    left = (relations.scans_i % step == phase) & (relations.scans_j % step == phase)
    return replace(
        relations,
        scans_i=relations.scans_i[left] // step,
        scans_j=relations.scans_j[left] // step,
        T_i_j=relations.T_i_j[left],
        dropped=relations.dropped + int((~left).sum()),
    )


def features_on_thinned(log: BenchLog, use_features: bool) -> Row:
    """Every phase of a thinned log, ICE's features on or off, loops left open.

    Args:
        log: a log with relations.
        use_features: off leaves the odometry as the only start of a match.

    Returns:
        A row: errors over the relations of all phases, and how many scans odometry had to carry.

    Raises:
        EvaluationError: there are no relations.
    """
    if log.relations is None:
        raise EvaluationError(f"{log.name}: has no relations to judge by")
    recorded, known = read_log(log.path), read_relations_csv(log.relations)
    config = Config(
        ice=IceConfig(use_features=use_features),
        loops=LoopClosureConfig(enabled=False),
        finish=FinishConfig(enabled=False),
    )
    translation: list[NDArray[np.float64]] = []
    rotation: list[NDArray[np.float64]] = []
    failures = 0
    for phase in range(THINNING):
        result = run(thinned(recorded, phase), config)
        errors = relation_errors(result.trajectory, thinned_relations(known, phase))
        translation.append(errors.translation)
        rotation.append(errors.rotation)
        failures += result.summary["scans_carried_by_odometry"]
    trans, rot = error_statistics(np.concatenate(translation)), error_statistics(np.degrees(np.concatenate(rotation)))
    return {
        "log": log.name,
        "scans": f"every {THINNING}th",
        "features": "on" if use_features else "off",
        "relations": sum(map(len, translation)),
        "mean [m]": trans.mean,
        "median [m]": trans.median,
        "95th percentile [m]": trans.p95,
        "rotation mean [°]": rot.mean,
        "carried by odometry": failures,
    }

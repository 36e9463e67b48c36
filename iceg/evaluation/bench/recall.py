"""How often ICE finds a scan again in a local map of another pass, on the logs that have relations."""

from math import degrees, radians

from frontends.logs import read_log
from iceg.config import Config
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.errors import EvaluationError
from iceg.evaluation.recall import recall_benchmark
from iceg.evaluation.relations import read_relations_csv
from iceg.ice.matcher import IceMatcher
from iceg.slam.tracking.log_tracking import track_log

WINDOWS = ((0.5, radians(20.0)), (1.0, radians(45.0)), (3.0, radians(180.0)))


def recall_rows(log: BenchLog, seed: int = 0) -> list[Row]:
    """One row for each size of the initial error.

    Args:
        log: a log with relations.
        seed: of the initial errors.

    Raises:
        EvaluationError: there are no relations.
    """
    if log.relations is None:
        raise EvaluationError(f"{log.name}: has no relations to judge by")
    config = Config()
    recorded, relations = read_log(log.path), read_relations_csv(log.relations)
    matcher = IceMatcher(config.ice)
    track = track_log(recorded, matcher, config.odometry, config.front_end)
    rows: list[Row] = []
    for metres, angle in WINDOWS:
        found = recall_benchmark(recorded, relations, track, metres, angle, seed, matcher=matcher)
        rows.append(
            {
                "log": log.name,
                "initial error": f"±{metres:g} m, ±{degrees(angle):.0f}°",
                "pairs": found.n,
                "recall [%]": 100.0 * found.recall,
                "success [%]": 100.0 * found.success,
                "hypotheses": found.hypotheses,
                "match, median [ms]": found.median_ms,
                "error, median [m]": found.median_error,
            }
        )
    return rows

"""Whether the factors ICE gives the graph are honest, on simulated truth."""

import numpy as np

from frontends.simulator.simulation import simulate
from graph.dense import eigvalsh
from graph.se2 import between
from iceg.config import Config
from iceg.evaluation.bench.tables import Row
from iceg.evaluation.consistency import consistency, nees, relative_pose_errors
from iceg.pipeline import run
from iceg.slam.config import FinishConfig, LoopClosureConfig

SCENES = ("room", "long_corridor")
_UNOBSERVED = 0.5
"""A principal standard deviation beyond this is that of a direction left to odometry [m, rad]."""
_CONFIG = Config(loops=LoopClosureConfig(enabled=False), finish=FinishConfig(enabled=False))


def factor_consistency(scene: str, seeds: range) -> Row:
    """NEES of the ICE factors between successive key poses.

    Args:
        scene: a scene of the simulator.
        seeds: one simulation each.

    Returns:
        A row: how many factors; the mean NEES, 3 is right where every direction is observed; the same for each
        direction that is, 1 is right (of a weak one a match says nothing, and errs little, for odometry holds it); the
        share within the 95 % region; how many of the matches reported a weak direction.
    """
    values, weak, matches, observed = [], 0, 0, 0
    for seed in seeds:
        simulation = simulate(scene, seed)
        result = run(simulation.log, _CONFIG)
        factors = [factor for factor in result.graph.factors if factor.kind == "ice"]
        i, j = (np.array([getattr(factor, end) for factor in factors]) for end in "ij")
        truth = simulation.truth[result.key_scans]
        errors = relative_pose_errors(np.array([factor.T_i_j for factor in factors]), between(truth[i], truth[j]))
        covariances = np.array([factor.covariance for factor in factors])
        values.append(nees(errors, covariances))
        observed += int((eigvalsh(covariances) < _UNOBSERVED**2).sum())
        weak += result.summary["weak_matches"]
        matches += len(factors)
    found = consistency(np.concatenate(values))
    return {
        "scene": scene,
        "runs": len(seeds),
        "ICE factors": matches,
        "NEES mean": found.mean,
        "NEES per observed direction": float(np.concatenate(values).sum()) / max(1, observed),
        "NEES median": found.median,
        "in 95 % region": found.share_within_95,
        "weak matches [%]": 100.0 * weak / max(1, matches),
    }

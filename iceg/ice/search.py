"""Searches over (dx, dy, dθ) that need no pairs of features: exhaustive, genetic as in the paper, and evolutionary."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graph.se2 import wrap_angle
from iceg.ice.config import HypothesisConfig
from iceg.ice.hypotheses import SearchWindow

_TURN_PER_SIGMA = 0.5
"""Spacing of headings in radians per metre of the likelihood field's width: the same arc two metres away."""

_MUTATION = 0.3
"""How often a coordinate of a child mutates."""
_ELITE = 3
"""Poses of a generation that live on."""


def grid_hypotheses(window: SearchWindow, config: HypothesisConfig) -> NDArray[np.float64]:
    """All poses of a regular grid over the window, as fine as the likelihood field resolves.

    Args:
        window: the feasible area.
        config: width of the likelihood field.

    Returns:
        (n, 3) hypotheses for T_ref_cur; the guess is the first.
    """
    along = _symmetric(window.translation, config.field_sigma)
    turns = _symmetric(window.rotation, _TURN_PER_SIGMA * config.field_sigma)
    offsets = np.stack(np.meshgrid(along, along, turns, indexing="ij"), axis=-1).reshape(-1, 3)
    return _around(window, np.concatenate([np.zeros((1, 3)), offsets]))


def breed_hypotheses(
    window: SearchWindow,
    fitness: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    config: HypothesisConfig,
) -> NDArray[np.float64]:
    """A genetic algorithm on poses in the window, as the paper has in mind (section III.C.3).

    Of each generation the fitter of two drawn poses become parents, a child lies in the box around its two parents or
    a little outside (BLX-0.5), some of its coordinates mutate by a hundredth to a tenth of the window, and children
    take the place of all but the fittest parents.

    Args:
        window: the feasible area.
        fitness: of (n, 3) poses, (n,), larger is better.
        config: seed and effort, the same number of poses as `evolve_hypotheses` weighs.

    Returns:
        (n, 3) the guess and the last population.
    """
    rng = np.random.default_rng(config.seed)
    widths = np.array([window.translation, window.translation, window.rotation])
    n = 3 * config.population
    offsets = rng.uniform(-1.0, 1.0, (n, 3)) * widths
    fit = fitness(_around(window, offsets))
    for _ in range(config.generations):
        rivals = rng.integers(0, n, (2, n, 2))
        winners = np.where(fit[rivals[..., 0]] >= fit[rivals[..., 1]], rivals[..., 0], rivals[..., 1])
        mother, father = offsets[winners[0]], offsets[winners[1]]
        children = mother + rng.uniform(-0.5, 1.5, (n, 3)) * (father - mother)
        step = widths * 10.0 ** rng.uniform(-2.0, -1.0, (n, 1))
        children += np.where(rng.random((n, 3)) < _MUTATION, rng.normal(size=(n, 3)) * step, 0.0)
        children = np.clip(children, -widths, widths)
        fittest = np.argsort(-fit, kind="stable")[:_ELITE]
        children[:_ELITE] = offsets[fittest]
        offsets, fit = children, fitness(_around(window, children))
    return _around(window, np.concatenate([np.zeros((1, 3)), offsets]))


def evolve_hypotheses(
    window: SearchWindow,
    fitness: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    config: HypothesisConfig,
) -> NDArray[np.float64]:
    """Differential evolution of a population of poses in the window.

    Args:
        window: the feasible area.
        fitness: of (n, 3) poses, (n,), larger is better.
        config: seed and effort.

    Returns:
        (n, 3) the guess and the last population.
    """
    from scipy.optimize import Bounds, differential_evolution

    widths = np.array([window.translation, window.translation, window.rotation])

    def objective(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        return -fitness(_around(window, offsets.T))

    result = differential_evolution(
        objective,  # type: ignore[arg-type]
        Bounds(-widths, widths),
        popsize=config.population,
        maxiter=config.generations,
        rng=config.seed,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return _around(window, np.concatenate([np.zeros((1, 3)), result.population]))


def _symmetric(half_width: float, spacing: float) -> NDArray[np.float64]:
    """Evenly spaced values from -half_width to half_width with 0 among them, no farther apart than the spacing."""
    n = int(np.ceil(half_width / spacing))
    return np.linspace(-half_width, half_width, 2 * n + 1)


def _around(window: SearchWindow, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    poses = window.T_ref_guess + offsets
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses

"""Kernels in the order in which they are compiled: what a run calls first comes first."""

from collections.abc import Sequence

from iceg.kernels.signatures import STAGES, Kernel

READING = STAGES[0]
ORDER = (*STAGES[1:], READING)
"""Stages of a run; what reads logs comes last: the process that reads one meanwhile has compiled what it needs."""
_ALIKE = (
    (
        "iceg.ice._point_kernels",
        "iceg.ice._refinement_kernels",
        "iceg.ice._score_kernels",
        "iceg.ice._tracking_kernels",
    ),
    ("iceg.ice._agreement_kernels", "iceg.ice._feature_kernels"),
    ("graph._sparse_kernels",),
    ("iceg.maps._grid_kernels",),
    ("iceg.maps._landmark_kernels",),
)
"""Modules that one process compiles in a row, as they share what they call. Those that take long are begun first in
their stage, so that all processes end together. Every other module is a group of its own."""


def groups_of(kernels: Sequence[Kernel]) -> list[list[int]]:
    """Which kernels one process compiles in a row.

    Args:
        kernels: those of one module are neighbours.

    Returns:
        Their places in the list, group by group, in order.
    """
    together = {module: modules for modules in _ALIKE for module in modules}
    groups: dict[tuple[str, ...], list[int]] = {modules: [] for modules in _ALIKE}
    for place, kernel in enumerate(kernels):
        groups.setdefault(together.get(kernel.module, (kernel.module,)), []).append(place)

    def when(place: int) -> int:
        return ORDER.index(kernels[place].stage)

    filled = [sorted(group, key=when) for group in groups.values() if group]
    return sorted(filled, key=lambda group: when(group[0]))

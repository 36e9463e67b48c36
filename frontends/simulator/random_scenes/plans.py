"""The kinds of places, by name."""

from collections.abc import Callable
from types import MappingProxyType
from typing import Literal

from frontends.simulator.random_scenes import halls, outdoors, passages, rooms
from frontends.simulator.random_scenes.site import Site

Kind = Literal[
    "office",
    "school",
    "house",
    "warehouse",
    "market",
    "parking",
    "campus",
    "maze",
    "round",
    "factory",
    "corridors",
    "wood",
]

PLANS: MappingProxyType[Kind, Callable[[Site], None]] = MappingProxyType(
    {
        "office": rooms.office,
        "school": rooms.school,
        "house": rooms.house,
        "warehouse": halls.warehouse,
        "market": halls.market,
        "parking": halls.parking,
        "campus": outdoors.campus,
        "maze": passages.maze,
        "round": passages.round_building,
        "factory": halls.factory,
        "corridors": passages.corridors,
        "wood": outdoors.wood,
    }
)
"""What builds each kind of place on an empty site."""

LARGE: frozenset[Kind] = frozenset({"campus", "parking", "warehouse", "market", "factory"})
"""Driven through faster and longer."""

WIDE: frozenset[Kind] = frozenset({"campus", "parking", "wood"})
"""Where a laser of short reach sees nothing for long."""

"""Large halls: warehouse, market, car park and factory."""

import math

import numpy as np

from frontends.simulator.random_scenes.site import Site

_RACK_BAY = 2.7  # m: from one post of a rack to the next


def warehouse(site: Site) -> None:
    """Rows of racks, closed ones or posts with pallets between them that are fetched in time."""
    rng = site.rng
    width, depth = _hall(site, (22.0, 45.0), (15.0, 30.0))
    _bays(site, width, depth)
    aisle, rack = rng.uniform(2.2, 3.4), rng.uniform(1.0, 2.4)
    y = 2.5 + aisle / 2
    while y + rack < depth - 2.5:
        has_gap = rng.random() < 0.6
        for x0, x1 in [(3.0, width / 2 - 1.5), (width / 2 + 1.5, width - 3.0)] if has_gap else [(3.0, width - 3.0)]:
            if rng.random() < 0.5:
                site.box((x0 + x1) / 2, y + rack / 2, x1 - x0, rack)
            else:
                _open_rack(site, x0, x1, y, rack)
        y += aisle + rack


def market(site: Site) -> None:
    """Shelves side by side across a hall, and stands along its front."""
    rng = site.rng
    width, depth = _hall(site, (25.0, 40.0), (18.0, 30.0))
    x = 4.0
    while x < width - 4.0:
        site.box(x, 0.32 * depth, 1.0, 0.36 * depth)
        site.box(x, 0.76 * depth, 1.0, 0.3 * depth)
        x += rng.uniform(2.4, 3.2)
    for _ in range(10):
        site.box(rng.uniform(2.0, width - 2.0), rng.uniform(1.0, 2.0), rng.uniform(0.5, 1.2), 0.8)


def parking(site: Site) -> None:
    """A grid of pillars, and cars along two walls of which some come and go."""
    rng = site.rng
    width, depth = _hall(site, (30.0, 60.0), (20.0, 35.0))
    rows = np.arange(5.0, depth - 3.0, rng.uniform(5.0, 8.0)).tolist()
    for x in np.arange(5.0, width - 3.0, rng.uniform(5.0, 8.0)).tolist():
        for y in rows:
            site.box(x, y, 0.5, 0.5)
    for x in np.arange(2.0, width - 2.0, 2.6).tolist():
        for y in (2.6, depth - 2.6):
            if rng.random() < 0.5:
                comes = rng.uniform(20.0, 150.0) if rng.random() < 0.2 else -math.inf
                leaves = rng.uniform(150.0, 300.0) if rng.random() < 0.2 else math.inf
                site.box(x, y, 1.8, 4.3, rng.normal(0.0, 0.03), start=comes, end=leaves)


def factory(site: Site) -> None:
    """Machines and crates anywhere in a hall; a few of them are taken away."""
    rng = site.rng
    width, depth = _hall(site, (20.0, 40.0), (15.0, 30.0))
    _bays(site, width, depth)
    for _ in range(int(width * depth / 28.0)):
        x, y = rng.uniform(2.5, width - 2.5), rng.uniform(2.5, depth - 2.5)
        size = rng.uniform(0.6, 4.0), rng.uniform(0.6, 3.0)
        turn = rng.uniform(-1.0, 1.0) if rng.random() < 0.25 else 0.0
        site.box(x, y, *size, turn, end=math.inf if rng.random() < 0.93 else rng.uniform(60.0, 200.0))


def _hall(site: Site, widths: tuple[float, float], depths: tuple[float, float]) -> tuple[float, float]:
    """Four walls with a corner at the origin; their width and depth [m], drawn between bounds."""
    width, depth = site.rng.uniform(*widths), site.rng.uniform(*depths)
    site.room(0.0, 0.0, width, depth)
    return width, depth


def _bays(site: Site, width: float, depth: float) -> None:
    """Pillars in both long walls."""
    for x in np.arange(3.0, width - 2.0, site.rng.uniform(4.0, 7.0)).tolist():
        site.box(x, 0.3, 0.4, 0.4)
        site.box(x, depth - 0.3, 0.4, 0.4)


def _open_rack(site: Site, x0: float, x1: float, y: float, depth: float) -> None:
    """Posts, and between them pallets."""
    rng = site.rng
    posts = np.arange(x0, x1, _RACK_BAY).tolist()
    for x in posts:
        site.box(x, y, 0.1, 0.1)
        site.box(x, y + depth, 0.1, 0.1)
    for x in posts[:-1]:
        if rng.random() < 0.6:
            leaves = math.inf if rng.random() < 0.7 else rng.uniform(30.0, 200.0)
            site.box(x + _RACK_BAY / 2, y + depth / 2, rng.uniform(1.0, 2.3), 0.8 * depth, end=leaves)

"""Open ground: a campus of buildings and trees, and a wood."""

from frontends.simulator.random_scenes.site import Site


def campus(site: Site) -> None:
    """Buildings on a grid, some with a wing and some turned, trees between them and sometimes a wall around."""
    rng = site.rng
    size, n = rng.uniform(40.0, 70.0), int(rng.integers(2, 4))
    plot = size / n
    for i in range(n):
        for j in range(n):
            if rng.random() < 0.8:
                _building(site, (i + 0.5) * plot, (j + 0.5) * plot, plot)
    for _ in range(int(rng.integers(10, 40))):
        x, y = rng.uniform(-3.0, size + 3.0), rng.uniform(-3.0, size + 3.0)
        site.column(x, y, rng.uniform(0.1, 0.35), pieces=6)
    if rng.random() < 0.6:
        site.room(-6.0, -6.0, size + 8.0, size + 8.0, thickness=0.0)


def wood(site: Site) -> None:
    """Nothing but trunks."""
    rng = site.rng
    size = rng.uniform(25.0, 40.0)
    for _ in range(int(size**2 * rng.uniform(0.04, 0.09))):
        x, y = rng.uniform(0.0, size), rng.uniform(0.0, size)
        site.column(x, y, rng.uniform(0.06, 0.3), pieces=7)


def _building(site: Site, x: float, y: float, plot: float) -> None:
    rng = site.rng
    width, depth = plot * rng.uniform(0.3, 0.65), plot * rng.uniform(0.3, 0.65)
    turn = rng.uniform(-0.5, 0.5) if rng.random() < 1 / 3 else 0.0
    site.box(x, y, width, depth, turn)
    if rng.random() < 0.6:
        site.box(x + 0.4 * width, y + 0.3 * depth, 0.6 * width, 0.7 * depth, turn)

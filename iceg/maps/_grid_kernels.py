"""Compiled loops of the occupancy grid: a scan's footprint in polar form, its free area and its hit cells.

The free area of a scan is a star-shaped polygon around the laser. It is filled row by row between the polygon's edges
(a cell belongs to it when its centre does), so each cell is met once a scan whatever number of beams cross it, and the
rows are contiguous in memory. Surfaces are cast cell by cell.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.compiled import ZERO, compiled, compiled_aside, compiled_for_both

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]


class Cone(NamedTuple):
    """What a beam covers.

    Attributes:
        touching: whether the borders of neighbouring beams coincide or overlap, so that chords mean something.
        max_range: beams are cut here [m].
        no_return_range: how far a beam without return is taken as free [m].
        cot_min_incidence: cotangent of the flattest angle at which a surface is still believed to be one.
        free_margin: how far before the surface a beam stops claiming free space [m].
    """

    touching: bool
    max_range: float
    no_return_range: float
    cot_min_incidence: float
    free_margin: float


class Evidence(NamedTuple):
    """What a beam says [log-odds].

    Attributes:
        hit: evidence of a return, shared by the cells of its footprint, > 0.
        miss: evidence of a free cell, < 0.
        limit: the log-odds stay in [-limit, limit].
    """

    hit: float
    miss: float
    limit: float


class Footprints(NamedTuple):
    """Where the n beams of one scan meet the surface.

    Attributes:
        surface: (n, 3) range at the right border, the axis and the left border of each beam [m].
        hits: (n,) whether the beam returned within the maximum range.
        xs: (n, 3) column coordinates of the same points [cells]; of beams that returned.
        ys: (n, 3) row coordinates.
    """

    surface: F64
    hits: Bool
    xs: F64
    ys: F64


@compiled
def _beam_outline(
    ranges: F32,
    bearings: F64,
    chords: F64,
    cone: Cone,
    surface: F64,
    hits: Bool,
) -> None:
    """Where each beam's footprint meets the surface: on its right border, its axis and its left border.

    Neighbouring returns that may lie on one surface are joined by a chord; across a jump in depth each beam keeps its
    own range up to its border.

    Args:
        ranges: (n,) [m], NaN without return.
        bearings: (n,) [rad], increasing.
        chords: (n - 1, 5) of `_chord_tables`.
        cone: what a beam covers.
        surface: (n, 3) output, range at the right border, the axis and the left border [m].
        hits: (n,) output, whether the beam returned within max_range.
    """
    n = len(ranges)
    for i in range(n):
        r = ranges[i]
        if np.isnan(r):
            hits[i] = False
            cut = cone.no_return_range
        else:
            hits[i] = r <= cone.max_range
            cut = min(float(r), cone.max_range)
        surface[i, 0] = cut
        surface[i, 1] = cut
        surface[i, 2] = cut
    if not cone.touching:
        return
    for i in range(n - 1):
        j = i + 1
        if not (hits[i] and hits[j]):
            continue
        r_i, r_j = surface[i, 1], surface[j, 1]
        step = bearings[j] - bearings[i]
        if abs(r_i - r_j) > min(r_i, r_j) * step * cone.cot_min_incidence:
            continue
        product = r_i * r_j * chords[i, 0]
        surface[i, 2] = product / (chords[i, 1] * r_j + chords[i, 2] * r_i)
        surface[j, 0] = product / (chords[i, 3] * r_j + chords[i, 4] * r_i)


@compiled
def _chord_tables(bearings: F64, half_widths: F64) -> F64:
    """What the chord between the returns of beams i and i + 1 needs at the borders of the two beams.

    A straight line in polar coordinates is r(θ) = sin(β - α) / (sin(β - θ) / r_α + sin(θ - α) / r_β).

    Returns:
        (n - 1, 5): sin(β - α), then sin(β - θ) and sin(θ - α) at the left border of i and at the right border of i + 1.
    """
    tables = np.empty((max(len(bearings) - 1, 0), 5))
    for i in range(len(tables)):
        step = bearings[i + 1] - bearings[i]
        tables[i, 0] = np.sin(step)
        tables[i, 1], tables[i, 2] = np.sin(step - half_widths[i, 1]), np.sin(half_widths[i, 1])
        tables[i, 3], tables[i, 4] = np.sin(half_widths[i + 1, 0]), np.sin(step - half_widths[i + 1, 0])
    return tables


@compiled
def _cast_cells(x0: float, y0: float, x1: float, y1: float, rows: I64, cols: I64, at: int) -> int:
    """All cells a straight line passes through, in order, start and end included.

    Args:
        x0: start column coordinate [cells]; cell c spans [c, c + 1).
        y0: start row coordinate [cells].
        x1: end column coordinate [cells].
        y1: end row coordinate [cells].
        rows: output, room for |Δrow| + |Δcol| + 1 entries from `at` on.
        cols: output, as rows.
        at: where to write the first cell.

    Returns:
        Where the next cell would go.
    """
    col, row = int(np.floor(x0)), int(np.floor(y0))
    last_col, last_row = int(np.floor(x1)), int(np.floor(y1))
    rows[at], cols[at] = row, col
    borders = abs(last_col - col) + abs(last_row - row)
    if borders <= 1:
        rows[at + borders], cols[at + borders] = last_row, last_col
        return at + borders + 1
    dx, dy = x1 - x0, y1 - y0
    step_col = 1 if dx > 0 else -1
    step_row = 1 if dy > 0 else -1
    # Position along the line, 0 at the start and 1 at the end, of the next border to cross in each direction.
    next_x = ((col + (dx > 0)) - x0) / dx if dx != 0 else np.inf
    next_y = ((row + (dy > 0)) - y0) / dy if dy != 0 else np.inf
    per_col = abs(1.0 / dx) if dx != 0 else np.inf
    per_row = abs(1.0 / dy) if dy != 0 else np.inf
    # Counting the borders instead of comparing positions ends the walk whatever the rounding.
    left_cols, left_rows = abs(last_col - col), abs(last_row - row)
    count = at + 1
    while left_cols + left_rows > 0:
        if left_rows == 0 or (left_cols > 0 and next_x < next_y):
            col += step_col
            next_x += per_col
            left_cols -= 1
        else:
            row += step_row
            next_y += per_row
            left_rows -= 1
        rows[count], cols[count] = row, col
        count += 1
    return count


@compiled
def _fill_polygon(
    log_odds: F32,
    xs: F64,
    ys: F64,
    n_vertices: int,
    miss: np.float32,
    low: np.float32,
    base: int,
    crossings: I32,
    counts: I32,
) -> None:
    """Add `miss` (negative) once to every cell whose centre lies inside a polygon, not below `low`.

    Args:
        log_odds: (n_rows, n_cols) changed in place.
        xs: (≥ n_vertices,) column coordinates of the vertices [cells]; the last one joins the first.
        ys: (≥ n_vertices,) row coordinates.
        n_vertices: how many of them count.
        miss: what to add.
        low: lower clamp.
        base: the polygon touches no row before this one, …
        crossings: (k, ≥ n_vertices) scratch, … nor any k or more rows after it.
        counts: (k,) scratch, all zero before and after.
    """
    n_rows, n_cols = log_odds.shape
    lowest, highest = n_rows, -1
    x0, y0 = xs[n_vertices - 1], ys[n_vertices - 1]
    for k in range(n_vertices):
        x1, y1 = xs[k], ys[k]
        xa, ya, xb, yb = (x0, y0, x1, y1) if y0 < y1 else (x1, y1, x0, y0)
        # Rows whose centre line lies in [ya, yb): half open, so a vertex on a centre line counts once.
        first = max(int(np.ceil(ya - 0.5)), 0)
        end = min(int(np.ceil(yb - 0.5)), n_rows)
        if first < end:
            lowest, highest = min(lowest, first), max(highest, end - 1)
            slope = (xb - xa) / (yb - ya)
            x = xa + (first + 0.5 - ya) * slope - 0.5
            for row in range(first, end):
                column = min(max(int(np.ceil(x)), 0), n_cols)
                x += slope
                # Insertion into the row's sorted crossings: rows have few.
                at = counts[row - base]
                while at > 0 and crossings[row - base, at - 1] > column:
                    crossings[row - base, at] = crossings[row - base, at - 1]
                    at -= 1
                crossings[row - base, at] = column
                counts[row - base] += 1
        x0, y0 = x1, y1
    for row in range(lowest, highest + 1):
        for pair in range(0, counts[row - base] - 1, 2):
            inside = log_odds[row, crossings[row - base, pair] : crossings[row - base, pair + 1]]
            for column in range(inside.size):
                inside[column] = max(low, inside[column] + miss)
        counts[row - base] = 0


@compiled
def _collect_hits(
    xs: F64, ys: F64, evidence: float, n_cols: int, rows: I64, cols: I64, cells: I64, shares: F32, count: int
) -> int:
    """Add the cells below one beam's footprint to the hit cells of a scan.

    The beam returned from somewhere among the cells its footprint covers, so they share its evidence.

    Args:
        xs: (3,) column coordinates of the footprint's right border, axis and left border [cells].
        ys: (3,) row coordinates.
        evidence: of the whole beam [log-odds].
        n_cols: columns of the grid.
        rows: scratch for the cells of the footprint.
        cols: scratch.
        cells: flat indices of the scan's hit cells, extended in place; a cell hit by several beams comes repeatedly.
        shares: their evidence, extended in place.
        count: how many hit cells there are so far.

    Returns:
        The new number of hit cells.
    """
    n = _cast_cells(xs[0], ys[0], xs[1], ys[1], rows, cols, ZERO)
    n = _cast_cells(xs[1], ys[1], xs[2], ys[2], rows, cols, n - 1)
    share = np.float32(evidence / n)
    for k in range(n):
        cells[count + k] = rows[k] * n_cols + cols[k]
        shares[count + k] = share
    return count + n


@compiled
def _footprint_cells(xs: F64, ys: F64) -> int:
    """Upper bound of the cells below a footprint of three points."""
    length = abs(xs[1] - xs[0]) + abs(ys[1] - ys[0]) + abs(xs[2] - xs[1]) + abs(ys[2] - ys[1])
    return int(length) + 8


@compiled
def extent(
    T_map_laser: F64, ranges: F32, bearings: F64, half_widths: F64, max_range: float, no_return_range: float
) -> tuple[float, float, float, float]:
    """A box (x_min, y_min, x_max, y_max) [m] that holds the lasers and all footprints."""
    n_beams = len(bearings)
    cos, sin, widest = np.empty(n_beams), np.empty(n_beams), 0.0
    for i in range(n_beams):
        cos[i], sin[i] = np.cos(bearings[i]), np.sin(bearings[i])
        widest = max(widest, half_widths[i, 0], half_widths[i, 1])
    x_min, y_min, x_max, y_max = np.inf, np.inf, -np.inf, -np.inf
    farthest = 0.0
    for k in range(len(T_map_laser)):
        x, y, heading = T_map_laser[k]
        c, s = np.cos(heading), np.sin(heading)
        x_min, x_max = min(x_min, x), max(x_max, x)
        y_min, y_max = min(y_min, y), max(y_max, y)
        for i in range(n_beams):
            r = no_return_range if np.isnan(ranges[k, i]) else min(np.float64(ranges[k, i]), max_range)
            px, py = x + r * (c * cos[i] - s * sin[i]), y + r * (s * cos[i] + c * sin[i])
            farthest = max(farthest, r)
            x_min, x_max = min(x_min, px), max(x_max, px)
            y_min, y_max = min(y_min, py), max(y_max, py)
    # A footprint reaches no farther from its axis than the arc to its border.
    side = farthest * widest
    return x_min - side, y_min - side, x_max + side, y_max + side


@compiled
def _border_directions(bearings: F64, half_widths: F64) -> tuple[F64, F64]:
    """Cosine and sine, (n, 3) each, of every beam's right border, axis and left border in the laser frame."""
    n = len(bearings)
    cos, sin = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        right, left = bearings[i] - half_widths[i, 0], bearings[i] + half_widths[i, 1]
        cos[i, 0], sin[i, 0] = np.cos(right), np.sin(right)
        cos[i, 1], sin[i, 1] = np.cos(bearings[i]), np.sin(bearings[i])
        cos[i, 2], sin[i, 2] = np.cos(left), np.sin(left)
    return cos, sin


@compiled_aside
def render(
    log_odds: F32,
    origin_x: float,
    origin_y: float,
    resolution: float,
    T_map_laser: F64,
    ranges: F32,
    bearings: F64,
    half_widths: F64,
    cone: Cone,
    evidence: Evidence,
) -> None:
    """Enter all scans into the grid, oldest first.

    Args:
        log_odds: (n_rows, n_cols) changed in place; row 0 is the lowest y.
        origin_x: x of the lower left corner of cell (0, 0) [m].
        origin_y: y of it [m].
        resolution: side of a cell [m].
        T_map_laser: (n_scans, 3) poses of the laser.
        ranges: (n_scans, n_beams) [m], NaN without return.
        bearings: (n_beams,) [rad], increasing.
        half_widths: (n_beams, 2) angle from each beam's axis to its right and its left border [rad].
        cone: what a beam covers.
        evidence: what a beam says.
    """
    n = len(bearings)
    cos, sin = _border_directions(bearings, half_widths)
    chords = _chord_tables(bearings, half_widths)
    prints = Footprints(np.empty((n, 3)), np.empty(n, np.bool_), np.empty((n, 3)), np.empty((n, 3)))
    xs, ys = np.empty(4 * n + 1), np.empty(4 * n + 1)
    farthest = cone.max_range / resolution + 2.0
    crossings = np.empty((int(2.0 * farthest) + 2, len(xs)), np.int32)
    counts = np.zeros(len(crossings), np.int32)
    cells, shares, before = np.empty(0, np.int64), np.empty(0, np.float32), np.empty(0, np.float32)
    low, high = np.float32(-evidence.limit), np.float32(evidence.limit)
    for k in range(len(T_map_laser)):
        x, y = (T_map_laser[k, 0] - origin_x) / resolution, (T_map_laser[k, 1] - origin_y) / resolution
        c, s = np.cos(T_map_laser[k, 2]) / resolution, np.sin(T_map_laser[k, 2]) / resolution
        _beam_outline(ranges[k], bearings, chords, cone, prints.surface, prints.hits)
        n_vertices, room = outline(x, y, c, s, cos, sin, cone, prints, xs, ys)
        if room > len(cells):
            cells, shares = np.empty(2 * room, np.int64), np.empty(2 * room, np.float32)
            before = np.empty(2 * room, np.float32)
        n_hits = _hit_cells(prints, evidence.hit, log_odds.shape[1], cells, shares)
        # Misses first, then the hit cells restart from what they were: a cell hit in a scan is not missed by it too,
        # and of several hits in one scan the strongest counts.
        flat = log_odds.reshape(-1)
        for h in range(n_hits):
            before[h] = flat[cells[h]]
        base = int(np.floor(y - farthest))
        _fill_polygon(log_odds, xs, ys, n_vertices, np.float32(evidence.miss), low, base, crossings, counts)
        for h in range(n_hits):
            flat[cells[h]] = before[h]
        for h in range(n_hits):
            flat[cells[h]] = max(flat[cells[h]], min(before[h] + shares[h], high))


@compiled_for_both
def outline(
    x: float, y: float, c: float, s: float, cos: F64, sin: F64, cone: Cone, prints: Footprints, xs: F64, ys: F64
) -> tuple[int, int]:
    """The free area of a scan as a polygon, and where its beams meet the surface.

    Args:
        x: column coordinate of the laser [cells].
        y: row coordinate of it.
        c: cosine of its heading, in cells per metre.
        s: sine of it.
        cos: (n, 3) of `_border_directions`.
        sin: (n, 3).
        cone: what a beam covers.
        prints: of `_beam_outline`; `xs` and `ys` are filled in.
        xs: (≥ 4 n + 1,) output, column coordinates of the vertices.
        ys: (≥ 4 n + 1,) output, row coordinates.

    Returns:
        The number of vertices, and of hit cells at most.
    """
    n, room = 0, 0
    for i in range(len(prints.surface)):
        if prints.surface[i, 1] <= 0.0:
            if n == 0 or xs[n - 1] != x or ys[n - 1] != y:
                xs[n], ys[n] = x, y
                n += 1
            continue
        if not cone.touching or n == 0:
            xs[n], ys[n] = x, y
            n += 1
        for e in range(3):
            dx, dy = c * cos[i, e] - s * sin[i, e], s * cos[i, e] + c * sin[i, e]
            surface = prints.surface[i, e]
            prints.xs[i, e], prints.ys[i, e] = x + surface * dx, y + surface * dy
            reach = max(surface - cone.free_margin, 0.0) if prints.hits[i] else surface
            xs[n], ys[n] = x + reach * dx, y + reach * dy
            n += 1
        if prints.hits[i]:
            room += _footprint_cells(prints.xs[i], prints.ys[i])
    xs[n], ys[n] = x, y
    return n + 1, room


@compiled
def _hit_cells(prints: Footprints, evidence: float, n_cols: int, cells: I64, shares: F32) -> int:
    """The cells below the footprints of the beams that returned, see `_collect_hits`; how many there are."""
    n_hits = ZERO
    rows, cols = np.empty(64, np.int64), np.empty(64, np.int64)
    for i in range(len(prints.hits)):
        if not prints.hits[i] or prints.surface[i, 1] <= 0.0:
            continue
        needed = _footprint_cells(prints.xs[i], prints.ys[i])
        if needed > len(rows):
            rows, cols = np.empty(2 * needed, np.int64), np.empty(2 * needed, np.int64)
        n_hits = _collect_hits(prints.xs[i], prints.ys[i], evidence, n_cols, rows, cols, cells, shares, n_hits)
    return n_hits

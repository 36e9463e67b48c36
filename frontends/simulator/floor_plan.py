"""Floor plans as walls: drawings (SVG) and images (PNG, PGM and what else matplotlib reads), black on white."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.svg import SvgError, read_svg
from frontends.simulator.world import Segments, SimulatorError
from graph.errors import reason
from graph.files import check_file
from graph.limits import LIMITS, at_most

_LEAST_SCALE, _MOST_SCALE = 1e-6, 1e6  # m
_FORMATS = ("PNG", "PPM", "JPEG", "BMP", "GIF", "TIFF", "WEBP")


def read_plan(path: Path, *, metres: float) -> Segments:
    """The walls of a floor plan, its lower left corner at the origin, x to the right, y up.

    Args:
        path: an SVG file, whose lines are walls, or an image, whose black cells are.
        metres: size of a unit of the drawing, or of a pixel [m].

    Returns:
        (n, 4) segments.

    Raises:
        SimulatorError: the file cannot be read, or there is no wall in it.
    """
    if not _LEAST_SCALE <= metres <= _MOST_SCALE:
        raise SimulatorError(
            f"{path}: found a scale of {metres} m, expected a positive one from {_LEAST_SCALE:g} to {_MOST_SCALE:g}"
        )
    if path.suffix.lower() == ".svg":
        try:
            segments = read_svg(path) * metres
        except SvgError as error:
            raise SimulatorError(f"{path}: {error}") from error
    else:
        walls = _image(path) < 0.5
        _check_edges(walls, path)
        segments = outlines(walls, metres)
    if len(segments) == 0:
        raise SimulatorError(f"{path}: found no wall, expected lines or black cells")
    if not (np.abs(segments) <= LIMITS.coordinate).all():
        raise SimulatorError(f"{path}: found a wall farther out than {LIMITS.coordinate:g} m")
    return segments


def outlines(walls: NDArray[np.bool_], metres: float) -> Segments:
    """The edges between wall and free cells, straight runs joined.

    Args:
        walls: (rows, columns) whether a cell is wall; the first row is the top of the plan. Beyond it all is free.
        metres: size of a cell [m].

    Returns:
        (n, 4) segments [m].
    """
    padded = np.pad(walls, 1)
    flat = _runs(padded[1:] != padded[:-1])
    upright = _runs((padded[:, 1:] != padded[:, :-1]).T)
    height = float(len(walls))
    along_x = np.stack([flat[:, 1], height - flat[:, 0], flat[:, 2], height - flat[:, 0]], axis=1)
    along_y = np.stack([upright[:, 0], height - upright[:, 1], upright[:, 0], height - upright[:, 2]], axis=1)
    return np.concatenate([along_x, along_y]) * metres


def _runs(edges: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n, 3): row, first column and one past the last of each run of true cells; columns without the padding."""
    padded = np.pad(edges, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    rows, starts = np.nonzero(steps == 1)
    _, ends = np.nonzero(steps == -1)
    return np.stack([rows, starts - 1, ends - 1], axis=1).astype(np.float64)


def _check_edges(walls: NDArray[np.bool_], path: Path) -> None:
    """Refuse an image of more edges than a world may have walls, such as a photograph."""
    padded = np.pad(walls, 1)
    flat, upright = padded[1:] != padded[:-1], padded[:, 1:] != padded[:, :-1]
    runs = np.count_nonzero(flat[:, 1:] & ~flat[:, :-1]) + np.count_nonzero(upright[1:] & ~upright[:-1])
    if runs > LIMITS.walls:
        raise SimulatorError(f"{path}: found {runs} edges of black cells, expected {at_most('walls')}")


def _check_size(width: int, height: int) -> None:
    if not 0 < width * height <= LIMITS.pixels:
        raise ValueError(f"found {width} x {height} pixels, expected one or more, {at_most('pixels')}")


def _image(path: Path) -> NDArray[np.float64]:
    """(rows, columns) brightness, 0 black to 1 white; what is transparent is white."""
    check_file(path, "image_bytes", SimulatorError, "an image")
    try:
        with path.open("rb") as stream:
            magic = stream.read(2)
        pixels = _pgm(path) if magic in {b"P2", b"P5"} else _decoded(path)
    except Exception as error:
        shown = reason(error)[:200] or type(error).__name__
        raise SimulatorError(f"{path}: cannot be read as an image: {shown}") from error
    if pixels.max(initial=0.0) > 1.0:
        pixels /= 255.0
    if pixels.ndim == 2:
        return pixels
    grey = pixels[..., 0] if pixels.shape[2] < 3 else pixels[..., :3].mean(axis=2)
    return np.where(pixels[..., -1] < 0.5, 1.0, grey) if pixels.shape[2] in {2, 4} else grey


def _decoded(path: Path) -> NDArray[np.float64]:
    """An image as matplotlib reads it, its size checked before anything of it is decoded."""
    from matplotlib.image import imread
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(path, formats=_FORMATS) as image:
            _check_size(*image.size)
        return np.asarray(imread(path), dtype=np.float64)


def _pgm(path: Path) -> NDArray[np.float64]:
    content = path.read_bytes()
    header: list[int] = []
    position = 2
    while len(header) < 3:
        end = content.find(b"\n", position) if content[position : position + 1] == b"#" else -1
        if end >= 0:
            position = end + 1
        elif content[position : position + 1].isspace():
            position += 1
        else:
            word = content[position : position + 20].split(None, 1)[:1]
            header.append(int(word[0]) if word else 0)
            position += len(word[0]) if word else 0
    columns, rows, brightest = header
    _check_size(columns, rows)
    if not 0 < brightest < 1 << 16:
        raise ValueError(f"found {brightest} for white, expected a whole number from 1 to 65535")
    if content.startswith(b"P2"):
        values = np.array(content[position:].split(None, rows * columns)[: rows * columns], dtype=np.float64)
    else:
        kind = np.dtype(">u2") if brightest > 255 else np.dtype(np.uint8)
        values = np.frombuffer(content, kind, offset=position + 1, count=rows * columns).astype(np.float64)
    if len(values) != rows * columns or not np.isfinite(values).all():
        raise ValueError(f"found {len(values)} cells, expected {columns} × {rows}")
    cells: NDArray[np.float64] = values.reshape(rows, columns) / brightest
    return cells

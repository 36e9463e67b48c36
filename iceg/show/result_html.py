"""A result as notebooks show it: a small map beside its figures."""

import base64
import html
import io
from typing import TYPE_CHECKING

from PIL import Image

from iceg.show.map_image import MapLayers, known_box, map_image
from iceg.slam.closures.closure import joined_scans

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

_LONG_SIDE = 420
_MOST_WARNINGS = 3


def result_html(result: "SlamResult") -> str:
    """One self-contained block of HTML, the picture in it."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{name}</th><td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in _figures(result).items()
    )
    warnings = result.summary["warnings"]
    told = "".join(f"<li>{html.escape(warning)}</li>" for warning in warnings[:_MOST_WARNINGS])
    more = f"<li>and {len(warnings) - _MOST_WARNINGS} more</li>" if len(warnings) > _MOST_WARNINGS else ""
    return (
        "<div style='display:flex;gap:1.5em;align-items:flex-start'>"
        f"<img alt='map' style='max-width:{_LONG_SIDE}px' src='data:image/png;base64,{_picture(result)}'>"
        f"<div><table>{rows}</table>{f'<ul>{told}{more}</ul>' if told else ''}</div></div>"
    )


def _figures(result: "SlamResult") -> dict[str, str]:
    x_min, x_max, y_min, y_max = known_box(result.grid, result.trajectory)
    return {
        "log": result.log.path.name,
        "scans": f"{len(result.trajectory)}, {len(result.key_scans)} key poses",
        "map": f"{x_max - x_min:.1f} m × {y_max - y_min:.1f} m, cells of {100 * result.grid.resolution:g} cm",
        "loop closures": f"{len(joined_scans(result.closures))} of {len(result.closures)} tried",
        "landmarks": str(len(result.landmarks.settled())),
    }


def _picture(result: "SlamResult") -> str:
    """PNG in base64."""
    layers = MapLayers(
        grid=result.grid,
        trajectory=result.trajectory,
        landmarks=result.landmarks,
        closures=joined_scans(result.closures),
    ).settled(3)
    image = map_image(layers, box=known_box(result.grid, result.trajectory), long_side=2 * _LONG_SIDE)
    content = io.BytesIO()
    Image.fromarray(image).save(content, format="PNG")
    return base64.b64encode(content.getvalue()).decode("ascii")

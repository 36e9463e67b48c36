"""The pieces of wall of a run for its report."""

from collections.abc import Mapping
from typing import Any

from iceg.report.packing import packed
from iceg.slam.joint.wall_pieces import WallPieces


def walls_payload(walls: WallPieces) -> Mapping[str, Any]:
    """Both ends of each piece in the map frame [m]."""
    return {"ends": packed(walls.ends.reshape(-1, 4), "f4")}

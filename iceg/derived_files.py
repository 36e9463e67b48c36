"""Files that commands derive from the results of a run into its folder, and which of them are of earlier results."""

from pathlib import Path
from typing import get_args

from iceg.export.formats import FORMATS
from iceg.results import RESULT_FILES
from iceg.show.run_plots import PictureFormat, PictureName

_PICTURES = tuple(f"{name}.{kind}" for name in get_args(PictureName) for kind in get_args(PictureFormat))
DERIVED_FILES = tuple(
    name for name in (*_PICTURES, *(form.name for form in FORMATS.values())) if name not in RESULT_FILES
)
"""What `iceg plot` and `iceg export` write unless told where to."""


def stale_files(directory: Path) -> tuple[str, ...]:
    """Names of derived files and folders that are older than the results beside them.

    They are not removed with the results they are of: iceg does not know whether it wrote them.

    Args:
        directory: of the results.

    Returns:
        Names, none where the folder holds no results.
    """
    summary = directory / "summary.json"
    if not summary.exists():
        return ()
    written = summary.stat().st_mtime_ns
    paths = (directory / name for name in DERIVED_FILES)
    return tuple(path.name for path in paths if path.exists() and path.stat().st_mtime_ns < written)

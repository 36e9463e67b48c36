"""Writing one text file whole or not at all."""

from pathlib import Path

from graph.atomic import write_atomically
from graph.errors import reason
from iceg.export.options import ExportError


def write_text(path: Path, text: str) -> None:
    """Replace a file.

    Raises:
        ExportError: it cannot be written.
    """
    try:
        write_atomically(path, text.encode())
    except OSError as err:
        raise ExportError(f"{path}: cannot be written: {reason(err)}") from err

"""Text logs written piece by piece, compressed when the name says so, and whole or not at all."""

import gzip
from collections.abc import Iterable
from pathlib import Path

from frontends.logs.errors import LogError
from graph.atomic import replacing
from graph.errors import reason


def write_text_log(path: Path, pieces: Iterable[str]) -> None:
    """Write ASCII text, gzip when `path` ends with .gz; the same text gives the same bytes.

    Args:
        path: replaced as a whole when all is written.
        pieces: of the text, in order.

    Raises:
        LogError: the file cannot be written.
    """
    try:
        with replacing(path) as file:
            if path.suffix == ".gz":
                with gzip.GzipFile(filename="", mode="wb", fileobj=file, mtime=0) as packed:
                    packed.writelines(piece.encode("ascii") for piece in pieces)
            else:
                file.writelines(piece.encode("ascii") for piece in pieces)
    except OSError as error:
        raise LogError(f"{path}: cannot be written ({reason(error)})") from error

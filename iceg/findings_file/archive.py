"""Named arrays in one file: a ZIP of NPY as NumPy's, its bytes the same on every machine, read without trust.

Nothing is compressed: compressors of different versions write different bytes, and no small file can claim to unpack to
a large one.
"""

import io
import tokenize
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graph.errors import reason
from graph.files import check_file
from iceg.findings_file.errors import FindingsError

Arrays = Mapping[str, NDArray[Any]]

_DATE = (1980, 1, 1, 0, 0, 0)
_DAMAGE = (OSError, ValueError, TypeError, EOFError, KeyError, RuntimeError, SyntaxError, tokenize.TokenError)
_KINDS = "iufb"
"""What arrays may hold: whole numbers, floating-point ones, truth values."""
_MOST_DIMENSIONS = 4


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays, little-endian."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            data = np.ascontiguousarray(array)
            data = data.astype(data.dtype.newbyteorder("<"), copy=False)
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _DATE), "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, data, version=(1, 0), allow_pickle=False)


def read_arrays(path: Path, what: str) -> dict[str, NDArray[Any]]:
    """Read arrays back, read-only.

    Args:
        path: the file.
        what: for messages: "cannot be read as" what.

    Raises:
        FindingsError: it is none, or too large.
    """
    check_file(path, "log_bytes", FindingsError, what)
    try:
        with zipfile.ZipFile(path) as archive:
            return {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in archive.infolist()}
    except (*_DAMAGE, zipfile.BadZipFile) as err:
        told = " ".join(reason(err).split())[:200]
        raise FindingsError(f"{path}: cannot be read as {what}: {told}") from err


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1:
        raise ValueError(f"found '{entry.filename[:60]}' compressed or encrypted, expected neither")
    content = archive.read(entry)
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"found '{entry.filename[:60]}' of another version of NPY, expected 1.0")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.kind not in _KINDS or dtype.byteorder == ">" or is_fortran or len(shape) > _MOST_DIMENSIONS:
        raise ValueError(f"found '{entry.filename[:60]}' of type {dtype} and shape {shape}, expected rows of numbers")
    count = 1
    for size in shape:
        if size < 0:
            raise ValueError(f"found '{entry.filename[:60]}' of shape {shape}")
        count *= size
    if count * dtype.itemsize != len(content) - stream.tell():
        raise ValueError(f"found '{entry.filename[:60]}' of shape {shape}, but {len(content) - stream.tell()} bytes")
    return np.frombuffer(content, dtype=dtype, offset=stream.tell()).reshape(shape)

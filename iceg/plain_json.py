"""Values in JSON's own types."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from graph.file_names import readable


def plain(value: Any) -> Any:  # noqa: ANN401
    """The value in JSON's own types; what is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, int | float | bool | None):
        return value
    return readable(str(value))


def format_json(value: Any, indent: int | None = None) -> str:  # noqa: ANN401
    """One JSON value as text."""
    return json.dumps(plain(value), indent=indent, ensure_ascii=False, allow_nan=False)

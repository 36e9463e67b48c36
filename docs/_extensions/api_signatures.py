"""Types of arrays in the signatures as the code writes them: `NDArray[float64]`."""

import re
from typing import Any

from sphinx.application import Sphinx

_ARRAY = re.compile(r"~?(?:numpy\.)?ndarray\[tuple\[(?:~typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[(~?[\w.]+)\]\]")


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite each signature."""
    app.connect("autodoc-process-signature", _shortened)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _shortened(
    app: Sphinx,  # noqa: ARG001
    what: str,  # noqa: ARG001
    name: str,  # noqa: ARG001
    thing: object,  # noqa: ARG001
    options: Any,  # noqa: ANN401, ARG001
    signature: str | None,
    returns: str | None,
) -> tuple[str | None, str | None]:
    return _with_short_arrays(signature), _with_short_arrays(returns)


def _with_short_arrays(text: str | None) -> str | None:
    return None if text is None else _ARRAY.sub(lambda found: f"NDArray[{found[1].split('.')[-1]}]", text)

"""Says what shadows what when Python would take someone else's `graph` or `frontends` for ours."""

from __future__ import annotations

import os.path
import sys

_OURS = ("graph", "frontends")
# Paths as text, finders asked one by one: pathlib takes 12 ms to load and importlib.util 5, all else that is loaded
# before the command line handles signals 11.
_HOME = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))  # noqa: PTH120


def check_shadowing(names: tuple[str, ...] = _OURS, home: str | os.PathLike[str] = _HOME) -> None:
    """Make sure that the packages iceg needs are its own, not a `graph.py` of the user's that Python finds first.

    Args:
        names: top-level packages that are installed beside iceg.
        home: the folder they are installed in.

    Raises:
        ImportError: names the file that is in the way and the package it hides.
    """
    for name in names:
        expected = os.path.join(home, name, "__init__.py")  # noqa: PTH118
        found = _found(name)
        if os.path.isfile(expected) and found is not None and found != expected:  # noqa: PTH113
            raise ImportError(
                f"{found} shadows the package {name!r} that iceg needs ({expected}):"
                " rename it, or start Python from another folder",
                name=name,
                path=found,
            )


def _found(name: str) -> str | None:
    """The file that `import name` gives, or has given already."""
    module = sys.modules.get(name)
    file = module.__file__ if module is not None else _origin(name)
    return None if file is None else os.path.realpath(file)


def _origin(name: str) -> str | None:
    for finder in sys.meta_path:
        spec = finder.find_spec(name, None)
        if spec is not None:
            return spec.origin
    return None

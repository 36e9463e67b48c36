"""Says what shadows what when Python would take someone else's `graph` or `frontends` for ours."""

import sys
from importlib.util import find_spec
from pathlib import Path

_OURS = ("graph", "frontends")
_HOME = Path(__file__).resolve().parent.parent


def check_shadowing(names: tuple[str, ...] = _OURS, home: Path = _HOME) -> None:
    """Make sure that the packages iceg needs are its own, not a `graph.py` of the user's that Python finds first.

    Args:
        names: top-level packages that are installed beside iceg.
        home: the folder they are installed in.

    Raises:
        ImportError: names the file that is in the way and the package it hides.
    """
    for name in names:
        expected = home / name / "__init__.py"
        found = _found(name)
        if expected.is_file() and found is not None and found != expected:
            raise ImportError(
                f"{found} shadows the package {name!r} that iceg needs ({expected}):"
                " rename it, or start Python from another folder",
                name=name,
                path=str(found),
            )


def _found(name: str) -> Path | None:
    """The file that `import name` gives, or has given already."""
    module = sys.modules.get(name)
    file = module.__file__ if module is not None else _origin(name)
    return None if file is None else Path(file).resolve()


def _origin(name: str) -> str | None:
    try:
        spec = find_spec(name)
    except ValueError:  # something in sys.modules without a spec
        return None
    return spec.origin if spec is not None else None

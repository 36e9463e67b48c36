"""What `iceg --version` says: of iceg, of what its figures depend on, and which extras are there."""

import platform
import re
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version

_DEPENDED_ON = ("gtsam", "numba", "numpy", "scipy")
_FOR_DEVELOPMENT = "dev"
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)[^;]*;.*\bextra == ['\"](?P<extra>[\w-]+)['\"]")


def versions() -> str:
    """Lines of text: iceg's own version, that of Python and of packages, and each extra with what it lacks."""
    lines = [
        f"iceg {version('iceg')}",
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}",
    ]
    lines += [f"{name} {_installed(name) or 'missing'}" for name in _DEPENDED_ON]
    lines += [f"extra {extra}: {_found(names)}" for extra, names in extras(requires("iceg") or []).items()]
    return "\n".join(lines)


def extras(requirements: Iterable[str]) -> dict[str, list[str]]:
    """The packages that each extra brings to users; that for development is left out.

    Args:
        requirements: as the metadata of a package lists them, `ezdxf>=1.3; extra == 'dxf'`.

    Returns:
        Names of packages by extra.
    """
    found: dict[str, list[str]] = {}
    for match in filter(None, map(_REQUIREMENT.match, requirements)):
        if match["extra"] != _FOR_DEVELOPMENT:
            found.setdefault(match["extra"], []).append(match["name"])
    return found


def _found(names: Iterable[str]) -> str:
    there = {name: _installed(name) for name in names}
    missing = [name for name, its_version in there.items() if its_version is None]
    if missing:
        return f"not installed, lacks {', '.join(missing)}"
    return ", ".join(f"{name} {its_version}" for name, its_version in there.items())


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None

"""A Chromium to look at pages with: one that is there, or, by `python -m tests.browser`, one that is installed.

Debian's package where it may be installed; else the browser that the npm package below ships, in `.venv/browser`.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_PACKAGE = "@sparticuz/chromium@153.0.0"
_UNPACK = 'import chromium from "@sparticuz/chromium"; await chromium.executablePath();'
_FOLDER = Path(__file__).parent.parent / ".venv" / "browser"

HOW_TO_GET_ONE = (
    "no Chromium found: install Debian's 'chromium', or run 'python -m tests.browser', or set ICEG_BROWSER to one"
)


def find_browser() -> Path | None:
    """What `ICEG_BROWSER` names, a browser on the path, or the one unpacked here; None without any."""
    given = os.environ.get("ICEG_BROWSER")
    if given:
        return Path(given)
    found = next(filter(None, map(shutil.which, _NAMES)), None)
    unpacked = _FOLDER / "chromium"
    return Path(found) if found else unpacked if unpacked.is_file() else None


def _install() -> None:
    """Get one where none is; says so where that cannot be."""
    if find_browser() is not None:
        return
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    ways = [(_from_debian, is_root and shutil.which("apt-get")), (_from_npm, shutil.which("npm"))]
    for install, is_possible in ways:
        if is_possible and install():
            return
    print(HOW_TO_GET_ONE, file=sys.stderr)


def _from_debian() -> bool:
    quietly = ("apt-get", "-qq", "-y", "--no-install-recommends")
    _runs(*quietly, "update")
    return _runs(*quietly, "install", "chromium", "fonts-dejavu-core", DEBIAN_FRONTEND="noninteractive")


def _from_npm() -> bool:
    _FOLDER.mkdir(parents=True, exist_ok=True)
    script = _FOLDER / "unpack.mjs"
    script.write_text(_UNPACK, encoding="utf-8")
    return _runs("npm", "install", "--silent", "--no-fund", "--no-audit", f"--prefix={_FOLDER}", _PACKAGE) and _runs(
        "node", str(script), TMPDIR=str(_FOLDER)
    )


def _runs(*command: str, **environment: str) -> bool:
    done = subprocess.run(command, env=os.environ | environment, stdout=subprocess.DEVNULL, check=False)
    return done.returncode == 0


if __name__ == "__main__":
    _install()

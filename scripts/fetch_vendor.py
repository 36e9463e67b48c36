"""Fetch the JavaScript libraries that the report ships, from the npm registry, and check them against their hashes.

`python scripts/fetch_vendor.py` needs npm; it rewrites `iceg/report/vendor/`.
"""

import base64
import hashlib
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import NamedTuple

VENDOR = Path(__file__).parent.parent / "iceg" / "report" / "vendor"


class Library(NamedTuple):
    """An npm package, the SHA-512 of its tarball, and which of its files are shipped under which name."""

    package: str
    integrity: str
    files: dict[str, str]


LIBRARIES = (
    Library(
        "leaflet@1.9.4",
        "sha512-nxS1ynzJOmOlHp+iL3FyWqK89GtNL8U8rvlMOsQdTTssxZwCXh8N2NB3GDQOL+YR3XnWyZAxwQixURb+FA74PA==",
        {"dist/leaflet.js": "leaflet.js", "dist/leaflet.css": "leaflet.css", "LICENSE": "leaflet.LICENSE"},
    ),
    Library(
        "uplot@1.6.32",
        "sha512-KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw==",
        {
            "dist/uPlot.iife.min.js": "uPlot.iife.min.js",
            "dist/uPlot.min.css": "uPlot.min.css",
            "LICENSE": "uPlot.LICENSE",
        },
    ),
)


def fetch(library: Library, folder: Path) -> None:
    """Download one package, check it, and put its files in their place."""
    subprocess.run(["npm", "pack", "--silent", library.package], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    tarball = folder / f"{library.package.replace('@', '-')}.tgz"
    found = "sha512-" + base64.b64encode(hashlib.sha512(tarball.read_bytes()).digest()).decode()
    if found != library.integrity:
        sys.exit(f"{library.package}: found {found}, expected {library.integrity}")
    with tarfile.open(tarball) as archive:
        for source, name in library.files.items():
            member = archive.extractfile(f"package/{source}")
            if member is None:
                sys.exit(f"{library.package}: holds no {source}")
            text = member.read().decode().rstrip("\n")
            kept = [line for line in text.splitlines() if not line.startswith("//# sourceMappingURL=")]
            (VENDOR / name).write_text("\n".join(kept) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    VENDOR.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        for wanted in LIBRARIES:
            fetch(wanted, Path(temporary))

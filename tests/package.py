"""The package as a user gets it: built, checked, installed into a clean environment, and run from another folder.

As a command (`make package`), with each interpreter given:

    python tests/package.py [--python PATH ...]
"""

import argparse
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGES = ("graph", "frontends", "iceg")
LEFT_BY_A_RUN = ("trajectory.tum", "graph.g2o", "covariances.csv", "closures.csv", "map.pgm", "map.png", "summary.json")


class PackageError(Exception):
    """What is wrong with the package."""


def main(words: Sequence[str] | None = None) -> int:
    """Build, check, install, run."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--python", nargs="+", default=[sys.executable], help="interpreters to install the wheel with")
    interpreters = parser.parse_args(words).python
    dist = REPOSITORY / "dist"
    try:
        wheel, sdist = build(dist)
        check_files(wheel, sdist)
        for interpreter in interpreters:
            with tempfile.TemporaryDirectory() as folder:
                try_out(wheel, interpreter, Path(folder))
    except PackageError as err:
        print(f"package: {err}", file=sys.stderr)
        return 1
    return 0


def build(dist: Path) -> tuple[Path, Path]:
    """Wheel and sdist, the wheel built from the sdist; both pass twine's check."""
    for old in dist.glob("iceg-*"):
        old.unlink()
    _run([sys.executable, "-m", "build", "--outdir", str(dist), str(REPOSITORY)])
    (wheel,), (sdist,) = dist.glob("iceg-*.whl"), dist.glob("iceg-*.tar.gz")
    _run([sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)])
    return wheel, sdist


def check_files(wheel: Path, sdist: Path) -> None:
    """Make sure that all files of the packages are in both, every licence is among the wheel's, and nothing else is."""
    kept = set(_run(["git", "-C", str(REPOSITORY), "ls-files", *PACKAGES]).split())
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    info = next(name.partition("/")[0] for name in names if ".dist-info/" in name)
    _compare(wheel, {name for name in names if not name.startswith(f"{info}/")}, kept)
    licences = {"LICENSE"} | {name for name in kept if name.endswith(".LICENSE")}
    _compare(wheel, {name for name in names if "/licenses/" in name}, {f"{info}/licenses/{name}" for name in licences})
    with tarfile.open(sdist) as source:
        members = {member.name.partition("/")[2] for member in source if member.isfile()}
    _compare(sdist, {name for name in members if name.partition("/")[0] in PACKAGES}, kept)


def try_out(wheel: Path, interpreter: str, folder: Path) -> None:
    """Install the wheel into an environment of its own; run the demo and the README's Python from there."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    environment |= {"MPLBACKEND": "Agg", "NUMBA_CACHE_DIR": str(folder / "kernels")}
    _run([interpreter, "-m", "venv", str(folder / "venv")])
    bin_folder = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    python, elsewhere = str(bin_folder / "python"), folder / "elsewhere"
    elsewhere.mkdir()
    constraints = str(REPOSITORY / "constraints.txt")
    _run([python, "-m", "pip", "install", "--quiet", "-c", constraints, str(wheel)], elsewhere, environment)
    print(_run([str(bin_folder / "iceg"), "--version"], elsewhere, environment))
    _run([str(bin_folder / "iceg"), "demo", "-o", "demo"], elsewhere, environment)
    missing = [name for name in LEFT_BY_A_RUN if not (elsewhere / "demo" / name).is_file()]
    if missing:
        raise PackageError(f"iceg demo left no {', '.join(missing)}")
    (elsewhere / "readme.py").write_text("\n".join(_readme_blocks()), encoding="utf-8")
    _run([python, "readme.py"], elsewhere, environment)
    print(f"{wheel.name}: iceg demo and the README's Python run from an environment of its own")


def _readme_blocks() -> list[str]:
    blocks = re.findall(r"```python\n(.*?)```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    if not blocks:
        raise PackageError("README.md: found no block of Python, expected one")
    return blocks


def _compare(archive: Path, found: set[str], expected: set[str]) -> None:
    missing, unexpected = sorted(expected - found), sorted(found - expected)
    if missing or unexpected:
        raise PackageError(f"{archive.name}: lacks {missing[:5]}, holds {unexpected[:5]} that the repository has not")


def _run(words: list[str], folder: Path = REPOSITORY, environment: dict[str, str] | None = None) -> str:
    print("+", " ".join(words), flush=True)
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PackageError(f"{words[0]} ended with {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())

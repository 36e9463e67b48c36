"""The same log on what other machines would be: processors with less, one core, other Pythons.

As a command (`make machines`), every setting this machine can run on each log given, one line each:

    python tests/machines.py [LOG ...] [--python PATH ...]
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy._core import _multiarray_umath as numpy_core  # type: ignore[attr-defined]

DISPATCHED: list[str] = numpy_core.__cpu_dispatch__
FEATURES: dict[str, bool] = numpy_core.__cpu_features__
_CORES = {  # kernels of OpenBLAS, and what a processor needs for them
    "Prescott": "SSE3",
    "Nehalem": "SSE42",
    "Sandybridge": "AVX",
    "Haswell": "AVX2",
    "Zen": "AVX2",
    "SkylakeX": "AVX512_SKX",
    "Cooperlake": "AVX512_SPR",
    "SapphireRapids": "AVX512_SPR",
}
_OF_THE_MOMENT = ("seconds", "cpu_seconds", "writing_s", "writing_cpu_s", "peak_memory_mb", "versions")


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What a run finds.

    Attributes:
        name: of the setting.
        environment: variables that stand for it.
        one_core: whether only one core may be used.
        python: the interpreter.
    """

    name: str
    environment: Mapping[str, str] = field(default_factory=dict)
    one_core: bool = False
    python: Path = Path(sys.executable)


def without_numpy_features() -> list[Machine]:
    """NumPy without the newest extensions of the processor, without the two newest, and so on."""
    there = [name for name in DISPATCHED if FEATURES.get(name)]
    return [
        Machine(
            name=f"NumPy without {there[k]} and later", environment={"NPY_DISABLE_CPU_FEATURES": " ".join(there[k:])}
        )
        for k in range(len(there))
    ]


def openblas_cores() -> list[Machine]:
    """Every family of kernels of OpenBLAS that this processor can run."""
    able = [core for core, needs in _CORES.items() if FEATURES.get(needs, needs == "SSE3")]
    return [Machine(name=f"OpenBLAS for {core}", environment={"OPENBLAS_CORETYPE": core}) for core in able]


def all_machines(kernels: Path) -> list[Machine]:
    """Every setting; kernels for any processor are compiled into a folder of their own."""
    generic = {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(kernels)}
    return [
        Machine(name="as it is"),
        Machine(name="one core", one_core=True),
        *openblas_cores(),
        *without_numpy_features(),
        Machine(name="kernels for any processor", environment=generic),
    ]


def results(machine: Machine, log: Path, folder: Path) -> dict[str, str]:
    """Run a log; a digest of each file that it leaves, times and memory left out."""
    command = [str(machine.python), "-P", "-m", "iceg", "run", str(log), "-o", str(folder)]
    if machine.one_core:
        command = ["taskset", "--cpu-list", str(min(os.sched_getaffinity(0))), *command]
    given = os.environ | machine.environment
    done = subprocess.run(command, env=given, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{machine.name}: {' '.join(command)} failed:\n{done.stderr}")
    return dict(_digests(folder))


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    for path in sorted(folder.iterdir()):
        content = path.read_bytes()
        if path.name == "summary.json":
            content = json.dumps(_lasting(json.loads(content)), sort_keys=True).encode()
        if path.name == "report.html":
            content = re.sub(rb'<script type="application/json" id="stages">.*', b"", content)
        yield path.name, hashlib.sha256(content).hexdigest()


def _lasting(summary: Any) -> Any:
    if isinstance(summary, dict):
        return {key: _lasting(value) for key, value in summary.items() if key not in _OF_THE_MOMENT}
    return [_lasting(value) for value in summary] if isinstance(summary, list) else summary


def _with_iceg(python: str, folder: Path) -> Machine:
    """Another Python, iceg installed in an environment of its own."""
    subprocess.run([python, "-m", "venv", str(folder)], check=True)
    own = folder / "bin" / "python"
    source = Path(__file__).parent.parent
    install = [own, "-m", "pip", "install", "--quiet", "-c", source / "constraints.txt", source]
    subprocess.run(list(map(str, install)), check=True)
    return Machine(name=f"{python}", python=own)


def main() -> int:
    """Compare all settings on all logs."""
    parser = argparse.ArgumentParser(description="Whether this machine's result is that of others.")
    parser.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="the embedded log when left out")
    parser.add_argument("--python", nargs="*", default=[], metavar="PATH", help="other interpreters, with venv and pip")
    asked = parser.parse_args()
    logs = asked.logs or [Path(__file__).parent.parent / "iceg" / "demo" / "office.clf.gz"]
    others = 0
    with tempfile.TemporaryDirectory() as folder:
        machines = all_machines(Path(folder) / "kernels")
        machines += [_with_iceg(python, Path(folder) / f"venv-{k}") for k, python in enumerate(asked.python)]
        for log in logs:
            usual: dict[str, str] = {}
            for k, machine in enumerate(machines):
                found = results(machine, log, Path(folder) / f"{log.name}-{k}")
                usual = usual or found
                differing = [name for name in found if found[name] != usual.get(name)]
                others += bool(differing)
                print(f"{log.name}: {machine.name}: {', '.join(differing) + ' differ' if differing else 'the same'}")
    print(f"{others} of {len(logs) * len(machines)} runs differ")
    return 1 if others else 0


if __name__ == "__main__":
    sys.exit(main())

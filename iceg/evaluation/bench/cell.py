"""One run of an experiment: a method with its settings, a log, a seed."""

import functools
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from graph.errors import reason
from iceg.evaluation.bench.methods import Method, make_method
from iceg.evaluation.errors import EvaluationError

SCENE = "scene:"
"""What the path of a log begins with when it is simulated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSource:
    """A log of an experiment and what it is judged by.

    Attributes:
        name: in tables.
        path: the file, or `scene:NAME`, which is simulated and knows its truth.
        relations: the benchmark's relative poses, a CSV by scan.
        reference: reference poses of some scans, a CSV.
        truth: the true pose of every scan, a CSV.
    """

    name: str
    path: str
    relations: str | None = None
    reference: str | None = None
    truth: str | None = None

    @property
    def scene(self) -> str | None:
        """What is simulated: the name of a scene or the path of a `.world` file; None for a recorded log."""
        return self.path.removeprefix(SCENE) if self.path.startswith(SCENE) else None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files it is made of."""
        log = self.path if self.scene is None else self.scene if self.scene.endswith(".world") else None
        given = (log, self.relations, self.reference, self.truth)
        return tuple(Path(name) for name in given if name is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One run to be made.

    Attributes:
        method: one of `METHODS`.
        label: the method's name in tables, with the values of the sweep.
        settings: by dotted key, those that differ from the defaults, the swept ones included.
        swept: the part of them that the sweep varies.
        log: what it runs on.
        seed: of the simulation and of the method.
    """

    method: str
    label: str
    settings: Mapping[str, Any]
    swept: Mapping[str, Any]
    log: LogSource
    seed: int

    @property
    def name(self) -> str:
        """Of the run, for people."""
        return f"{self.label} · {self.log.name} · seed {self.seed}"

    @property
    def folder(self) -> str:
        """Of its results; a short digest keeps apart names that differ only in what a path cannot hold."""
        plain = re.sub(r"[^A-Za-z0-9.,_=+-]+", "-", self.name)
        return plain if len(plain) <= 120 else f"{plain[:110]}-{hashlib.sha256(self.name.encode()).hexdigest()[:8]}"

    def make(self) -> Method:
        """The method with its settings.

        Raises:
            IcegError: a setting is not valid.
        """
        return make_method(self.method, self.settings, self.seed, self.label)

    def digest(self) -> str:
        """Of all that decides about the result: resolved settings, contents of the files, seed and version.

        Raises:
            IcegError: a setting is not valid, or a file cannot be read.
        """
        from iceg import __version__

        decisive = {
            "method": self.method,
            "settings": self.make().resolved(),
            "scene": self.log.scene,
            "files": [_content_digest(path) for path in self.log.files],
            "seed": self.seed,
            "version": __version__,
        }
        return hashlib.sha256(json.dumps(decisive, sort_keys=True, default=str).encode()).hexdigest()

    def to_json(self) -> str:
        """As text; `from_json` reads it back."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "Cell":
        """What `to_json` wrote."""
        fields = json.loads(text)
        return cls(**{**fields, "log": LogSource(**fields["log"])})


@functools.cache
def _content_digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as err:
        raise EvaluationError(f"{path}: cannot be read: {reason(err)}") from err

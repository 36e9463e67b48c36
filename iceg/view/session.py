"""A run that is being corrected: its folder, the corrections so far, and the way back."""

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graph.files import read_text
from iceg import pipeline
from iceg.corrections.corrections import CorrectionsError
from iceg.corrections.reading import parse_corrections
from iceg.resolving import findings_of
from iceg.results import read_summary, write_results
from iceg.view.edits import WITHDRAW, edit_block, withdrawn_scans
from iceg.view.withdrawal import without_added

CORRECTIONS = "corrections.toml"
_ABOUT_CLOSURES = "corrections"
"""The kind of warning that is about corrections."""


class StaleEditError(CorrectionsError):
    """An edit of a page that shows an earlier state."""


class Session:
    """One run and what is corrected of it; edits are made one after the other, whoever asks for them.

    The corrections are those of `corrections.toml` in the folder, as they are written there, and one table more for
    each edit, or without that of a closure that is taken out. Results and corrections are replaced together.
    """

    def __init__(self, directory: Path) -> None:
        """Read a run, and conclude it with the corrections that are there already.

        Raises:
            IcegError: the folder is none of a run's, or its corrections cannot be read.
        """
        self.directory = directory
        self._findings = findings_of(directory)
        path = directory / CORRECTIONS
        given = read_text(path, "settings_bytes", CorrectionsError, "corrections") if path.exists() else ""
        self._texts = [given if not given or given.endswith("\n") else f"{given}\n"]
        self._is_missing = not path.exists() and "corrections" in read_summary(directory)
        self._revision = 0
        self._sentences: list[str] = []
        self._lock = threading.Lock()
        if given:
            self._conclude(self._texts[-1])

    def state(self) -> dict[str, Any]:
        """For the page: which state it is, how many edits can be taken back, the corrections and their conflicts."""
        with self._lock:
            return self._state()

    def edit(self, kind: str, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Make an edit, conclude the run anew, and say what came of it.

        Args:
            kind: what is asked for, see `edit_block`, or "withdraw" or "undo".
            asked: by the page; `revision` is that of the state it shows.

        Raises:
            StaleEditError: the page shows an earlier state.
            IcegError: the edit cannot be made; nothing has changed.
        """
        with self._lock:
            if asked.get("revision") != self._revision:
                raise StaleEditError("the run has been corrected elsewhere since this page was opened: load it again")
            if self._is_missing:
                raise CorrectionsError(
                    f"the run was given corrections that its folder does not hold: put them there as {CORRECTIONS}, "
                    "or they would be lost, and start iceg view again"
                )
            texts = self._after(kind, asked)
            self._conclude(texts[-1])
            self._texts, self._revision = texts, self._revision + 1
            return self._state()

    def _after(self, kind: str, asked: Mapping[str, Any]) -> list[str]:
        """The corrections after each edit, the newest last."""
        if kind == "undo":
            if not self.has_edits:
                raise CorrectionsError("there is nothing to undo")
            return self._texts[:-1]
        text = self._texts[-1]
        if kind == WITHDRAW:
            return [*self._texts, without_added(text, withdrawn_scans(asked), CORRECTIONS)]
        return [*self._texts, _joined(text, edit_block(kind, asked))]

    def wait(self) -> None:
        """Until no edit is being made."""
        with self._lock:
            pass

    @property
    def is_corrected(self) -> bool:
        """Whether any corrections are in force."""
        return bool(self._texts[-1])

    @property
    def has_edits(self) -> bool:
        """Whether any edit is in force."""
        return len(self._texts) > 1

    def _state(self) -> dict[str, Any]:
        return {
            "revision": self._revision,
            "undo": len(self._texts) - 1,
            "corrections": self._texts[-1],
            "warnings": self._sentences,
        }

    def _conclude(self, text: str) -> None:
        result = pipeline.resolve(self._findings, parse_corrections(text, CORRECTIONS))
        write_results(result, self.directory, overwrite=True, beside={CORRECTIONS: text})
        self._sentences = [warning.sentence for warning in result.run_warnings if warning.kind == _ABOUT_CLOSURES]


def _joined(text: str, block: str) -> str:
    return f"{text}\n{block}" if text else block

"""What a command tells: sentences and tables for a person, or the same figures as one JSON object."""

import sys
from types import TracebackType
from typing import Any, Self

from iceg.evaluation.bench.tables import Row, format_markdown


class Telling:
    """Prints as it goes; with `as_json`, sentences go to stderr and the figures to stdout when all is done."""

    def __init__(self, *, as_json: bool) -> None:
        self.as_json = as_json
        self._figures: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.as_json and error is None:
            from iceg.plain_json import format_json

            print(format_json(self._figures))

    def say(self, text: str) -> None:
        """Print for a person."""
        print(text, file=sys.stderr if self.as_json else sys.stdout, flush=True)

    def table(self, name: str, title: str, rows: list[Row]) -> None:
        """Print a table under its title, or keep its rows under its name."""
        self.keep(**{name: rows})
        if not self.as_json:
            print("\n".join(["", *filter(None, [title]), *([format_markdown(rows)] if rows else [])]), flush=True)

    def keep(self, **figures: object) -> None:
        """Figures for the JSON object."""
        self._figures |= figures

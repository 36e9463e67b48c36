"""Lines of a `.world` text, taken apart into a keyword, words and options."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from frontends.simulator.world import SimulatorError
from graph.limits import LIMITS


@dataclass(frozen=True, kw_only=True)
class Statement:
    """One line, taken apart.

    Attributes:
        where: path:line.
        keyword: its first word.
        words: what follows without `=`.
        named: what follows as `name=value`.
    """

    where: str
    keyword: str
    words: tuple[str, ...]
    named: dict[str, str]

    def error(self, found: str, expected: str) -> SimulatorError:
        """What is wrong with it, and where."""
        return SimulatorError(f"{self.where}: found {found}, expected {expected}")

    def numbers(self, count: int | None, usage: str) -> list[float]:
        """The words as numbers, `count` of them where that is fixed."""
        if count is not None and len(self.words) != count:
            raise self.error(f"{len(self.words)} numbers after '{self.keyword}'", f"{self.keyword} {usage}")
        return [self._number(word) for word in self.words]

    def points(self) -> tuple[tuple[float, float], ...]:
        """The words as two points or more."""
        numbers = self.numbers(None, "")
        if len(numbers) < 4 or len(numbers) % 2:
            raise self.error(f"{len(numbers)} numbers after '{self.keyword}'", "X0 Y0 X1 Y1 and so on, two a point")
        return tuple(zip(numbers[::2], numbers[1::2], strict=True))

    def word(self, usage: str) -> str:
        """The only word."""
        if len(self.words) != 1:
            raise self.error(f"{len(self.words)} words after '{self.keyword}'", f"{self.keyword} {usage}")
        return self.words[0]

    def options(self, **defaults: float) -> dict[str, float]:
        """The options, `defaults` where they are left out; no others are known."""
        unknown = next((key for key in self.named if key not in defaults), None)
        if unknown is not None:
            known = ", ".join(f"{key}=" for key in defaults) or "no options"
            raise self.error(f"'{unknown[:80]}='", f"{known} after '{self.keyword}'")
        return defaults | {key: self._number(word) for key, word in self.named.items()}

    def _number(self, word: str) -> float:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not abs(value) <= LIMITS.coordinate:
            raise self.error(f"'{word[:40]}'", f"a number of at most {LIMITS.coordinate:g}")
        return value


def statements(text: str, path: Path) -> Iterator[Statement]:
    """Every line that says something; `path` names it in errors."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", maxsplit=1)[0].split()
        if not words:
            continue
        pairs = [word.split("=", maxsplit=1) for word in words[1:] if "=" in word]
        yield Statement(
            where=f"{path}:{number}",
            keyword=words[0],
            words=tuple(word for word in words[1:] if "=" not in word),
            named=dict(pairs),
        )

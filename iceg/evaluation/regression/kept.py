"""The tables kept with iceg: the baseline that later versions are held against, and what each rule is worth."""

from pathlib import Path

_FOLDER = Path(__file__).parent
BASELINE = _FOLDER / "baseline.csv"
"""Outcomes, a row a cell."""
RULES_TABLE = _FOLDER / "rules.csv"
"""A row a rule."""

"""The settings of a run that differ from the defaults."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from iceg.config import Config


def changed_settings(config: Config) -> list[dict[str, str]]:
    """Name, value and default of each setting that is not its default, in the order of `config.toml`."""
    return [
        {"name": name, "value": str(value), "default": str(default)}
        for (name, value), (_, default) in zip(_settings(config), _settings(Config()), strict=True)
        if value != default
    ]


def _settings(settings: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    for entry in fields(settings):
        value, name = getattr(settings, entry.name), f"{prefix}{entry.name}"
        if is_dataclass(value):
            yield from _settings(value, f"{name}.")
        else:
            yield name, value

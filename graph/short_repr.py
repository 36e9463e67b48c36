"""Records as one line for people: of long arrays and lists their sizes, of settings what differs from the defaults."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_SHOWN = 9
"""So many numbers are shown one by one: a pose and its covariance are."""
_MOST = 200
"""Characters of a list, a tuple or a dictionary."""


def short_repr(record: "DataclassInstance") -> str:
    """As the `__repr__` of a dataclass, but in a line however much it holds."""
    values = ((field.name, getattr(record, field.name)) for field in dataclasses.fields(record) if field.repr)
    return f"{type(record).__name__}({', '.join(f'{name}={_shown(value)}' for name, value in values)})"


def changed_repr(settings: "DataclassInstance") -> str:
    """As the `__repr__` of a dataclass of settings, but only of those that are not at their defaults."""
    changed = [
        f"{field.name}={value!r}"
        for field in dataclasses.fields(settings)
        if (value := getattr(settings, field.name)) != _default(field)
    ]
    return f"{type(settings).__name__}({', '.join(changed)})"


def _default(field: "dataclasses.Field[object]") -> object:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def _numbers(values: object) -> str:
    """Numbers in nested lists, as a line."""
    if isinstance(values, list):
        return f"[{', '.join(map(_numbers, values))}]"
    return f"{values:.6g}" if isinstance(values, float) else str(values)


def _shown(value: object) -> str:
    """A value in few characters."""
    if isinstance(value, np.ndarray) and value.size > _SHOWN:
        return f"<{' × '.join(map(str, value.shape))} {value.dtype}>"
    if isinstance(value, np.ndarray):
        return _numbers(value.tolist())
    if isinstance(value, list | tuple | dict) and (len(value) > _SHOWN or len(repr(value)) > _MOST):
        return f"<{type(value).__name__} of {len(value)}>"
    return repr(value)

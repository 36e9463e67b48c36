"""The list of kernels that runs call, each with the types of its arguments, as plain data."""

import json
import re
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, get_args

from numba import from_dtype, types

from iceg.slam.progress import Stage

SIGNATURES = Path(__file__).with_name("signatures.json")
"""Kernel by kernel; `python -m iceg.kernels.record` writes it anew."""
_ARRAY = re.compile(r"([\w.]+)\[(\d)([CFA])( readonly)?\]")
_RECORDS = ("iceg.maps.landmark_arrays.FEATURE", "iceg.maps.landmark_arrays.LANDMARK")
"""Where the structured types of arrays are that kernels take."""
STAGES = ("reading", *get_args(Stage), "writing")
"""Of a run, in order."""


class Kernel(NamedTuple):
    """A compiled function, for arguments of given types.

    Attributes:
        stage: of a run, that calls it first.
        module: where it is.
        name: of the function there.
        arguments: types as plain data: "float64", "float64[2C]", "uint8[1C readonly]", "module.DTYPE[1C]", a list for a
            tuple, {"module.Class": list} for a named one.
    """

    stage: str
    module: str
    name: str
    arguments: Sequence[Any]

    def compile(self) -> None:
        """Compile it, or load it where that was done before.

        Raises:
            AttributeError, TypeError, ValueError, numba.core.errors.NumbaError: there is no such kernel any more.
        """
        getattr(import_module(self.module), self.name).compile(tuple(map(type_of, self.arguments)))


@cache
def listed_kernels() -> list[Kernel]:
    """All kernels of the list; those of one module are neighbours."""
    return [Kernel(*row) for row in json.loads(SIGNATURES.read_text(encoding="utf-8"))]


def type_of(plain: Any) -> Any:  # noqa: ANN401
    """The type that numba has for what the list says.

    Raises:
        AttributeError, TypeError, ValueError: it says nothing that is known.
    """
    if isinstance(plain, list):
        return _tuple([type_of(item) for item in plain])
    if isinstance(plain, dict):
        ((place, items),) = plain.items()
        module, name = place.rsplit(".", 1)
        fields = [type_of(item) for item in items]
        return _tuple(fields, getattr(import_module(module), name))
    if array := _ARRAY.fullmatch(plain):
        scalar, n_axes, layout, readonly = array.groups()
        array_type: Any = types.Array
        dtype = _record(scalar) if "." in scalar else getattr(types, scalar)
        return array_type(dtype, int(n_axes), layout, readonly=bool(readonly))
    found = types.boolean if plain == "bool" else getattr(types, plain)
    if not isinstance(found, types.Type):
        raise TypeError(f"found {plain!r}, expected the name of a type")
    return found


def _record(place: str) -> types.Type:
    """The type of what an array of a structured type holds."""
    module, name = place.rsplit(".", 1)
    made: types.Type = from_dtype(getattr(import_module(module), name))
    return made


def _tuple(fields: Sequence[types.Type], named: type | None = None) -> Any:  # noqa: ANN401
    from_types: Any = types.BaseTuple.from_types
    return from_types(fields, named)


def plain_type(given: Any) -> Any:  # noqa: ANN401
    """What the list says for a type of numba's.

    Raises:
        ValueError: the list has no words for it.
    """
    if isinstance(given, types.BaseTuple):
        every: Any = given
        fields = [plain_type(item) for item in every]
        named = getattr(given, "instance_class", tuple)
        return fields if named is tuple else {f"{named.__module__}.{named.__qualname__}": fields}
    if isinstance(given, types.Array):
        dtype = _place_of(given.dtype) if isinstance(given.dtype, types.Record) else given.dtype
        return f"{dtype}[{given.ndim}{given.layout}{'' if given.mutable else ' readonly'}]"
    if isinstance(given, types.Number | types.Boolean):
        return str(given)
    raise ValueError(f"found {given}, expected numbers, arrays and tuples of them")


def _place_of(record: types.Record) -> str:
    for place in _RECORDS:
        if _record(place) == record:
            return place
    raise ValueError(f"found {record}, expected one of {', '.join(_RECORDS)}")

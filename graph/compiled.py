"""How inner loops are compiled."""

import logging
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numpy as np
from llvmlite import binding as llvm
from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.runtime.nrt import rtsys

_Function = TypeVar("_Function", bound=Callable[..., Any])
_compile: Any = njit  # its types know only some of the options
_called = _compile(error_model="numpy", no_cfunc_wrapper=True)
_called_aside = _compile(error_model="numpy", no_cfunc_wrapper=True, nogil=True)
_within = _compile(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True)


def compiled(function: _Function) -> _Function:
    """Decorator of a compiled function.

    It is kept on disk for the next run, where that can be written: beside the source, in the folder of the user's
    caches, or where `NUMBA_CACHE_DIR` says. Division by zero gives infinity or NaN, as in NumPy: Python's check of
    every divisor would cost a tenth of the time to compile.

    A name that begins with an underscore is for other compiled functions, which are kept with what they call: it is
    not kept itself, and Python cannot call it. That saves a sixth of the time to compile. Any other is for Python
    alone.
    """
    if function.__name__.startswith("_"):
        return cast("_Function", _within(function))
    return _kept(function, _called, _OnDisk)


def compiled_for_both(function: _Function) -> _Function:
    """The same for what Python calls and other compiled functions, too."""
    return _kept(function, _called, _OnDiskForBoth)


def compiled_aside(function: _Function) -> _Function:
    """The same for a long loop that a thread runs while others go on: it leaves the interpreter to them."""
    return _kept(function, _called_aside, _OnDisk)


def _kept(function: _Function, compile_it: Callable[[_Function], Any], place: Any) -> _Function:  # noqa: ANN401
    found = compile_it(function)
    if found is not function:  # it is where NUMBA_DISABLE_JIT says so
        try:
            found._cache = place(function)  # noqa: SLF001 what `cache=True` does
        except RuntimeError:
            _warn()
    return cast("_Function", found)


class _OnDiskForBoth(FunctionCache):
    """Where a compiled function is kept, loaded without what only compiling needs.

    Numba's own makes its target ready to compile first, which imports all that it knows of NumPy, and with that
    scipy.linalg, f2py and a parser of C: 0.4 of the 3.4 s that a run of the embedded log takes.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        """Keep it until its file changes or one of those that it calls; Numba's own looks at the first alone."""
        cast("Any", super()).__init__(function)
        kept = cast("Any", self)._cache_file  # noqa: SLF001
        kept._source_stamp = (kept._source_stamp, _stamp(function.__module__))  # noqa: SLF001

    def load_overload(self, sig: object, target_context: object) -> Any:  # noqa: ANN401 numba's own, which has no types
        """What was compiled for a signature; None where nothing is kept, and numba compiles."""
        rtsys.initialize(target_context)  # arrays that compiled functions make live by its counts
        with self._guard_against_spurious_io_errors():
            return cast("Any", self._load_overload)(sig, target_context)


@cache
def _stamp(module: str) -> tuple[tuple[str, int, int], ...]:
    """Name, time and size of the files of a module of kernels, of all whose kernels it calls, and of this one."""
    called, new = {__name__}, {module}
    while new:
        called |= new
        named = {getattr(value, "__module__", None) or getattr(value, "__name__", None) for value in _globals(new)}
        new = {name for name in named if isinstance(name, str) and name.endswith("_kernels")} - called
    files = {name: Path(getattr(sys.modules[name], "__file__", None) or "") for name in called}
    stats = {name: file.stat() for name, file in files.items() if file.is_file()}  # none of what is typed in, or zipped
    return tuple((name, stat.st_mtime_ns, stat.st_size) for name, stat in sorted(stats.items()))


def _globals(modules: set[str]) -> list[object]:
    """What modules define and import."""
    return [value for module in modules for value in vars(sys.modules[module]).values()]


class _MachineCode(CompileResultCacheImpl):
    """What is kept of a function that no other compiled one calls: these would need it in LLVM's language.

    To read that takes longer than all else that loading does: 0.2 of the 3 s that a run of the embedded log takes.
    """

    def reduce(self, cres: Any) -> Any:  # noqa: ANN401 numba's own, which has no types
        """The machine code of a compiled function, and the name by which Python enters it."""
        match cast("Any", super()).reduce(cres):
            case [(name, "object", (code, _)), *others]:
                entry = f'define available_externally void @"{cres.fndesc.llvm_cpython_wrapper_name}"() {{ ret void }}'
                return ((name, "object", (code, llvm.parse_assembly(entry).as_bitcode())), *others)
            case kept_otherwise:  # by another version of numba
                return kept_otherwise


class _OnDisk(_OnDiskForBoth):
    _impl_class: Any = _MachineCode


@cache
def _warn() -> None:
    """Once, not for every kernel."""
    logging.getLogger(__name__).warning(
        "compiled kernels cannot be kept, each run compiles them: set NUMBA_CACHE_DIR to a folder that can be written"
    )


ZERO: Final = cast("int", np.int64(0))
"""A zero that is a number among others to a compiled function which hands it to the next …"""
ONE: Final = cast("int", np.int64(1))
"""… and such a one: for a literal, numba would compile the called function once more, for this very number."""

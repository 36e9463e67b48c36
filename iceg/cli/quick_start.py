"""What the command line, whose process is its own, leaves out when it starts."""

import sys
from importlib import import_module
from typing import Any

_KNOWN_NUMBA = ("0.68.",)
"""Versions whose insides are as `load_kernels_lightly` takes them to be."""


def load_numba_without_scipy() -> None:
    """Load now what numba loads with the first function, while SciPy's linear algebra cannot be found.

    It would load all of `scipy.linalg` only to learn whether BLAS is there for `np.convolve` and `np.correlate`, which
    take a plain loop without it: a sixth of a second of every start. Compiled `np.dot` and `np.linalg` look for BLAS
    and LAPACK again when they are used.
    """
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401
    except ImportError:
        pass  # not where numba asks any more
    finally:
        del sys.modules["scipy.linalg"]


def load_kernels_lightly() -> None:
    """Load compiled functions from their cache in a third of the time: .13 s less of every start.

    Beside the code of a function, its cache holds what building it into others needs. numba reads that with each; here
    it waits until something that calls the function is compiled. Left out, too: telling nobody of each of thousands of
    calls to LLVM, looking through all of numba's tables 250 times at first, and a trial file for each function in the
    folder of its cache, where one tells whether it can be written.
    """
    import numba

    if not numba.__version__.startswith(_KNOWN_NUMBA):
        return
    from llvmlite import binding as llvm
    from numba.core.registry import cpu_target

    llvm.ffi.lib._lock._cblist.clear()  # noqa: SLF001
    context = cpu_target.target_context
    context.refresh = lambda: None  # which it asks of itself over and over
    type(context).refresh(context)
    del context.refresh
    context.codegen()._library_class = _light_library()  # noqa: SLF001
    _try_folders_once()


def _try_folders_once() -> None:
    locator: Any = import_module("numba.core.caching")._CacheLocator  # noqa: SLF001
    try_folder, good = locator.ensure_cache_path, set()

    def try_once(self: Any) -> None:  # noqa: ANN401
        folder = self.get_cache_path()
        if folder not in good:
            try_folder(self)
            good.add(folder)

    locator.ensure_cache_path = try_once


def _light_library() -> type:
    """What holds a compiled function, with the part that only others need read when they do."""
    from llvmlite import binding as llvm

    insides: Any = import_module("numba.core.codegen")
    nothing = llvm.parse_assembly("").as_bitcode()

    class LightLibrary(insides.JITCodeLibrary):  # type: ignore[misc]
        code, unread = b"", b""

        @classmethod
        def _unserialize(cls, codegen: object, state: tuple[str, str, tuple[bytes, bytes]]) -> "LightLibrary":
            name, kind, (code, bitcode) = state
            library: LightLibrary = super()._unserialize(codegen, (name, kind, (code, nothing)))
            library.code, library.unread = code, bitcode
            return library

        def get_pointer_to_function(self, name: str) -> int:
            if f"{name}\0".encode() in self.code:  # its table of symbols; numba asks the other part
                return int(self.codegen._engine.get_function_address(name))  # noqa: SLF001
            return int(super().get_pointer_to_function(name))

        def _get_module_for_linking(self) -> object:
            if self.unread:
                self._shared_module, self.unread = llvm.parse_bitcode(self.unread), b""
            return super()._get_module_for_linking()

    return LightLibrary

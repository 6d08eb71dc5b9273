"""The one place for compiler options.

Every kernel releases the interpreter lock and is cached on disk, where there is a place for that. None is parallel: a
`prange` kernel called from two threads aborts the process, and the caller decides where work runs. None uses
fastmath: the same bits are wanted from every split of the work.
"""

import functools
import os
import threading
from collections.abc import Callable
from typing import Any

PURE_PYTHON = any(os.environ.get(name, "") not in ("", "0") for name in ("HELIOSWEEP_PURE_PYTHON", "NUMBA_DISABLE_JIT"))
"""True when kernels run as plain Python: slow, but a debugger can step through them."""

_KERNELS: list[Any] = []
_MAKING = threading.RLock()
UNCACHED: list[str] = []
"""Kernels that every process compiles anew, because no folder for compiled code can be written."""


def kernel(function: Any = None, **options: Any) -> Any:
    """Compile a function on its first call; with options of numba it returns a decorator."""
    if function is None:
        return functools.partial(kernel, **options)
    return _late(function, _nrt=True, **options)  # said outright: what an `inner` calls would take its setting from it


def inner(function: Any = None, **options: Any) -> Any:
    """Compile a function that makes no array and returns none: it counts no references to those it is given.

    Counting costs an atomic operation or two for every array of every call: more than the work of many a call.
    """
    if function is None:
        return functools.partial(inner, **options)
    return _late(function, _nrt=False, **options)


def apart(function: Callable[..., Any]) -> Any:
    """Compile an `inner` function that another process may compile meanwhile: it has a place in the cache by itself."""
    return _late(function, _nrt=False, apart=True)


def inline(function: Callable[..., Any]) -> Any:
    """Compile a function into each of its callers.

    For the small bodies of lane loops: a call would keep a loop from becoming vector code.
    """
    return _late(function, forceinline=True, _nrt=False)


def compilations() -> int:
    """Number of times that this process compiled a kernel rather than loading it from disk."""
    return sum(sum(each.stats.cache_misses.values()) for each in _KERNELS)


def _late(function: Callable[..., Any], **options: Any) -> Any:
    return function if PURE_PYTHON else _Kernel(function, {"nogil": True, "error_model": "numpy", **options})


class _Kernel:
    """A kernel that numba is imported for where it is first called, or compiled into another: a plan calls none.

    Everything else that it is asked for is that of the dispatcher, numba's face of a compiled function.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options, self._made = function, options, None

    def __call__(self, *args: Any) -> Any:
        return self._dispatcher()(*args)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._dispatcher(), name)

    @property
    def _numba_type_(self) -> Any:
        """What the compiler takes it for where another kernel calls it."""
        return self._dispatcher()._numba_type_

    def _dispatcher(self) -> Any:
        """The dispatcher, the same for all threads; no property, whose AttributeError would ask `__getattr__`."""
        if self._made is None:
            with _MAKING:
                self._made = self._made or _compiled(self._function, self._options)
        return self._made


def _compiled(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    import numba

    from heliosweep.kernels.machine_code import CodeCache, PartCache, compile_in_parts

    apart = options.pop("apart", False)
    make: Any = numba.njit  # its types tell of fewer options
    options |= {"no_cfunc_wrapper": True}  # C calls none of them
    compiled, part = make(function, **options), make(function, no_cpython_wrapper=True, **options)
    try:
        compiled._cache = CodeCache(function)
        if apart:
            part._cache = PartCache(function)
    except RuntimeError:  # there is no folder that compiled code could be written to
        UNCACHED.append(function.__name__)
    compile_in_parts(compiled, part)
    _KERNELS.append(compiled)
    return compiled

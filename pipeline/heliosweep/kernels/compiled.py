"""Compiler options of all kernels, and cache folder of the compiled code.

Kernels release the global interpreter lock. They do not use `prange`, because calling a `prange` kernel from two
threads aborts the process. Kernels do not reorder sums, so results do not depend on how the work is split.
"""

import contextlib
import functools
import hashlib
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: True if kernels run as plain Python. Plain Python is slow, but a debugger can step through it.
PURE_PYTHON = any(os.environ.get(name, "") not in ("", "0") for name in ("HELIOSWEEP_PURE_PYTHON", "NUMBA_DISABLE_JIT"))

_COMPILED: list[Any] = []
_LOCK = threading.RLock()
#: Names of kernels that are not cached because no cache folder is writable.
UNCACHED: list[str] = []


def kernel(function: Any = None, /, **options: Any) -> Any:
    """Compile a function on its first call. If called with numba options, return a decorator."""
    if function is None:
        return functools.partial(kernel, **options)
    return function if PURE_PYTHON else _Kernel(function, options)


def inner(function: Any = None, /, **options: Any) -> Any:
    """Compile a function that only kernels call and that neither creates nor returns arrays.

    The compiled function does not count references to its arrays, because counting would take longer than many of the
    calls. If called with numba options, return a decorator.
    """
    return kernel(function, no_cpython_wrapper=True, _nrt=False, **options)


def inline(function: Callable[..., Any]) -> Any:
    """Inline a function into each caller, so that the loops of the caller are vectorised."""
    return inner(function, forceinline=True)


def compilations() -> int:
    """Return the number of kernels that this process compiled instead of loading them from the cache."""
    return sum(sum(each.stats.cache_misses.values()) for each in _COMPILED)


@contextlib.contextmanager
def on_compilation(report: Callable[[], None]) -> Iterator[None]:
    """Call `report` when the first kernel is compiled, but not when kernels are loaded from the cache."""
    from numba.core import event

    reports = [report]

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            while reports:
                reports.pop()()

        on_end = on_start

    with event.install_listener("numba:compile", Listener()):
        yield


def cache_folder() -> Path:
    """Return the cache folder of compiled kernels, named after a digest of their source files.

    The digest is needed because numba's cache does not detect changes in the kernels that a cached kernel calls.
    """
    base = os.environ.get("NUMBA_CACHE_DIR") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    return Path(base, "heliosweep-kernels", _digest())


@functools.cache
def _digest() -> str:
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


class _Kernel:
    """Kernel that imports numba (0.3 s) only when it is first called or compiled into another kernel."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._options = function, options

    def __call__(self, *args: Any) -> Any:
        """Call the compiled function, or the plain Python function if it was declared with `inner`."""
        return self.py_func(*args) if "_nrt" in self._options else self.dispatcher(*args)

    @property
    def _numba_type_(self) -> Any:
        """Numba type of this kernel, used when another kernel calls it."""
        return self.dispatcher._numba_type_

    @functools.cached_property
    def dispatcher(self) -> Any:
        """Numba dispatcher that compiles the function."""
        with _LOCK:
            return self.__dict__.get("dispatcher") or _compiled(self.py_func, self._options)


def _compiled(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    import numba

    from heliosweep.kernels.machine_code import compile_in_parts

    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
    make: Any = numba.njit  # the type stubs of numba lack some options
    if "_nrt" in options:
        whole = part = make(function, **options)
    else:
        part = make(function, no_cpython_wrapper=True, _nrt=True, **options)
        config: Any = numba.config
        before = config.CACHE_DIR
        try:
            config.CACHE_DIR = str(cache_folder())
            whole = make(function, cache=True, _nrt=True, **options)
        except RuntimeError:  # no cache folder is writable, or the user has no home folder
            UNCACHED.append(function.__name__)
            whole = make(function, _nrt=True, **options)
        finally:
            config.CACHE_DIR = before
    compile_in_parts(whole, part)
    _COMPILED.append(whole)
    return whole

"""The one place for compiler options.

Every kernel releases the interpreter lock and is cached on disk, where there is a place for that. None is parallel: a
`prange` kernel called from two threads aborts the process, and the caller decides where work runs. None uses
fastmath: the same bits are wanted from every split of the work.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from heliosweep.kernels.parts import compile_in_parts, few_passes

__all__ = ["PURE_PYTHON", "UNCACHED", "inline", "inner", "kernel", "processor"]

PURE_PYTHON = any(os.environ.get(name, "") not in ("", "0") for name in ("HELIOSWEEP_PURE_PYTHON", "NUMBA_DISABLE_JIT"))
"""True when kernels run as plain Python: slow, but a debugger can step through them."""

UNCACHED: list[str] = []
"""Kernels that every process compiles anew, because no folder for compiled code can be written."""

_KEPT = 4
"""Versions of the kernel sources whose compiled code is kept: each takes 20 MB, and every edit makes another one."""


def _fingerprint() -> str:
    """Digest of the kernel sources.

    The compiler's cache notices a change of the file that holds a kernel, but not of the kernels that this one calls;
    with the digest in the name, no kernel outlives an edit of any other.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


_FINGERPRINT = _fingerprint()


@cache
def processor() -> str:
    """Digest of the processor that kernels are compiled for: part of every kernel's name.

    The compiler's cache tells processors apart, but numbers its files by what it saw before: two that share it and
    fill it at the same time would write to the same file, and one run the other's instructions.
    """
    from numba.core.registry import cpu_target

    target = cpu_target.target_context.codegen().magic_tuple()
    return hashlib.sha256(repr(target).encode()).hexdigest()[:6]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function on its first call."""
    return _compiled(function, _nrt=True)  # said outright: what an `inner` calls would take its setting from it


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no array and returns none: it counts no references to those it is given.

    Counting costs an atomic operation or two for every array of every call: more than the work of many a call.
    """
    return _compiled(function, _nrt=False)


def inline(function: Callable[..., Any]) -> Any:
    """Compile a function into each of its callers.

    For the small bodies of lane loops: a call would keep a loop from becoming vector code.
    """
    return _compiled(function, forceinline=True, _nrt=False)


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if PURE_PYTHON:
        return function
    import numba

    function.__qualname__ += f"-{_FINGERPRINT}-{processor()}"
    options |= {"nogil": True, "error_model": "numpy"} | few_passes()
    try:
        compiled = _written_in_turn(numba.njit(function, cache=True, **options))
    except RuntimeError:  # there is no folder that numba could write compiled code to
        UNCACHED.append(function.__name__)
        compiled = numba.njit(function, **options)
    make: Any = numba.njit  # the two options are not among those that its types tell of
    compile_in_parts(compiled, make(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options))
    return compiled


def _written_in_turn(dispatcher: Any) -> Any:
    """Let one process at a time write to the cache of compiled code, where the system has locks of files.

    Two that compiled one function for arguments of different types at the same time could give two files one name,
    and a later process would run the code of the other types.
    """
    if sys.platform == "win32":
        return dispatcher
    import fcntl

    cache = dispatcher._cache._cache_file
    save = cache.save

    def save_alone(key: Any, data: Any) -> None:
        with Path(cache._cache_path, ".lock").open("ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            _remove_stale(cache._cache_path)
            save(key, data)

    cache.save = save_alone
    return dispatcher


@cache
def _remove_stale(folder: str) -> None:
    """Remove compiled code of all but the last versions of the sources, once; who still needs some compiles it anew."""
    versions: dict[str, list[tuple[float, Path]]] = {}
    with suppress(OSError):  # another machine's, which shares the folder and removes the same
        for path in Path(folder).glob("*.nb[ic]"):
            if found := re.search(r"-([0-9a-f]{12})-", path.name):
                versions.setdefault(found[1], []).append((path.stat().st_mtime, path))
        versions.pop(_FINGERPRINT, None)
        for files in sorted(versions.values(), key=max, reverse=True)[_KEPT - 1 :]:
            for _, path in files:
                path.unlink(missing_ok=True)

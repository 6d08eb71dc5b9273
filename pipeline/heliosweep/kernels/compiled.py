"""The one place for compiler options.

Every kernel releases the interpreter lock and is cached on disk. None is parallel: a `prange` kernel called from two
threads aborts the process, and the caller decides where work runs. None uses fastmath: the same bits are wanted
from every split of the work.
"""

import os
from collections.abc import Callable
from typing import Any

__all__ = ["PURE_PYTHON", "inline", "kernel"]

PURE_PYTHON = os.environ.get("HELIOSWEEP_PURE_PYTHON", "") not in ("", "0")
"""True when kernels run as plain Python: slow, but a debugger can step through them."""


def _same(function: Callable[..., Any]) -> Any:
    return function


if PURE_PYTHON:
    kernel: Callable[[Callable[..., Any]], Any] = _same
    inline: Callable[[Callable[..., Any]], Any] = _same
else:
    import numba

    _OPTIONS: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy"}
    kernel = numba.njit(**_OPTIONS)
    # Arguments that are slices cost reference counting in a real call; small lane loops are worth the copy of code.
    inline = numba.njit(**_OPTIONS, forceinline=True)

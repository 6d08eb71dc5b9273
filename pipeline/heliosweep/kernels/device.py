"""Compile the functions of a kernel for a GPU, and run the kernel on the GPU.

All threads of a thread block work on the same block of rays. The functions `lane`, `lanes`, `barrier` and `add` of a
kernel's module are replaced by versions for the device. All other code is shared by the CPU and the GPU.
"""

import dis
import inspect
import os
import threading
import types
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np

# Placeholders for global variables that `_device_kernel` sets in the device versions of the functions below.
cuda: Any = None
work: Any = None
floats: tuple[int, int, int] = (0, 0, 0)
threads = 0

#: Lock that allows only one chunk at a time to use the device. The first chunk compiles the kernel.
_LOCK = threading.Lock()


def device_problem() -> str | None:
    """Return the reason why no GPU can be used and a remedy, or None if a GPU is available."""
    if not find_spec("numba_cuda") and os.environ.get("NUMBA_ENABLE_CUDASIM", "0") in ("", "0"):
        return "needs the package numba-cuda: install 'heliosweep[gpu]', or use device: cpu"
    os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")
    from numba import cuda

    if cuda.is_available():
        return None
    return "finds no NVIDIA GPU with a driver: check nvidia-smi and install 'heliosweep[gpu]', or use device: cpu"


def lane() -> Any:
    """Return the index of this thread in its thread block."""
    return cuda.threadIdx.x


def lanes() -> Any:
    """Return the number of threads in a thread block."""
    return cuda.blockDim.x


def barrier() -> None:
    """Wait for all threads of the thread block."""
    cuda.syncthreads()


def add(array: Any, index: Any, value: Any) -> None:
    """Add a value atomically to an array element that several threads share."""
    cuda.atomic.add(array, index, value)


def _run(problem: Any, sums: Any, cells: Any, whole: Any, found: Any, frames: Any, stamp: Any) -> None:
    """Run `work` in one thread block, with separate scratch arrays for each block."""
    at = cuda.blockIdx.x
    r = cuda.shared.array(floats[0], np.float32)
    f = cuda.shared.array(floats[1], np.float32)
    cell = cuda.shared.array(threads, np.int32)
    counts = cuda.shared.array(floats[2], np.float64)
    work(at, cuda.gridDim.x, problem, sums, cells, whole, r, cell, counts, f, found[at], frames[at], stamp[at])


@cache
def _device_kernel(function: Any, floats: tuple[int, int, int], threads: int) -> Any:
    """Compile a function for the device, and return a kernel that runs it."""
    from numba import cuda

    names = {"cuda": cuda, "floats": floats, "threads": threads}

    def compiled(part: Any) -> Any:
        """Compile a function after the functions that it calls."""
        source = getattr(part, "py_func", part)
        for name in (each.argval for each in dis.get_instructions(source) if each.opname == "LOAD_GLOBAL"):
            called = source.__globals__.get(name)
            if name not in names and (hasattr(called, "py_func") or inspect.isfunction(called)):
                names[name] = compiled(called)
        return cuda.jit(device=True, fastmath=True)(
            types.FunctionType(source.__code__, {**source.__globals__, **names})
        )

    for each in (lane, lanes, barrier, add):
        names[each.__name__] = compiled(each)
    names["work"] = compiled(function)
    return cuda.jit(types.FunctionType(_run.__code__, {**_run.__globals__, **names}))


def run_on_device(
    function: Any, floats: tuple[int, int, int], lanes: int, problem: tuple[Any, ...], bodies: int, pairs: int,
    sums: Any, cells: Any, whole: Any,
) -> None:  # fmt: skip
    """Run a function on the device, and add its results to the output arrays.

    Parameters
    ----------
    function : function
        Function to run. It is compiled for the device together with the functions that it calls.
    floats, lanes : (int, int, int), int
        Sizes of the three shared arrays (scratch, constants and counts), and number of rays in a block.
    problem : tuple
        Input arrays and numbers of the function.
    bodies, pairs : int
        Number of heliostats in the field, and number of heliostat-instant pairs to trace.
    sums, cells, whole : ndarray
        Arrays to which the results are added.
    """
    from numba import cuda

    # at most 1 GiB: each thread block needs 120 bytes for each heliostat of the field
    blocks = int(max(1, min(4096, pairs, 2**30 // (120 * bodies))))
    with _LOCK:
        given = tuple(cuda.to_device(each) if isinstance(each, np.ndarray) else each for each in problem)
        found, frames = cuda.device_array((blocks, bodies), np.int64), cuda.device_array((blocks, bodies, 12))
        stamp = cuda.to_device(np.full((blocks, bodies), -1))
        kernel = _device_kernel(function, floats, lanes)
        kernel[blocks, lanes](given, sums, cells, whole, found, frames, stamp)
        cuda.synchronize()

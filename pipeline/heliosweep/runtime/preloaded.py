"""What every worker process needs: the process that they are forked from imports it once, before any is there."""

import gc

import distributed  # noqa: F401
import xarray  # noqa: F401
from numba.core.registry import cpu_target

from heliosweep.runtime.preloading import USUAL

# What numba does at the first call of a kernel: 0.25 s.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
gc.freeze()  # or each worker's collector would write to, and so copy, the memory that they share
gc.set_threshold(*USUAL)

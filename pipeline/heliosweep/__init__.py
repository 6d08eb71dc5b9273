"""Batch studies of solar-concentrator tracking and optics: one YAML file in, one NetCDF data set out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = [
    "HeliosweepError",
    "PlanError",
    "RunInterrupted",
    "StudyError",
    "__version__",
    "build",
    "load",
    "open_result",
    "plan",
    "run",
    "status",
]

if TYPE_CHECKING:
    from heliosweep.errors import HeliosweepError, PlanError, RunInterrupted, StudyError
    from heliosweep.workflow import build, load, open_result, plan, run, status

_ERRORS = ("HeliosweepError", "PlanError", "RunInterrupted", "StudyError")


def __getattr__(name: str) -> Any:
    """Import public names when they are first used, so that the command line answers at once."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'errors' if name in _ERRORS else 'workflow'}"), name)


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return __all__

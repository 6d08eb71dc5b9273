"""Batch studies of solar-concentrator tracking and optics, from a YAML file to a NetCDF data set."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.2.0"
#: Module that defines each public name, as listed in `__init__.pyi`.
_MODULES = {
    words[3]: words[1]
    for words in map(str.split, Path(__file__).with_suffix(".pyi").read_text("utf-8").splitlines())
    if words[:1] == ["from"]
}
__all__ = ["__version__", *sorted(_MODULES)]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that the command line starts quickly."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def _accessor(dataset: Any) -> Any:
    return import_module(f"{__name__}.accessor").HeliosweepAccessor(dataset)


if "xarray" in sys.modules and not hasattr(sys.modules["xarray"].Dataset, "heliosweep"):
    # If xarray is already imported, register the accessor now. Importing xarray here would be slow.
    sys.modules["xarray"].register_dataset_accessor("heliosweep")(_accessor)


def __dir__() -> list[str]:
    """List all public names, including those that are not imported yet."""
    return __all__

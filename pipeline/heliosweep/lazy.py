"""Libraries that are slow to import. Each library is imported when one of its names is first used."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["netCDF4", "pd", "pvlib", "scipy", "shapely", "xr"]


class _Lazy:
    """Placeholder for a module that is imported on first use."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


if TYPE_CHECKING:
    import netCDF4
    import pandas as pd
    import pvlib
    import scipy
    import shapely
    import xarray as xr
else:
    netCDF4, pd, pvlib, scipy, shapely, xr = map(_Lazy, ("netCDF4", "pandas", "pvlib", "scipy", "shapely", "xarray"))

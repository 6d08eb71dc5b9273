"""Versions of what the numbers of a result depend on besides the study: code of this package, and libraries."""

from __future__ import annotations

from functools import cache
from importlib import metadata

from heliosweep.sources import numbers_digest

#: How values are stored.
_ENCODING = "heliosweep.store.encoding"
#: Packages that numbers go through; xarray and dask only carry them.
_LIBRARIES = ("numpy", "numba", "llvmlite", "scipy", "pandas", "pvlib", "astropy", "pillow", "tzdata")


@cache
def code_versions(*modules: str) -> dict[str, str]:
    """Version of everything that can change a number.

    Parameters
    ----------
    *modules : str
        Names of the modules that compute a family's numbers.

    Returns
    -------
    dict
        ``heliosweep``: digest of the code of these modules and of all that they import from this package and their
        own; the others: versions of the libraries.
    """
    digest = numbers_digest(*modules, _ENCODING)
    return {"heliosweep": digest[:16], **{name: _version(name) for name in _LIBRARIES}}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"

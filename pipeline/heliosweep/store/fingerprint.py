"""What the numbers of a result depend on besides the study: this package's code and the libraries it computes with."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from pathlib import Path

#: Folders of the package whose code no number depends on.
_WORDS = ("pack", "report", "runtime", "store")
#: But how values are stored.
_ENCODING = "store/encoding.py"
#: Packages that numbers go through; xarray and dask only carry them.
_LIBRARIES = ("numpy", "numba", "llvmlite", "scipy", "pandas", "pvlib", "astropy", "pillow", "tzdata")


@cache
def code_versions() -> dict[str, str]:
    """Version of everything that can change a number: libraries by version, the package's sources by their digest."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        place = source.relative_to(package)
        if (len(place.parts) > 1 and place.parts[0] not in _WORDS) or place.as_posix() == _ENCODING:
            digest.update(place.as_posix().encode() + b"\0" + source.read_bytes())
    return {"heliosweep": digest.hexdigest()[:16], **{name: _version(name) for name in _LIBRARIES}, **_families()}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"


def _families() -> dict[str, str]:
    """Versions of the other packages that add study families."""
    entries = metadata.entry_points(group="heliosweep.families")
    return {entry.dist.name: entry.dist.version for entry in entries if entry.dist and entry.dist.name != "heliosweep"}

"""Digest of the source files that affect computed values, and versions of the libraries that these files use."""

from __future__ import annotations

import hashlib
import importlib.util
import re
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

_PACKAGE = Path(__file__).parent
#: Folders and modules of the package that do not affect computed values.
_OTHERS = {"report", "share", "store", "runs", "search"}
_OTHERS |= {f"{name}.py" for name in ("__main__", "accessor", "api", "cli", "commands", "errors", "files")}


@cache
def code_versions(*modules: str) -> dict[str, str]:
    """Return a source digest and the versions of the libraries that affect computed values.

    The digest covers this package and the packages that contain the given modules.
    """
    folders = {_PACKAGE}
    for name in modules:
        package = name.partition(".")[0]
        if package != _PACKAGE.name and (spec := importlib.util.find_spec(package)) and spec.origin:
            folders.add(Path(spec.origin).parent if spec.submodule_search_locations else Path(spec.origin))
    digest = source_digest(*sorted(folders))
    # xarray and dask are omitted because they only store values.
    libraries = ("numpy", "numba", "llvmlite", "scipy", "pandas", "pvlib", "pillow", "tzdata")
    return {"heliosweep": digest[:16], **{name: version_of(name) or "missing" for name in libraries}}


def source_digest(*places: Path) -> str:
    """Return the SHA-256 digest of the Python files at the given paths, excluding those listed in `_OTHERS`."""
    digest = hashlib.sha256()
    for place in places:
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            if place != _PACKAGE or path.relative_to(place).parts[0] not in _OTHERS:
                digest.update(path.relative_to(place.parent).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def version_of(library: str) -> str | None:
    """Return the version of a library, or None if the library is not installed."""
    with suppress(metadata.PackageNotFoundError):
        return metadata.version(library)
    return None


def installed() -> dict[str, str]:
    """Return the versions of this package and of its installed direct and indirect dependencies."""
    found: dict[str, str] = {}
    waiting = [_PACKAGE.name]
    while waiting:
        if (name := waiting.pop()) in found:
            continue
        with suppress(metadata.PackageNotFoundError):
            package = metadata.distribution(name)
            text = package.read_text("METADATA") or package.read_text("PKG-INFO") or ""
            head = text.partition("\n\n")[0]  # reading `metadata.metadata` takes three times as long
            found[name] = "".join(re.findall(r"^Version: *(.*)", head, re.MULTILINE)[:1])
            needed = re.findall(r"^Requires-Dist: *([A-Za-z0-9._-]+)(?!.*extra ==)", head, re.MULTILINE)
            waiting += (required.lower().replace("_", "-") for required in needed)
    return dict(sorted(found.items()))

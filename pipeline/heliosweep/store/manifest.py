"""`manifest.json`: what a run was made with, how long it took and the digests of what it left."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from heliosweep.store.temporary import sync, temporary_name

#: Files of a result folder that describe its ``result.nc``, and go when another one takes its place.
DESCRIPTIONS = ("manifest.json", "study.resolved.yaml", "report.html", "comparison.csv")

#: Packages whose versions can touch the numbers or the bytes.
_PACKAGES = ("heliosweep", "numpy", "numba", "llvmlite", "xarray", "dask", "pandas", "netCDF4", "pvlib", "matplotlib")


def environment() -> dict[str, Any]:
    """Versions and machine of this process."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "commit": _commit(),
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Commit of the source tree that heliosweep was imported from, with ``-dirty`` where it was changed since."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None


def write_atomically(path: Path, text: str) -> None:
    """Write a text file so that it is there whole or not at all, for good; what is no text is written as an escape."""
    temporary = temporary_name(path)
    try:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
        sync(temporary)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_manifest(path: Path, content: Mapping[str, Any]) -> None:
    """Write the manifest as sorted, indented JSON."""
    record = {"command": [Path(sys.argv[0]).name, *sys.argv[1:]], **content}
    write_atomically(path, json.dumps(record, indent=2, sort_keys=True, ensure_ascii=False) + "\n")

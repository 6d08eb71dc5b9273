"""Why something could not be written, in words."""

from __future__ import annotations

import errno
import shutil
from pathlib import Path

from heliosweep.grid.limits import human_bytes

#: With less room than this, a write that failed did so because the disk is full. [bytes]
_FULL = 2**20


def why_not_written(path: Path, error: Exception) -> str:
    """Say why a file or folder could not be written, and how much room there is.

    Parameters
    ----------
    path : pathlib.Path
        What was to be written; it may be missing.
    error : OSError or RuntimeError
        What the system said, or a library that says less.

    Returns
    -------
    str
        As ``result.nc: cannot be written: disk full (12.3 kB free)``.
    """
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    cause = "disk full" if free < _FULL else getattr(error, "strerror", None) or error
    return f"{path}: cannot be written: {cause} ({human_bytes(free)} free{_limit(error)})"


def _limit(error: Exception) -> str:
    """The largest size of a file that the shell allows, where it can be the cause."""
    number = getattr(error, "errno", None)
    if number is not None and number > 0 and number != errno.EFBIG:
        return ""  # the system said something else; of a file too large, the NetCDF library says "HDF error"
    try:
        import resource
    except ImportError:  # pragma: no cover  # elsewhere there are no such limits
        return ""
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return "" if largest == resource.RLIM_INFINITY else f", files of at most {human_bytes(largest)} by ulimit -f"

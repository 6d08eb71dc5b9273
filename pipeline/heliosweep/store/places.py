"""Places in a result in words: dimensions with the labels of their coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.store.raw import Raw

#: What begins the units of every stored time.
_SINCE = "seconds since 1970-01-01"


class Places:
    """Names places of a result.

    Parameters
    ----------
    raw : Raw
        The result; its coordinates are read when they are needed.
    """

    def __init__(self, raw: Raw) -> None:
        self._raw = raw
        self._labels = cache(self._read)

    def at(self, dims: tuple[str, ...], position: tuple[int, ...]) -> str:
        """One place, as ``latitude 30 degrees_north, heliostat 17``."""
        return ", ".join(f"{dim} {self._label(dim, number)}" for dim, number in zip(dims, position, strict=True))

    def within(self, region: Mapping[str, slice]) -> str:
        """A region, as ``latitude 30 to 45 degrees_north``; dimensions that it spans whole are left out."""
        said = []
        for dim, span in region.items():
            if span == slice(0, self._raw.sizes[dim]):
                continue
            first, last = self._label(dim, span.start), self._label(dim, span.stop - 1)
            said.append(f"{dim} {first}" if span.stop - span.start == 1 else f"{dim} {first} to {last}")
        return ", ".join(said)

    def _label(self, dim: str, number: int) -> str:
        labels, units = self._labels(dim)
        return f"[{number}]" if labels is None else value_text(labels[number], units)

    def _read(self, dim: str) -> tuple[np.ndarray | None, str]:
        variable = self._raw.variables.get(dim)
        if variable is None or variable.dims != (dim,):
            return None, ""
        try:
            return self._raw.read(dim, (slice(0, variable.shape[0]),)), units_of(variable.attributes)
        except HeliosweepError:
            return None, ""


def units_of(attributes: Mapping[str, Any]) -> str:
    """Units of a variable as they stand behind a number; empty for those without."""
    units = str(attributes.get("units", ""))
    return "" if units == "1" else units


def value_text(value: Any, units: str = "") -> str:
    """One stored value with its unit; times as dates."""
    if isinstance(value, str):
        return repr(value)
    number = value.item() if isinstance(value, np.generic) else value
    if units.startswith(_SINCE):
        if not np.isfinite(number) or abs(number) > 9e9:
            return str(np.datetime64("NaT")) if np.isnan(number) else f"{number!r} s"
        time = np.datetime64(round(number * 1e3), "ms")
        return str(time).removesuffix(".000").removesuffix(":00")
    text = repr(number).removesuffix(".0")
    return f"{text} {units}" if units else text

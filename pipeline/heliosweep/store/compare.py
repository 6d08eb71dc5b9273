"""Comparison of two results by content: dimensions, attributes and values."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.store.manifest import changes
from heliosweep.store.read import locate, open_result, result_digest

#: Values of one block that is compared at a time.
_BLOCK = 2**21
#: Maximum length of an attribute in a message. [characters]
_LONGEST = 60
#: Global attributes that the study and the code imply.
_STUDY = "study"


@dataclass
class Comparison:
    """Result of a comparison.

    Parameters
    ----------
    a, b : pathlib.Path
        The results.
    same_bytes : bool
        True if the files are equal.
    differences : list of str
        One line for each difference; none if the content is the same.
    notes : list of str
        Differences that do not count, such as values within the tolerances.
    """

    a: Path
    b: Path
    same_bytes: bool = False
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """True if the content is the same."""
        return not self.differences

    @property
    def lines(self) -> list[str]:
        """Both paths, differences, notes and the verdict."""
        if self.same_bytes:
            verdict = "same bytes"
        elif self.same:
            verdict = f"same content{' within the tolerances' if self.notes else ', in other bytes'}"
        else:
            count = len(self.differences)
            verdict = f"{count} difference{'s' if count > 1 else ''}"
        return [f"A: {self.a}", f"B: {self.b}", *self.differences, *self.notes, verdict]

    @property
    def text(self) -> str:
        """The lines as one text."""
        return "\n".join(self.lines)


def compare(
    a: str | os.PathLike[str], b: str | os.PathLike[str], *, rtol: float = 0.0, atol: float = 0.0
) -> Comparison:
    """Compare two results by content.

    Parameters
    ----------
    a, b : path
        Result folders, NetCDF files or Zarr groups.
    rtol, atol : float
        Values are equal if they differ by at most ``atol + rtol * larger magnitude``. NaN equals NaN.

    Returns
    -------
    Comparison

    Raises
    ------
    StudyError
        If a path holds no result, or a tolerance is negative.
    HeliosweepError
        If a result is damaged.
    """
    if not (rtol >= 0 and atol >= 0):
        raise StudyError(Problem("tolerances must not be negative"))
    comparison = Comparison(locate(a), locate(b))
    with open_result(comparison.a) as one, open_result(comparison.b) as two:
        if comparison.a.suffix == comparison.b.suffix and result_digest(comparison.a) == result_digest(comparison.b):
            comparison.same_bytes = True
            return comparison
        for line in _differences(one, two, rtol, atol):
            (comparison.notes if line.endswith("within the tolerances") else comparison.differences).append(line)
    return comparison


def _differences(one: xr.Dataset, two: xr.Dataset, rtol: float, atol: float) -> Iterator[str]:
    """One line for each difference between two data sets."""
    for dim in _either(one.sizes, two.sizes):
        yield from _scalar(f"dimension {dim}", one.sizes.get(dim), two.sizes.get(dim))
    yield from _attributes("", one.attrs, two.attrs)
    for name in _either(one.variables, two.variables):
        if name not in one.variables or name not in two.variables:
            yield f"{name}: only in {'A' if name in one.variables else 'B'}"
            continue
        a, b = one[name], two[name]
        yield from _attributes(f"{name}: ", a.attrs, b.attrs)
        kinds = ["str" if item.dtype.kind in "OTU" else str(item.dtype) for item in (a, b)]
        if kinds[0] != kinds[1]:
            yield f"{name}: {kinds[0]} in A, {kinds[1]} in B"
        if a.dims != b.dims:
            yield f"{name}: over {a.dims} in A, over {b.dims} in B; values not compared"
        elif a.shape != b.shape or ("str" in kinds and kinds[0] != kinds[1]):
            yield f"{name}: values not compared: lengths or types differ"
        else:
            yield from _values(str(name), a, b, rtol, atol)


def _values(name: str, a: xr.DataArray, b: xr.DataArray, rtol: float, atol: float) -> Iterator[str]:
    """Lines about the values of two variables of the same shape, read in blocks along the first dimension."""
    rows = max(1, _BLOCK // max(1, a.size // max(1, a.shape[0]))) if a.ndim else 1
    beyond = within = nans = 0
    worst, where = -1.0, ""
    for start in range(0, a.shape[0] if a.ndim else 1, rows):
        block = {a.dims[0]: slice(start, start + rows)} if a.ndim else {}
        x, y = (item.isel(block).to_numpy() for item in (a, b))
        different = np.atleast_1d(np.asarray(x != y))
        if x.dtype.kind in "fM":
            missing_x, missing_y = (np.atleast_1d(np.isnan(values)) for values in (x, y))
            different &= ~(missing_x & missing_y)
            nans += int((missing_x ^ missing_y).sum())
        if not different.any():
            continue
        size = _distances(x, y)
        limit = atol + rtol * np.maximum(*(np.abs(_floats(values)) for values in (x, y)))
        outside = different & ~(size <= limit if atol or rtol else np.zeros(size.shape, bool))
        beyond += int(outside.sum())
        within += int((different & ~outside).sum())
        size = np.where(different, np.where(np.isnan(size), np.inf, size), -1.0)
        if size.max() > worst:
            worst, place = float(size.max()), np.unravel_index(int(size.argmax()), size.shape)
            where = _place(a.isel(block), place, np.atleast_1d(x)[place], np.atleast_1d(y)[place])
    if not beyond and not within:
        return
    alone = f", {nans:,} of them NaN in one alone" if nans else ""
    largest = "" if a.dtype.kind in "OTU" or not np.isfinite(worst) else f" {worst:.6g} {_units(a)}".rstrip()
    text = f"{name}: {beyond or within:,} of {a.size:,} values differ{alone}; largest difference{largest}: {where}"
    yield text if beyond else f"{text}; within the tolerances"


def _floats(values: np.ndarray) -> np.ndarray:
    """Values as numbers of at least one dimension: times in seconds, text as zeros."""
    if values.dtype.kind == "M":
        values = np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)
    return np.atleast_1d(np.zeros(values.shape) if values.dtype.kind in "OTU" else values.astype(np.float64))


def _distances(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Absolute differences; infinite between texts."""
    if x.dtype.kind in "OTU":
        return np.full(np.atleast_1d(x).shape, np.inf)
    with np.errstate(all="ignore"):
        return np.abs(_floats(x) - _floats(y))


def _place(block: xr.DataArray, place: tuple[Any, ...], x: Any, y: Any) -> str:
    """Both values and the coordinates of one place."""
    labels = ", ".join(
        f"{dim} {block[dim].to_numpy()[at] if dim in block.coords else at}"
        for dim, at in zip(block.dims, place, strict=False)
    )
    values = [repr(value) if isinstance(value, str) else f"{value!s} {_units(block)}".rstrip() for value in (x, y)]
    return f"{values[0]} in A, {values[1]} in B{f' at {labels}' if labels else ''}"


def _units(variable: xr.DataArray) -> str:
    if variable.dtype.kind == "M":
        return "s"
    units = str(variable.attrs.get("units", ""))
    return "" if units == "1" else units


def _attributes(owner: str, a: Mapping[Any, Any], b: Mapping[Any, Any]) -> Iterator[str]:
    for name in _either(a, b):
        one, two = (np.asarray(value[name]).tolist() if name in value else None for value in (a, b))
        one, two = (value[0] if isinstance(value, list) and len(value) == 1 else value for value in (one, two))
        if one == two or (one != one and two != two):
            continue
        if not owner and name == _STUDY and one and two:
            lines = changes(json.loads(one), json.loads(two))
            yield from (f"study: {line}" for line in lines)
            if lines:
                continue
        yield from _scalar(f"{owner}attribute {name}", one, two)


def _scalar(label: str, a: object, b: object) -> Iterator[str]:
    if a is None or b is None:
        yield f"{label}: only in {'B' if a is None else 'A'}: {_short(b if a is None else a)}"
    elif a != b:
        yield f"{label}: {_short(a)} in A, {_short(b)} in B"


def _either(a: Iterable[Any], b: Iterable[Any]) -> list[Any]:
    return list(dict.fromkeys([*a, *b]))


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]}...{text[-1]}"

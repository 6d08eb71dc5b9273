"""Comparison of two results by content: dimensions, attributes and values."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.store.folder import locate, open_result, result_digest
from heliosweep.store.writer import changes


@dataclass
class Comparison:
    """Result of a comparison.

    Parameters
    ----------
    a, b : pathlib.Path
        Paths of the two results.
    same_bytes : bool
        True if the two files are identical.
    differences : list of str
        One line for each difference in content. The list is empty if the contents are equal.
    notes : list of str
        Differences that do not count, such as values that differ within the tolerances.
    """

    a: Path
    b: Path
    same_bytes: bool = False
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """True if the contents are equal."""
        return not self.differences

    def __str__(self) -> str:
        if self.same_bytes:
            verdict = "same bytes"
        elif self.same:
            verdict = f"same content{' within the tolerances' if self.notes else ', with different bytes'}"
        else:
            count = len(self.differences)
            verdict = f"{count} difference{'s' if count > 1 else ''}"
        return "\n".join([f"A: {self.a}", f"B: {self.b}", *self.differences, *self.notes, verdict])


def compare(
    a: str | os.PathLike[str], b: str | os.PathLike[str], *, rtol: float = 0.0, atol: float = 0.0
) -> Comparison:
    """Compare two results by content.

    Parameters
    ----------
    a, b : path
        Result folders or NetCDF files.
    rtol, atol : float
        Values are equal if they differ by at most ``atol + rtol * larger magnitude``. NaN equals NaN.

    Returns
    -------
    Comparison

    Raises
    ------
    StudyError
        If a path contains no result, or if a tolerance is negative.
    HeliosweepError
        If a result is damaged.
    """
    if not (rtol >= 0 and atol >= 0):
        raise StudyError(Problem("tolerances must not be negative"))
    comparison = Comparison(locate(a), locate(b))
    with open_result(comparison.a, chunks={}) as one, open_result(comparison.b, chunks={}) as two:
        if result_digest(comparison.a) == result_digest(comparison.b):
            comparison.same_bytes = True
            return comparison
        for line in _differences(one, two, rtol, atol):
            (comparison.notes if line.endswith("within the tolerances") else comparison.differences).append(line)
    return comparison


def _differences(one: xr.Dataset, two: xr.Dataset, rtol: float, atol: float) -> Iterator[str]:
    yield from _entries("dimension ", one.sizes, two.sizes)
    yield from _entries("attribute ", one.attrs, two.attrs)
    for name in {**one.variables, **two.variables}:
        if name not in one.variables or name not in two.variables:
            yield f"{name}: only in {'A' if name in one.variables else 'B'}"
            continue
        a, b = one[name], two[name]
        yield from _entries(f"{name}: attribute ", a.attrs, b.attrs)
        kinds = ["str" if item.dtype.kind in "OTU" else str(item.dtype) for item in (a, b)]
        if kinds[0] != kinds[1]:
            yield f"{name}: {kinds[0]} in A, {kinds[1]} in B"
        if a.dims != b.dims:
            yield f"{name}: over {a.dims} in A, over {b.dims} in B; values are not compared"
        elif a.shape != b.shape or ("str" in kinds and kinds[0] != kinds[1]):
            yield f"{name}: values are not compared because lengths or types differ"
        else:
            yield from _values(str(name), a, b, rtol, atol)


def _values(name: str, a: xr.DataArray, b: xr.DataArray, rtol: float, atol: float) -> Iterator[str]:
    x, y = a.variable, b.variable.chunk(dict(zip(b.dims, a.chunks, strict=True))) if a.chunks else b.variable
    different = (x != y) & ~(x.isnull() & y.isnull())
    count, alone = (int(part.sum()) for part in (different, x.isnull() ^ y.isnull()))
    if not count:
        return
    unit, beyond, size = str(a.attrs.get("units", "")).removeprefix("1"), count, different.astype(float)
    if a.dtype.kind == "M":
        unit, size = "s", abs(x - y) / np.timedelta64(1, "s")
    elif a.dtype.kind not in "OTU":
        x, y = x.astype(float), y.astype(float)
        size = abs(x - y)
    if (rtol or atol) and a.dtype.kind not in "MOTU":
        limit = atol + rtol * xr.apply_ufunc(np.maximum, abs(x), abs(y), dask="allowed")
        beyond = int((different & ~(size <= limit)).sum())
    size = size.fillna(np.inf).where(different, -1.0)
    place = np.unravel_index(int(size.data.argmax()), size.shape)
    worst, at = float(size.data[place]), dict(zip(a.dims, map(int, place), strict=True))
    labels = ", ".join(f"{dim} {a[dim].values[i] if dim in a.coords else i}" for dim, i in at.items())
    values = [array[at].compute().values[()] for array in (a, b)]
    words = [repr(str(value)) if isinstance(value, str) else f"{value!s} {unit}".rstrip() for value in values]
    largest = f" {worst:.6g} {unit}".rstrip() if a.dtype.kind not in "OTU" and np.isfinite(worst) else ""
    missing = f", {alone:,} of them NaN in only one result" if alone else ""
    text = f"{name}: {beyond or count:,} of {a.size:,} values differ{missing}; largest difference{largest}: "
    text += f"{words[0]} in A, {words[1]} in B{f' at {labels}' if labels else ''}"
    yield text if beyond else f"{text}; within the tolerances"


def _entries(owner: str, a: Mapping[Any, Any], b: Mapping[Any, Any]) -> Iterator[str]:
    for name in {**a, **b}:
        one, two = (_plain(entries.get(name)) for entries in (a, b))
        if one == two or (one != one and two != two):
            continue
        if name == "study" and owner == "attribute " and one and two:
            yield from (f"study: {line}" for line in changes(json.loads(one), json.loads(two)))
            continue
        short = [text if len(text) <= 60 else f"{text[:56]}...{text[-1]}" for text in map(repr, (one, two))]
        if one is None or two is None:
            yield f"{owner}{name}: only in {'B' if one is None else 'A'}: {short[one is None]}"
        else:
            yield f"{owner}{name}: {short[0]} in A, {short[1]} in B"


def _plain(value: Any) -> Any:
    plain = np.asarray(value).tolist()
    return plain[0] if isinstance(plain, list) and len(plain) == 1 else plain

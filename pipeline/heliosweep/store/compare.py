"""`heliosweep compare`: what is different between two results, by meaning and not by bytes."""

from __future__ import annotations

import filecmp
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.store.checks import sound
from heliosweep.store.manifest import changes
from heliosweep.store.read import Index, Places, Stored, open_stored, plain, tree, value_text

Position: TypeAlias = tuple[int, ...]
#: Longest text of an attribute that is shown whole.
_LONGEST = 60
#: Attribute that holds the study as JSON.
_STUDY = "study"


@dataclass
class Comparison:
    """What is different between two results; `same_bytes` where they are the same to the last bit.

    `differences` has one line each, none where they mean the same; `notes` what is different and does not count, as
    values within the tolerances.
    """

    a: Path
    b: Path
    same_bytes: bool = False
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether they mean the same."""
        return not self.differences

    @property
    def lines(self) -> list[str]:
        """All of it, the verdict last."""
        if self.same_bytes:
            verdict = "same bytes"
        elif self.same:
            within = " within the tolerances" if self.notes else ", in other bytes"
            verdict = f"same content{within}"
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
    """Tell two results apart: dimensions, variables, types, attributes and values.

    They are result folders, NetCDF files or Zarr groups, of any kind each. Values count as the same that differ by at
    most ``atol + rtol * larger magnitude``. NaN is the same as NaN; the order of variables and attributes, storage and
    compression do not count.

    Raises StudyError for a path that holds no result, or a tolerance that is none, HeliosweepError for a damaged
    result.
    """
    if not (rtol >= 0 and atol >= 0):
        raise StudyError(Problem("tolerances must not be negative"))
    first, second = sound(a, b)
    comparison = Comparison(first, second)
    if _same_bytes(comparison.a, comparison.b):
        comparison.same_bytes = True
        return comparison
    with open_stored(comparison.a) as one, open_stored(comparison.b) as two:
        _Comparer(one, two, rtol, atol, comparison).run()
    return comparison


def _same_bytes(a: Path, b: Path) -> bool:
    if a.is_dir() and b.is_dir():
        names = tree(a)
        return names == tree(b) and not any(filecmp.cmpfiles(a, b, names, shallow=False)[1:])
    return a.is_file() and b.is_file() and filecmp.cmp(a, b, shallow=False)


class _Comparer:
    """Two open results, and what has been found so far."""

    def __init__(self, a: Stored, b: Stored, rtol: float, atol: float, found: Comparison) -> None:
        self.a, self.b, self.rtol, self.atol, self.found = a, b, rtol, atol, found
        self.places = Places(a)

    def run(self) -> None:
        for dim in _either(self.a.sizes, self.b.sizes):
            self._scalar(f"dimension {dim}", self.a.sizes.get(dim), self.b.sizes.get(dim))
        self._attributes("", self.a.attributes, self.b.attributes)
        for name in _either(self.a.variables, self.b.variables):
            one, two = self.a.variables.get(name), self.b.variables.get(name)
            if one is None or two is None:
                self._say(f"{name}: only in {'B' if one is None else 'A'}")
            else:
                self._variable(name, one, two)

    def _say(self, line: str) -> None:
        self.found.differences.append(line)

    def _scalar(self, what: str, a: object, b: object) -> None:
        if a is None or b is None:
            self._say(f"{what}: only in {'B' if a is None else 'A'}: {_short(b if a is None else a)}")
        elif a != b:
            self._say(f"{what}: {_short(a)} in A, {_short(b)} in B")

    def _attributes(self, owner: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> None:
        for name in _either(a, b):
            one, two = _listed(a.get(name)), _listed(b.get(name))
            if _equal(one, two) or (owner and name == "coordinates"):  # these are compared by themselves
                continue
            if not owner and name == _STUDY and (studies := _studies(one, two)):
                for line in changes(*studies):
                    self._say(f"study: {line}")
                continue
            self._scalar(f"{owner}attribute {name}", one, two)

    def _variable(self, name: str, a: xr.Variable, b: xr.Variable) -> None:
        self._attributes(f"{name}: ", plain(a.attrs), plain(b.attrs))
        text = self.a.is_text(name)
        types = ["str" if side.is_text(name) else side.variables[name].dtype.name for side in (self.a, self.b)]
        if types[0] != types[1]:
            self._say(f"{name}: {types[0]} in A, {types[1]} in B")
        if a.dims != b.dims:
            self._say(f"{name}: over {_dims(a)} in A, over {_dims(b)} in B; values not compared")
        elif a.shape != b.shape:
            self._say(f"{name}: values not compared, for the lengths differ")
        elif text != self.b.is_text(name):
            self._say(f"{name}: values not compared")
        elif text:
            self._texts(name, a)
        else:
            self._numbers(name, a)

    def _texts(self, name: str, variable: xr.Variable) -> None:
        count, first = 0, ""
        for index in self.a.pieces(name):
            one, two = self.a.read(name, index), self.b.read(name, index)
            different = np.asarray(one != two, dtype=bool)
            if not count and different.any():
                at = _first(different)
                first = f"{one[at]!r} in A, {two[at]!r} in B{self._at(variable, _position(index, at))}"
            count += int(different.sum())
        if count:
            self._say(f"{name}: {_of(count, variable)} differ, first {first}")

    def _numbers(self, name: str, variable: xr.Variable) -> None:
        tally = _Tally(self.rtol, self.atol)
        for index in self.a.pieces(name):
            tally.add(self.a.read(name, index), self.b.read(name, index), index)
        for only, (count, place) in tally.nans.items():
            if count:
                where = self._at(variable, place) or " the only one"
                self._say(f"{name}: {_of(count, variable)} are NaN in {only} alone, first{where}")
        if tally.count:
            self._say(f"{name}: {_of(tally.count, variable)} differ{self._largest(name, tally)}")
        if tally.within:
            line = f"{name}: {_of(tally.within, variable)} differ within the tolerances"
            self.found.notes.append(line if tally.count else f"{line}{self._largest(name, tally)}")

    def _largest(self, name: str, tally: _Tally) -> str:
        units, variable = self.places.units(name), self.a.variables[name]
        (size, one, two, place), (relative, *_, other) = tally.absolute, tally.relative
        values = f"{value_text(one, units)} in A, {value_text(two, units)} in B"
        length = f"{size:.6g} {'s' if ' since ' in units else units}".rstrip()
        text = f"; largest difference {length}: {values}{self._at(variable, place)}"
        if np.isfinite(relative) and " since " not in units:
            text += f"; largest relative difference {relative:.3g}"
            text += self._at(variable, other) if other != place else ""
        return text

    def _at(self, variable: xr.Variable, position: Position) -> str:
        return f" at {self.places.at(tuple(map(str, variable.dims)), position)}" if position else ""


class _Tally:
    """Differences between two arrays that come in pieces."""

    def __init__(self, rtol: float, atol: float) -> None:
        self.rtol, self.atol = rtol, atol
        self.count = self.within = 0
        self.nans: dict[str, tuple[int, Position]] = {"A": (0, ()), "B": (0, ())}
        self.absolute: tuple[float, Any, Any, Position] = (-1.0, 0.0, 0.0, ())
        self.relative = self.absolute

    def add(self, a: np.ndarray, b: np.ndarray, index: Index) -> None:
        """Take in one piece of both."""
        different = np.asarray(a != b)
        if not different.any():
            return
        if a.dtype.kind == "f" or b.dtype.kind == "f":
            nan_a, nan_b = np.isnan(a), np.isnan(b)
            for only, alone in (("A", nan_a & ~nan_b), ("B", nan_b & ~nan_a)):
                count, place = self.nans[only]
                if new := int(alone.sum()):
                    self.nans[only] = count + new, place if count else _position(index, _first(alone))
            different &= ~(nan_a | nan_b)
            if not different.any():
                return
        at = np.nonzero(np.atleast_1d(different))
        one, two = np.atleast_1d(a)[at], np.atleast_1d(b)[at]
        x, y = one.astype(np.float64), two.astype(np.float64)
        with np.errstate(all="ignore"):
            size, larger = np.abs(x - y), np.maximum(np.abs(x), np.abs(y))
            relative = np.where(np.isfinite(larger), size / larger, np.inf)
            beyond = ~(size <= self.atol + self.rtol * larger) | ~np.isfinite(size)
        if not self.atol and not self.rtol:
            beyond[:] = True  # also of integers too long for these numbers to tell apart
        self.count += int(beyond.sum())
        self.within += int((~beyond).sum())
        for key, values in (("absolute", size), ("relative", relative)):
            largest = int(np.argmax(values))
            if values[largest] > getattr(self, key)[0]:
                place = _position(index, tuple(int(axis[largest]) for axis in at))
                setattr(self, key, (float(values[largest]), one[largest], two[largest], place))


def _position(index: Index, at: Position) -> Position:
    """Position in the whole result of one in a piece of it; values without dimensions have none."""
    return tuple(span.start + step for span, step in zip(index, at, strict=False))


def _first(mask: np.ndarray) -> Position:
    return tuple(int(axis) for axis in np.unravel_index(int(mask.argmax()), mask.shape))


def _either(a: Iterable[str], b: Iterable[str]) -> list[str]:
    return list(dict.fromkeys([*a, *b]))


def _listed(value: Any) -> Any:
    """One number and a list of one are the same to NetCDF."""
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _equal(a: Any, b: Any) -> bool:
    return a == b or (a != a and b != b)  # NaN, as the fill value


def _studies(a: Any, b: Any) -> tuple[Any, Any] | None:
    try:
        studies = json.loads(a), json.loads(b)
    except (TypeError, ValueError, RecursionError):
        return None
    return studies if changes(*studies) else None


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]}...{text[-1]}"


def _dims(variable: xr.Variable) -> str:
    return f"({', '.join(map(str, variable.dims))})"


def _of(count: int, variable: xr.Variable) -> str:
    return f"{count:,} of {int(np.prod(variable.shape, dtype=np.int64)):,} values"

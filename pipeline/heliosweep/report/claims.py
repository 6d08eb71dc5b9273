"""The words of a table of published numbers: what is chosen or taken along a dimension, and what is expected.

A cell below the name of a coordinate is a label (``30``), several labels (``0 or 180``), a range (``0 to 90``), a bound
(``> 0``); or a statistic (``min``), also of a part (``max of 0 to 90``); or a difference of two of these
(``north - south``). Statistics are taken from the left column to the right, ``argmin`` and ``argmax`` last. A
published number is a number, a date, a range, a bound, or several of these with ``or``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.faults import did_you_mean
from heliosweep.config.units import factor

#: How far a coordinate may be from the one asked for, relative and absolute.
SAME = 1e-9

#: Rounding that a value on the edge of what is expected is forgiven, relative to it.
EDGE = 1e-12

Values: TypeAlias = NDArray[np.float64]

#: Least and greatest value, and whether these are left out.
Interval: TypeAlias = tuple[float, float, bool]

#: What is taken of the values along a dimension; missing ones are left out.
STATISTICS: dict[str, Callable[[Values], float]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "median": np.median,
    "std": np.std,
}

#: Where along a dimension the least and the greatest value are: coordinates.
PLACES: dict[str, Callable[[Values], np.intp]] = {"argmin": np.argmin, "argmax": np.argmax}

#: What is taken of the values in the order of the coordinate.
TRENDS = ("least step", "largest step", "correlation")

WORDS = (*STATISTICS, *PLACES, *TRENDS, "count > 0")

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})?"
_DATE = r"\d{4}-\d{2}(?:-\d{2}(?:T\d{2}:\d{2})?)?"
_BOUND = rf"(>=|<=|>|<)\s*({_NUMBER}|{_DATE})"
_RANGE = re.compile(rf"({_NUMBER}|{_DATE})(?: to ({_NUMBER}|{_DATE}))?", re.ASCII)
_TAKEN = re.compile(rf"({'|'.join(WORDS[:-1])}|count (?:>=|<=|>|<) {_NUMBER})(?: of (.+))?", re.ASCII)

#: Names of units in results and in tables, by the house's.
_SPELLINGS = {
    "%": ("percent",),
    "deg": ("degree", "degrees", "degrees_north", "degrees_east"),
    "d": ("day", "days"),
    "h": ("hour", "hours"),
    "s": ("second", "seconds"),
    "min": ("minute", "minutes"),
}
_HOUSE = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}


def conversion(unit: str, wanted: str) -> float:
    """Factor from one unit to another, as results or tables spell them. Raises ValueError where there is none."""
    if unit == wanted:
        return 1.0
    return factor(_HOUSE.get(unit, unit), _HOUSE.get(wanted, wanted))


def days(values: Any) -> Values:
    """Dates as days since 1970, missing ones as NaN."""
    since = np.asarray(values, "datetime64[ns]")
    return np.where(np.isnat(since), np.nan, since.astype("int64") / 86_400e9)


def day_number(value: float | str) -> float:
    """A number as it is, a date as its day since 1970; NaN for other words."""
    if not isinstance(value, str):
        return value
    return float(days(np.datetime64(value))) if re.fullmatch(_DATE, value, re.ASCII) else math.nan


def date_text(value: float) -> str:
    """Day of a number of days since 1970."""
    return str(np.datetime64("1970-01-01") + np.timedelta64(math.floor(value + SAME), "D"))


def intervals(text: str) -> list[Interval]:
    """Numbers, dates (as days since 1970), ranges and bounds, with ``or`` between them.

    A day or month is all of it. Raises ValueError with the end of a sentence.
    """
    found = []
    for piece in map(str.strip, text.split(" or ")):
        if bound := re.fullmatch(_BOUND, piece, re.ASCII):
            low, high = _ends(bound[2])
            above = ">" in bound[1]
            limit = high if bound[1] in (">", "<=") else low
            found.append((limit if above else -math.inf, math.inf if above else limit, "=" not in bound[1]))
        elif ends := _RANGE.fullmatch(piece):
            found.append((_ends(ends[1])[0], _ends(ends[2] or ends[1])[1], False))
        if not found or not found[-1][0] <= found[-1][1] or not (bound or ends):
            raise ValueError(
                "must be a finite number, a bound as '> 0', a range as '1 to 2', a date, or several with 'or' "
                f"(got {text[:40]!r})"
            )
    return found


def _ends(text: str) -> tuple[float, float]:
    """The least and greatest number, or moment in days, that a text means."""
    if re.fullmatch(_NUMBER, text, re.ASCII):
        return float(text), float(text)
    first = np.datetime64(text)
    return float(days(first)), max(float(days(first)), float(days(first + 1)) - 3 * SAME)


def is_date(text: str) -> bool:
    """Whether what is expected is a date."""
    return bool(re.search(_DATE, text))


@dataclass(frozen=True)
class Expected:
    """Numbers, or days since 1970, that agree.

    Parameters
    ----------
    intervals : list of (float, float, bool)
        At least one: from, to, and whether these are left out; that of a number begins and ends there.
    date : bool
        Whether they are dates.
    """

    intervals: list[Interval]
    date: bool = False

    @property
    def number(self) -> float:
        """The one number that is expected; NaN where it is anything else."""
        low, high, _ = self.intervals[0]
        return low if len(self.intervals) == 1 and low == high and not self.date else math.nan

    def difference(self, computed: float, turn: bool = False) -> float:
        """How far a value is from the nearest interval, 0 within; with `turn`, degrees the shorter way round."""
        return min((_away(one, computed, turn) for one in self.intervals), key=abs)

    def holds(self, computed: float, tolerance: float, turn: bool = False) -> bool:
        """Whether a value is in an interval, or off by the tolerance at most; NaN never is."""
        for low, high, ends in self.intervals:
            if ends and not tolerance:
                if low < computed < high:
                    return True
                continue
            size = max(abs(end) for end in (low, high, tolerance) if math.isfinite(end))
            if abs(_away((low, high, ends), computed, turn)) <= tolerance + EDGE * size:
                return True
        return False


def _away(interval: Interval, computed: float, turn: bool) -> float:
    away = computed - min(max(computed, interval[0]), interval[1]) if computed == computed else math.nan
    return (away + 180) % 360 - 180 if turn and abs(away) > 180 else away


def expected(text: str) -> Expected:
    """Read what is expected; a date is a whole day. Raises ValueError with the end of a sentence."""
    found = intervals(text)
    if is_date(text):
        found = [(float(np.floor(low)), float(np.floor(high)), ends) for low, high, ends in found]
    return Expected(found, is_date(text))


@dataclass(frozen=True)
class Term:
    """Points along a dimension, and the statistic that is taken of them; without one, the only point is meant."""

    chosen: NDArray[np.bool_]
    taken: str = ""


def along(coordinate: xr.DataArray) -> Values | None:
    """Coordinates as numbers, dates and months as days since 1970; None where they are words."""
    values = np.atleast_1d(coordinate.to_numpy())
    if values.dtype.kind in "OU" and values.size and all(re.fullmatch(_DATE, str(one), re.ASCII) for one in values):
        values = values.astype("datetime64[ns]")
    if values.dtype.kind == "M":
        return days(values)
    return values.astype(float) if values.dtype.kind in "fiu" else None


def labelled(coordinate: xr.DataArray, text: str) -> NDArray[np.bool_]:
    """Where a coordinate has a label; dates are compared as far as the text tells them."""
    values = along(coordinate)
    if values is None:
        return np.asarray(np.atleast_1d(coordinate.to_numpy()).astype(str) == text)
    return _within(coordinate, values, text) if re.fullmatch(f"{_NUMBER}|{_DATE}", text, re.ASCII) else values != values


def _within(coordinate: xr.DataArray, values: Values, text: str) -> NDArray[np.bool_]:
    """Where numbers or days are in the interval that a text means."""
    if is_date(text) != (dates := coordinate.dtype.kind not in "fiu"):
        raise ValueError(f"{coordinate.name} has {'dates' if dates else 'numbers'} (got {text!r})")
    [(low, high, ends)] = intervals(text)
    slack = [(-SAME if ends else SAME) * max(1.0, abs(end) * (not dates)) for end in (low, high) if math.isfinite(end)]
    return np.asarray((values >= low - slack[0]) & (values <= high + slack[-1]))


def _points(coordinate: xr.DataArray, text: str) -> NDArray[np.bool_]:
    """Where a coordinate is what labels, ranges and bounds say."""
    values, chosen = along(coordinate), np.zeros(coordinate.size, dtype=bool)
    for piece in map(str.strip, text.split(" or ")):
        if values is None:
            found = labelled(coordinate, piece)
        elif re.fullmatch(f"{_RANGE.pattern}|{_BOUND}", piece, re.ASCII):
            found = _within(coordinate, values, piece)
        else:
            raise ValueError(f"{coordinate.name} must be a number, a range, a bound or a statistic (got {piece!r})")
        if not found.any():
            raise ValueError(f"{coordinate.name} {piece!r} is not in the result, which has {_some(coordinate)}")
        chosen |= found
    return chosen


def _some(coordinate: xr.DataArray) -> str:
    kind, values = coordinate.dtype.kind, coordinate.to_numpy().ravel()[:8]
    texts = [f"{one:g}" if kind in "fiu" else str(one)[:10] if kind == "M" else str(one) for one in values]
    more = coordinate.size - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more > 0 else "")


def read_cell(coordinate: xr.DataArray, text: str) -> list[Term]:
    """Read a cell below the name of a coordinate: a term, or two of which the difference is meant.

    Raises ValueError with what is wrong, in words.
    """
    if (same := labelled(coordinate, text)).any():
        return [Term(same)]
    terms, pieces = [], [piece.strip() for piece in text.split(" - ")]
    for piece in pieces:
        taken = None if labelled(coordinate, piece).any() else _TAKEN.fullmatch(piece)
        if taken and along(coordinate) is None and taken[1] in (*PLACES, *TRENDS):
            raise ValueError(f"{coordinate.name} has no {taken[1]}: its labels are words")
        every = np.ones(coordinate.size, dtype=bool)
        part = taken[2] if taken else piece
        terms.append(Term(_points(coordinate, part) if part else every, taken[1] if taken else ""))
        if len(pieces) > 1 and not taken and terms[-1].chosen.sum() > 1:
            raise ValueError(
                f"{coordinate.name} {piece!r} is more than one point: take one of {', '.join(WORDS)} of it"
            )
    if len(terms) > 2 or (len(terms) > 1 and any(term.taken in PLACES for term in terms)):
        raise ValueError(f"{coordinate.name} must be one term, or the difference of two values (got {text!r})")
    return terms


def take(terms: Iterable[Term], values: Values, axis: int, coordinates: Values) -> Values:
    """Take what a cell asks for along one axis, of which the coordinates are given as numbers."""
    first, *second = (
        np.apply_along_axis(_taken, axis, np.compress(term.chosen, values, axis), term.taken, coordinates[term.chosen])
        for term in terms
    )
    return np.asarray(first - second[0] if second else first, float)


def _taken(values: Values, taken: str, coordinates: Values) -> float:
    here = np.isfinite(values)
    values, coordinates = values[here], coordinates[here]
    if taken.startswith("count"):
        [(low, high, ends)] = intervals(taken.removeprefix("count "))
        inside = (values > low) & (values < high) if ends else (values >= low) & (values <= high)
        return float(inside.sum())
    if not values.size:
        return math.nan
    if taken in STATISTICS:
        return float(STATISTICS[taken](values))
    if taken in PLACES:
        return float(coordinates[PLACES[taken](values)])
    if not taken:
        return float(values[0])
    if taken == "correlation":
        flat = np.ptp(values) == 0 or np.ptp(coordinates) == 0
        return math.nan if flat else float(np.corrcoef(coordinates, values)[0, 1])
    steps = np.diff(values[np.argsort(coordinates, kind="stable")])
    if not steps.size:
        return math.nan
    return float(steps.min() if taken == "least step" else steps.max())


@dataclass(frozen=True)
class Asked:
    """What one row asks for in a result.

    Parameters
    ----------
    names : list of str
        The quantity, or two, of which the difference is meant.
    chosen : dict of str to int or ndarray
        Index along each dimension.
    taken : list of (str, str, list of Term)
        Dimension, coordinate and what is taken along it, in the order of the columns, places last.
    date : bool
        Whether a date comes out.
    factor : float
        To the unit of the row.
    """

    names: list[str]
    chosen: dict[str, Any]
    taken: list[tuple[str, str, list[Term]]]
    date: bool
    factor: float

    def computed(self, result: xr.Dataset) -> float | str:
        """What a result has for it: a number in the unit of the row, or a date."""
        arrays = [result[name].isel(self.chosen).transpose(..., *self._dims) for name in self.names]
        first, *second = (days(one) if one.dtype.kind == "M" else one.to_numpy().astype(float) for one in arrays)
        values, dims = first - second[0] if second else first, list(arrays[0].dims)
        for dim, name, terms in self.taken:
            numbers = along(result[name].isel({dim: self.chosen[dim]}))
            size = values.shape[dims.index(dim)]
            values = take(terms, values, dims.index(dim), np.arange(float(size)) if numbers is None else numbers)
            dims.remove(dim)
        value = float(values.item())
        return date_text(value) if self.date and math.isfinite(value) else value * self.factor

    @property
    def _dims(self) -> list[str]:
        return [dim for dim, _, _ in self.taken]


def ask(result: xr.Dataset, one: Any) -> Asked:
    """Find what a row of published numbers (`comparison.Comparison`) asks for in a result.

    Raises ValueError with what is wrong, in words.
    """
    names = one.quantity.split(" - ")
    for name in names:
        if name not in result.data_vars:
            raise ValueError(f"unknown quantity {name!r}{_meant(name, result.data_vars)}")
    quantity, other = result[names[0]], result[names[-1]]
    unit, date = str(quantity.attrs.get("units", "1")), quantity.dtype.kind == "M"
    if set(quantity.dims) != set(other.dims) or unit != str(other.attrs.get("units", "1")) or len(names) > 2:
        raise ValueError(f"{one.quantity!r} must be one quantity, or two with the same dimensions and unit")
    if any(array.dtype.kind not in "fiub" for array in (quantity, other)) and not (date and len(names) == 1):
        raise ValueError(f"{one.quantity} is no number: words and differences of dates cannot be compared")
    masks = {str(dim): np.ones(size, dtype=bool) for dim, size in quantity.sizes.items()}
    taken: dict[str, tuple[str, list[Term]]] = {}
    for name, text in one.where.items():
        if name not in result.coords:
            raise ValueError(f"unknown coordinate {name!r}{_meant(name, result.coords)}")
        coordinate = result[name]
        if coordinate.ndim > 1 or not set(coordinate.dims) <= set(quantity.dims):
            dims = ", ".join(map(str, quantity.dims)) or "none"
            raise ValueError(f"{quantity.name} cannot be chosen by {name!r}; its dimensions are {dims}")
        terms, dim = read_cell(coordinate, text), str(coordinate.dims[0]) if coordinate.ndim else ""
        if len(terms) == 1 and not terms[0].taken:
            if dim:
                masks[dim] &= terms[0].chosen
        elif not dim or dim in taken:
            raise ValueError(f"{name} {text!r}: {'there is no dimension' if not dim else 'taken twice'} along {name!r}")
        elif date:
            raise ValueError(f"{one.quantity} is a date, of which {name} {text!r} cannot be taken")
        else:
            taken[dim] = name, terms
    for dim, mask in masks.items():
        if mask.sum() > 1 and dim not in taken:
            raise ValueError(f"{dim!r} is missing: {one.quantity} has {mask.sum()} values along it")
        if not all(np.any(mask & term.chosen) for term in (taken[dim][1] if dim in taken else [Term(mask)])):
            raise ValueError(f"no point of {one.quantity} has all of {one.where}")
    places = {dim: terms[0].taken in PLACES for dim, (_, terms) in taken.items()}
    if sum(places.values()) > 1:
        raise ValueError(f"{one.quantity}: only one coordinate can be argmin or argmax")
    for name, terms in taken.values():
        if terms[0].taken in PLACES:
            unit, date = str(result[name].attrs.get("units", "1")), result[name].dtype.kind not in "fiu"
        elif any(term.taken == "correlation" or term.taken.startswith("count") for term in terms):
            unit = "1"
    unit = "days" if date else unit
    if is_date(one.text) != date:
        raise ValueError(f"{one.quantity} is a {'date' if date else 'number'} here, which {one.text!r} is not")
    try:
        factor = conversion(unit, one.unit)
    except ValueError:
        raise ValueError(f"{one.quantity} is in {unit}, which cannot be compared with unit {one.unit!r}") from None
    chosen = {dim: np.flatnonzero(mask) if dim in taken else int(np.argmax(mask)) for dim, mask in masks.items()}
    kept = [
        (dim, name, [Term(term.chosen[masks[dim]], term.taken) for term in terms])
        for dim, (name, terms) in sorted(taken.items(), key=lambda item: places[item[0]])
    ]
    return Asked(names, chosen, kept, date, factor)


def _meant(name: str, known: Iterable[object]) -> str:
    names = list(map(str, known))
    return did_you_mean(name, names) or f"; the result has {', '.join(names) or 'none'}"

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
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.faults import did_you_mean
from heliosweep.config.units import factor

#: How far a coordinate may be from the one asked for, relative and absolute.
SAME = 1e-9

#: Rounding that a value on the edge of what is expected is forgiven. [unit of the number]
EDGE = 1e-9

Values = NDArray[np.float64]

#: What is taken of the values along a dimension; missing ones are left out.
STATISTICS: dict[str, Callable[[Values], float]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "median": np.median,
    "std": np.std,
    "span": np.ptp,
}

#: Where along a dimension the least and the greatest value are: coordinates.
PLACES: dict[str, Callable[[Values], np.intp]] = {"argmin": np.argmin, "argmax": np.argmax}

#: What is taken of the values in the order of the coordinate, which must be numbers or dates.
TRENDS = ("least step", "largest step", "correlation")

WORDS = (*STATISTICS, *PLACES, *TRENDS, "count > 0")

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_DATE = r"\d{4}-\d{2}(?:-\d{2}(?:T\d{2}:\d{2})?)?"
_BOUND = re.compile(rf"(>=|<=|>|<)\s*({_NUMBER}|{_DATE})")
_RANGE = re.compile(rf"({_NUMBER}|{_DATE}) to ({_NUMBER}|{_DATE})")
_TAKEN = re.compile(rf"({'|'.join(WORDS[:-1])}|count (?:>=|<=|>|<) {_NUMBER})(?: of (.+))?")

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
    since = values.astype("datetime64[ns]")
    return np.where(np.isnat(since), np.nan, since.astype("int64") / 86_400e9)


def day_number(value: float | str) -> float:
    """A number as it is, a date as its day since 1970; NaN for other words."""
    if not isinstance(value, str):
        return value
    return float(days(np.datetime64(value))) if re.fullmatch(_DATE, value) else math.nan


def date_text(value: float) -> str:
    """Day of a number of days since 1970."""
    return str(np.datetime64("1970-01-01") + np.timedelta64(math.floor(value + EDGE), "D"))


@dataclass(frozen=True)
class Expected:
    """Numbers or dates that agree: intervals from `low` to `high`, and whether their ends are left out.

    Parameters
    ----------
    intervals : tuple of (float, float, bool)
        At least one; that of a number begins and ends there. Dates are days since 1970.
    date : bool
        Whether they are dates.
    """

    intervals: tuple[tuple[float, float, bool], ...]
    date: bool = False

    @property
    def number(self) -> float:
        """The one number that is expected; NaN where it is anything else."""
        low, high, _ = self.intervals[0]
        return low if len(self.intervals) == 1 and low == high and not self.date else math.nan

    def difference(self, computed: float, turn: bool = False) -> float:
        """How far a value is from the nearest interval, 0 within; with `turn`, degrees the shorter way round."""
        found = []
        for low, high, _ in self.intervals:
            away = computed - min(max(computed, low), high) if computed == computed else math.nan
            found.append((away + 180) % 360 - 180 if turn and abs(away) > 180 else away)
        return min(found, key=abs)

    def holds(self, computed: float, tolerance: float, turn: bool = False) -> bool:
        """Whether a value is in an interval, or off by the tolerance at most; NaN never is."""
        for low, high, ends in self.intervals:
            away = Expected(((low, high, ends),)).difference(computed, turn)
            if ends and not tolerance:
                if low < computed < high:
                    return True
            elif abs(away) <= tolerance + EDGE:
                return True
        return False


def expected(text: str) -> Expected:
    """Read what is expected. Raises ValueError with the end of a sentence."""
    intervals = []
    for piece in map(str.strip, text.split(" or ")):
        if bound := _BOUND.fullmatch(piece):
            low, high = _values(bound[2])
            above = (high if bound[1] == ">" else low, math.inf)
            below = (-math.inf, low if bound[1] == "<" else high)
            intervals.append((*(above if ">" in bound[1] else below), "=" not in bound[1]))
        elif ends := _RANGE.fullmatch(piece):
            intervals.append((_values(ends[1])[0], _values(ends[2])[1], False))
        elif re.fullmatch(f"{_NUMBER}|{_DATE}", piece):
            intervals.append((*_values(piece), False))
        else:
            raise ValueError(
                "must be a finite number, a bound as '> 0', a range as '1 to 2', a date, or several with 'or' "
                f"(got {text[:40]!r})"
            )
    return Expected(tuple(intervals), bool(re.search(_DATE, text)))


def _values(text: str) -> tuple[float, float]:
    """The least and greatest number, or day, that a text means: a month has several days."""
    if re.fullmatch(_NUMBER, text):
        return float(text), float(text)
    first, after = np.datetime64(text), np.datetime64(text) + 1
    return float(days(first)), max(float(days(first)), float(days(after)) - 1)


@dataclass(frozen=True)
class Term:
    """Points along a dimension, and the statistic that is taken of them; without one, the only point is meant."""

    chosen: NDArray[np.bool_]
    taken: str = ""


@dataclass(frozen=True)
class Cell:
    """What a cell asks for along the dimension of its coordinate: one term, or the difference of two."""

    terms: tuple[Term, ...]

    @property
    def places(self) -> bool:
        """Whether it asks where a value is, not for the value."""
        return any(term.taken in PLACES for term in self.terms)

    @property
    def selects(self) -> bool:
        """Whether it only chooses points."""
        return len(self.terms) == 1 and not self.terms[0].taken

    def among(self, points: NDArray[np.intp]) -> Cell:
        """The same of a dimension of which only some points are left."""
        return Cell(tuple(Term(term.chosen[points], term.taken) for term in self.terms))


def read_cell(coordinate: xr.DataArray, text: str) -> Cell:
    """Read a cell below the name of a coordinate. Raises ValueError with what is wrong, in words."""
    if (same := labelled(coordinate, text)).any():
        return Cell((Term(same),))
    terms = []
    for piece in text.split(" - "):
        if (taken := _TAKEN.fullmatch(piece.strip())) and not labelled(coordinate, piece.strip()).any():
            every = np.ones(coordinate.size, dtype=bool)
            if coordinate.dtype.kind not in "fiumM" and taken[1] in TRENDS:
                raise ValueError(f"{coordinate.name} has no order, which {taken[1]!r} needs: its labels are words")
            terms.append(Term(_points(coordinate, taken[2]) if taken[2] else every, taken[1]))
        else:
            terms.append(Term(_points(coordinate, piece.strip())))
    if len(terms) > 2:
        raise ValueError(f"{coordinate.name} has more than two terms (got {text!r})")
    for term, piece in zip(terms, text.split(" - "), strict=True):
        if len(terms) == 2 and not term.taken and term.chosen.sum() > 1:
            raise ValueError(
                f"{coordinate.name} {piece!r} is more than one point: take one of {', '.join(WORDS)} of it"
            )
    return Cell(tuple(terms))


def labelled(coordinate: xr.DataArray, text: str) -> NDArray[np.bool_]:
    """Where a coordinate has a label; dates are compared as far as the text tells them."""
    values = np.atleast_1d(coordinate.to_numpy())
    if values.dtype.kind == "M":
        if not re.fullmatch(_DATE, text):
            return np.zeros(values.shape, dtype=bool)
        day = np.datetime64(text)
        return np.asarray(values.astype(day.dtype) == day)
    if values.dtype.kind not in "fiu":
        return np.asarray(values.astype(str) == text)
    if not re.fullmatch(_NUMBER, text):
        return np.zeros(values.shape, dtype=bool)
    return np.isclose(values.astype(float), float(text), rtol=SAME, atol=SAME)


def _points(coordinate: xr.DataArray, text: str) -> NDArray[np.bool_]:
    """Where a coordinate is what labels, ranges and bounds say."""
    values, chosen = np.atleast_1d(coordinate.to_numpy()), np.zeros(coordinate.size, dtype=bool)
    for piece in map(str.strip, text.split(" or ")):
        bound, ends = _BOUND.fullmatch(piece), _RANGE.fullmatch(piece)
        if (bound or ends) and values.dtype.kind in "fiuM":
            sides = [(bound[1], bound[2])] if bound else [(">=", ends[1]), ("<=", ends[2])] if ends else []
            found = np.ones(values.size, dtype=bool)
            for sign, limit in sides:
                found &= _beyond(values, sign, limit, str(coordinate.name))
        else:
            found = labelled(coordinate, piece)
            if not found.any() and values.dtype.kind in "fiu" and not re.fullmatch(_NUMBER, piece):
                raise ValueError(f"{coordinate.name} must be a number, a range, a bound or a statistic (got {piece!r})")
        if not found.any():
            raise ValueError(f"{coordinate.name} {piece!r} is not in the result, which has {_some(coordinate)}")
        chosen |= found
    return chosen


def _beyond(values: NDArray[np.generic], sign: str, limit: str, name: str) -> NDArray[np.bool_]:
    if (values.dtype.kind == "M") != bool(re.fullmatch(_DATE, limit)):
        raise ValueError(f"{name} has {'dates' if values.dtype.kind == 'M' else 'numbers'} (got {limit!r})")
    if values.dtype.kind == "M":
        day = np.datetime64(limit)
        return np.asarray(_COMPARED[sign](values.astype(day.dtype), day))
    slack = SAME * max(1.0, abs(float(limit))) * (1 if "=" in sign else -1) * (1 if "<" in sign else -1)
    return np.asarray(_COMPARED[sign](values.astype(float), float(limit) + slack))


_COMPARED: dict[str, Callable[..., NDArray[np.bool_]]] = {
    ">": np.greater,
    "<": np.less,
    ">=": np.greater_equal,
    "<=": np.less_equal,
}


def _some(coordinate: xr.DataArray, most: int = 8) -> str:
    numbers = coordinate.dtype.kind in "fiu"
    values = [f"{value:g}" if numbers else str(value) for value in coordinate.to_numpy().ravel()[:most]]
    more = coordinate.size - len(values)
    return ", ".join(values) + (f" and {more} more" if more > 0 else "")


def take(cell: Cell, values: Values, axis: int, along: Values) -> Values:
    """Take what a cell asks for along one axis, of which `along` are the coordinates as numbers."""
    first, *second = (
        np.apply_along_axis(_taken, axis, np.compress(term.chosen, values, axis), term.taken, along[term.chosen])
        for term in cell.terms
    )
    return np.asarray(first - second[0] if second else first, float)


def _taken(values: Values, taken: str, along: Values) -> float:
    here = np.isfinite(values)
    values, along = values[here], along[here]
    if taken.startswith("count"):
        _, sign, limit = taken.split()
        return float(_COMPARED[sign](values, float(limit)).sum())
    if not values.size:
        return math.nan
    if taken in STATISTICS:
        return float(STATISTICS[taken](values))
    if taken in PLACES:
        return float(along[PLACES[taken](values)])
    if not taken:
        return float(values[0])
    in_order = np.argsort(along, kind="stable")
    if taken == "correlation":
        flat = np.ptp(values) == 0 or np.ptp(along) == 0
        return math.nan if flat else float(np.corrcoef(along, values)[0, 1])
    steps = np.diff(values[in_order])
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
    taken : list of (str, str, Cell)
        Dimension, coordinate and what is taken along it, in the order of the columns, places last.
    kind : {"number", "date", "text"}
        What comes out.
    factor : float
        To the unit of the row.
    """

    names: list[str]
    chosen: dict[str, Any]
    taken: list[tuple[str, str, Cell]]
    kind: str
    factor: float

    def computed(self, result: xr.Dataset) -> dict[str, Any]:
        """What a result has for it, as fields of `Comparison`."""
        first, *second = (result[name].isel(self.chosen).transpose(..., *self._dims) for name in self.names)
        if first.dtype.kind not in "fiubM":
            return {"computed": str(first.item())}
        values = _numbers(first)
        values = values - _numbers(second[0]) if second else values
        dims, labels = list(first.dims), None
        for dim, name, cell in self.taken:
            coordinate = result[name].isel({dim: self.chosen[dim]})
            labels = coordinate if coordinate.dtype.kind not in "fiubM" else None
            along = np.arange(float(coordinate.size)) if labels is not None else _numbers(coordinate)
            values = take(cell, values, dims.index(dim), along)
            dims.remove(dim)
        value = float(values.item())
        if self.kind == "text" and labels is not None and math.isfinite(value):
            return {"computed": str(labels.to_numpy()[int(value)])}
        if self.kind == "date" and math.isfinite(value):
            return {"computed": date_text(value)}
        return {"computed": value * self.factor}

    @property
    def _dims(self) -> list[str]:
        return [dim for dim, _, _ in self.taken]


def _numbers(array: xr.DataArray) -> np.ndarray:
    values = array.to_numpy()
    return days(values) if values.dtype.kind == "M" else values.astype(float)


def ask(result: xr.Dataset, one: Any) -> Asked:
    """Find what a row of published numbers (`comparison.Comparison`) asks for in a result.

    Raises ValueError with what is wrong, in words.
    """
    names = one.quantity.split(" - ")
    for name in names:
        if name not in result.data_vars:
            raise ValueError(f"unknown quantity {name!r}{_meant(name, result.data_vars)}")
    quantity, other = result[names[0]], result[names[-1]]
    unit = str(quantity.attrs.get("units", "1"))
    if set(quantity.dims) != set(other.dims) or unit != str(other.attrs.get("units", "1")) or len(names) > 2:
        raise ValueError(f"{one.quantity!r} must be one quantity, or two with the same dimensions and unit")
    masks = {str(dim): np.ones(size, dtype=bool) for dim, size in quantity.sizes.items()}
    taken: dict[str, tuple[str, Cell]] = {}
    for name, text in one.where.items():
        if name not in result.coords:
            raise ValueError(f"unknown coordinate {name!r}{_meant(name, result.coords)}")
        coordinate = result[name]
        if coordinate.ndim > 1 or not set(coordinate.dims) <= set(quantity.dims):
            dims = ", ".join(map(str, quantity.dims)) or "none"
            raise ValueError(f"{quantity.name} cannot be chosen by {name!r}; its dimensions are {dims}")
        cell, dim = read_cell(coordinate, text), str(coordinate.dims[0]) if coordinate.ndim else ""
        if cell.selects:
            if dim:
                masks[dim] &= cell.terms[0].chosen
        elif not dim or dim in taken:
            raise ValueError(f"{name} {text!r}: {'there is no dimension' if not dim else 'taken twice'} along {name!r}")
        else:
            taken[dim] = name, cell
    for dim, mask in masks.items():
        if mask.sum() > 1 and dim not in taken:
            raise ValueError(f"{dim!r} is missing: {one.quantity} has {mask.sum()} values along it")
        if not all(np.any(mask & term.chosen) for term in (taken[dim][1].terms if dim in taken else [Term(mask)])):
            raise ValueError(f"no point of {one.quantity} has all of {one.where}")
    if sum(cell.places for _, cell in taken.values()) > 1:
        raise ValueError(f"{one.quantity}: only one coordinate can be argmin or argmax")
    taken = dict(sorted(taken.items(), key=lambda item: item[1][1].places))
    letter = quantity.dtype.kind
    kind = "date" if letter == "M" else "number" if letter in "fiub" else "text"
    if kind == "date" and len(names) > 1:
        kind, unit = "number", "days"
    for name, cell in taken.values():
        if kind == "text":
            raise ValueError(f"{one.quantity} is words, of which {name} {one.where[name]!r} cannot be taken")
        kind, unit = _outcome(result[name], cell, kind, unit)
    if kind == "text" and one.unit:
        raise ValueError(f"{one.quantity} is words here: leave its unit and tolerance empty")
    if kind != "text" and not one.unit:
        raise ValueError(f"{one.quantity} needs a unit, {unit if kind == 'number' else 'days'!r} for instance")
    if kind != "text" and expected(one.text).date != (kind == "date"):
        raise ValueError(f"{one.quantity} is a {kind} here, which {one.text!r} is not")
    try:
        factor = 1.0 if kind == "text" else conversion("days" if kind == "date" else unit, one.unit)
    except ValueError:
        raise ValueError(f"{one.quantity} is in {unit}, which cannot be compared with unit {one.unit!r}") from None
    chosen = {dim: np.flatnonzero(mask) if dim in taken else int(np.argmax(mask)) for dim, mask in masks.items()}
    kept = [(dim, name, cell.among(np.flatnonzero(masks[dim]))) for dim, (name, cell) in taken.items()]
    return Asked(names, chosen, kept, kind, factor)


def _outcome(along: xr.DataArray, cell: Cell, kind: str, unit: str) -> tuple[str, str]:
    """Kind and unit of what a cell takes."""
    words = {term.taken.split(" ")[0] if term.taken.startswith("count") else term.taken for term in cell.terms}
    places = words & set(PLACES)
    if places:
        if words - set(PLACES):
            raise ValueError(f"{along.name}: a place and a value have no difference")
        kinds = along.dtype.kind
        kind = "date" if kinds == "M" else "number" if kinds in "fiub" else "text"
        unit = str(along.attrs.get("units", "1"))
    elif words & {"count", "correlation"}:
        kind, unit = "number", "1"
    elif kind == "date" and words & {"std", "span", "least step", "largest step"}:
        kind, unit = "number", "days"
    if len(cell.terms) == 2:
        if kind == "text":
            raise ValueError(f"{along.name} has words, which have no difference")
        kind, unit = "number", "days" if kind == "date" else unit
    return kind, unit


def _meant(name: str, known: Iterable[object]) -> str:
    names = list(map(str, known))
    return did_you_mean(name, names) or f"; the result has {', '.join(names) or 'none'}"

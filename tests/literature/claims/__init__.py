"""Claims of papers that are more than single values: a value of the result of a study, and a condition on it.

Single values are in the tables of `studies/published`. ``make index`` evaluates the claims for the index of papers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

#: Relative tolerance of the ends of a range of coordinates.
SAME = 1e-9


@dataclass(frozen=True)
class Claim:
    """A claim of a paper.

    Parameters
    ----------
    study : str
        Name of the shipped study.
    text : str
        Figure, table or sentence of the paper.
    reason : str
        Tolerance and its reason, or the reason why nothing can be compared.
    printed : str
        Words or numbers of the paper.
    computed : str
        Computed value, in the decimals that are stated.
    agrees : bool or None
        Whether the claim holds; None if nothing can be compared.
    value : callable, optional
        Function of the result that returns the value.
    holds : callable, optional
        Condition on the value.
    names : set of str
        Variables that the function takes by name.
    """

    study: str
    text: str
    reason: str
    printed: str
    computed: str = ""
    agrees: bool | None = None
    value: Callable[[xr.Dataset], Any] | None = None
    holds: Callable[[Any], bool] | None = None
    names: set[str] = field(default_factory=set)

    @property
    def verdict(self) -> str:
        """Verdict in words."""
        return {None: "cannot be compared", True: "agrees", False: "does not agree"}[self.agrees]

    def variables(self) -> set[str]:
        """Return the names in the function of the value."""
        return self.names | set(self.value.__code__.co_names if self.value else ())

    def stale(self, result: xr.Dataset) -> str:
        """Return how the result differs from the statement, or an empty text."""
        if self.value is None or self.holds is None:
            return ""
        value = np.asarray(self.value(result)).squeeze()[()]
        if bool(self.holds(value)) != self.agrees:
            return f"{self.text}: stated to be {self.agrees}, but the value is {value}"
        if np.asarray(value).dtype.kind == "M":
            same = str(value.astype("datetime64[D]")) == self.computed
        else:
            mantissa, _, exponent = self.computed.partition("e")
            step = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
            same = abs(float(value) - float(self.computed)) <= 1.01 * step
        return "" if same else f"{self.text}: {self.computed} is stated, but the value is {value}"


def between(coordinate: xr.DataArray, low: Any, high: Any) -> xr.DataArray:
    """Return a mask of the numbers in a range, or of the dates from the first to the last day or month."""
    if isinstance(low, str):
        dates = coordinate.astype("datetime64[ns]")
        return (dates >= np.datetime64(low)) & (dates < np.datetime64(high) + 1)
    slack = SAME * max(1.0, abs(low), abs(high))
    return (coordinate >= low - slack) & (coordinate <= high + slack)


def days(value: Any, date: str) -> int:
    """Return the distance of a date from a day or a month. [d]"""
    first = np.datetime64(date).astype("datetime64[D]")
    last = (np.datetime64(date) + 1).astype("datetime64[D]") - 1
    day = np.datetime64(value, "D")
    return max(0, int((first - day).astype(int)), int((day - last).astype(int)))


def turn(value: float, other: float) -> float:
    """Return the angle between two directions. [deg]"""
    return math.fabs((value - other + 180.0) % 360.0 - 180.0)

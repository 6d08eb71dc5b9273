"""What the colours of pictures mean: scales over numbers, and colours that stand for words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from heliosweep.report.style import DIFFERENCES, VALUES

#: Part of the values that a colour scale holds; single wild ones have the colour of its end.
HELD = 0.995


@dataclass(frozen=True)
class Shades:
    """Colours that follow a number.

    Parameters
    ----------
    label : str
        Of the colour bar, with the unit.
    low, high : float
        Ends; values beyond have the colour of the end.
    palette : str
        Name of the colour map.
    """

    label: str
    low: float
    high: float
    palette: str = VALUES


@dataclass(frozen=True)
class Kinds:
    """Colours that stand for words.

    Parameters
    ----------
    looks : mapping of int to (word, colour)
        By the value; all other values are grey.
    """

    looks: Mapping[int, tuple[str, str]]


def about_zero(label: str, maps: Sequence[np.ndarray], least: float = 1e-12) -> Shades:
    """Scale that is symmetric about zero, for slopes and differences."""
    values = _known(maps)
    end = _rounded(float(np.quantile(np.abs(values), HELD)) if values.size else 1.0, least)
    return Shades(label, -end, end, DIFFERENCES)


def from_zero(label: str, maps: Sequence[np.ndarray], least: float = 1e-12, palette: str = VALUES) -> Shades:
    """Scale from zero upwards."""
    values = _known(maps)
    return Shades(label, 0.0, _rounded(float(np.quantile(values, HELD)) if values.size else 1.0, least), palette)


def within(label: str, maps: Sequence[np.ndarray], palette: str = VALUES) -> Shades:
    """Scale from the least to the largest value but for single wild ones, rounded outwards."""
    values = _known(maps)
    if not values.size:
        return Shades(label, 0.0, 1.0, palette)
    low, high = (float(end) for end in np.quantile(values, [1 - HELD, HELD]))
    lacking = max(0.01 * max(abs(low), abs(high)), 1e-12) - (high - low)
    if lacking > 0:  # all nearly the same
        low, high = low - lacking / 2, high + lacking / 2
    step = 10.0 ** math.floor(math.log10(high - low)) / 2
    low, high = math.floor(low / step + 1e-6) * step, math.ceil(high / step - 1e-6) * step
    return Shades(label, low, high, palette)


def _rounded(end: float, least: float) -> float:
    """End of a scale, rounded up to a quarter of its decade at most."""
    end = max(end, least)
    step = 10.0 ** math.floor(math.log10(end)) / 4
    return math.ceil(end / step - 1e-6) * step


def _known(maps: Sequence[np.ndarray]) -> np.ndarray:
    """All values of some maps."""
    return np.concatenate([one[np.isfinite(one)] for one in maps])

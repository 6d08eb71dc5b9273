"""Words and numbers as a reader expects them: latitudes with their hemisphere, fractions in percent, units."""

from __future__ import annotations

import math
import re
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

DEGREE = "\N{DEGREE SIGN}"
MINUS = "\N{MINUS SIGN}"
NO_BREAK_SPACE = "\N{NO-BREAK SPACE}"
NOTHING = "\N{EN DASH}"
INFINITY = "\N{INFINITY}"

#: Printed unit by the CF spelling.
_UNITS = {
    "1": "",
    "degree": DEGREE,
    "degrees": DEGREE,
    "degrees_north": f"{DEGREE}{NO_BREAK_SPACE}N",
    "degrees_east": f"{DEGREE}{NO_BREAK_SPACE}E",
    "percent": "%",
    "m2": "m\N{SUPERSCRIPT TWO}",
    **{f"{unit} m-2": f"{unit}/m\N{SUPERSCRIPT TWO}" for unit in ("W", "kW", "MWh")},
}

#: Minimum ratio of the extreme values on both sides of zero with which both signs count.
LEAST_SIDE = 0.02

#: Coordinates whose words are printed as they are written, and those whose underscores are printed as hyphens.
_WRITTEN = ("site", "layout", "heliostat", "name", "id")
_ENUMERATIONS = ("tracking", "model", "mount_kind", "source", "axis", "loss")
#: Letters in a line of a label.
LETTERS = 38


def unit_of(array: xr.DataArray) -> str:
    """Return the printed unit; fractions of one are printed in percent."""
    if is_fraction(array):
        return "%"
    unit = str(array.attrs.get("units", ""))
    return _UNITS.get(unit, unit)


def is_fraction(array: xr.DataArray) -> bool:
    """Return True if values are fractions of one, which are printed in percent."""
    valid = array.attrs.get("valid_range")
    return array.attrs.get("units") == "1" and valid is not None and [float(end) for end in valid] == [0.0, 1.0]


def is_signed(low: float, high: float) -> bool:
    """Return True if values between two ends have both signs, so that their colours differ about zero."""
    return min(-low, high) > LEAST_SIDE * max(-low, high)


def is_flag(array: xr.DataArray) -> bool:
    """Return True if values represent words."""
    return "flag_values" in array.attrs and "flag_meanings" in array.attrs


def is_quantity(array: xr.DataArray) -> bool:
    """Return True if values are numbers, but no words, dates or flags."""
    return array.dtype.kind in "fiu" and not is_flag(array)


def quantities(result: xr.Dataset) -> list[str]:
    """Return the names of the variables that are quantities, without the standard errors ``NAME_error`` of others."""
    names = [str(name) for name, array in result.data_vars.items() if is_quantity(array)]
    return [name for name in names if name.removesuffix("_error") == name or name.removesuffix("_error") not in names]


def flag_text(array: xr.DataArray, value: float) -> str:
    """Return the words that a flag value represents, or a dash."""
    words = str(array.attrs["flag_meanings"]).split()
    flags = [float(flag) for flag in np.atleast_1d(array.attrs["flag_values"])]
    meanings = dict(zip(flags, words, strict=False))
    return meanings.get(float(value), NOTHING).replace("_", " ")


def is_latitude(array: xr.DataArray) -> bool:
    """Return True if values are latitudes, which are printed with their hemisphere."""
    return array.name == "latitude" or array.attrs.get("units") == "degrees_north"


def printed(array: xr.DataArray, of: xr.DataArray | None = None) -> Any:
    """Return the values of an array in the unit that `unit_of` names; of an error, in the unit of the array `of`."""
    values = array.to_numpy()
    return values * 100 if is_fraction(array if of is None else of) else values


def title_of(array: xr.DataArray) -> str:
    """Return the name of an array in running text."""
    return str(array.attrs.get("long_name") or str(array.name).replace("_", " ")).removeprefix("name of the ")


def capital(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def head_of(array: xr.DataArray) -> str:
    """Return the name of an array up to the first comma or colon, without "number of the"."""
    return re.split("[:,]", title_of(array))[0].removeprefix("number of the ")


def axis_label(array: xr.DataArray) -> str:
    """Return the label of an axis: name and unit."""
    unit = unit_of(array)
    return f"{title_of(array)} ({unit})" if unit else title_of(array)


def latitude_text(value: float, ends: str = "NS") -> str:
    """Return a latitude, or a longitude with the ends ``EW``, with its hemisphere."""
    hemisphere = "" if value == 0 else f" {ends[int(value < 0)]}"
    return f"{abs(value):g}{DEGREE}{hemisphere}"


def value_text(coordinate: xr.DataArray) -> str:
    """Return one coordinate value with its unit, such as ``95 m``, ``30 deg N`` or ``spinning-elevation``."""
    return value_texts(coordinate)[0]


def value_texts(coordinate: xr.DataArray) -> list[str]:
    """Return the values of a coordinate with their unit."""
    values, name, kind = np.atleast_1d(coordinate.to_numpy()), coordinate.name, coordinate.dtype.kind
    if kind in "mM":
        dates = values.astype("datetime64[D]" if name == "date" else "datetime64[m]").astype(str).tolist()
        return [text.removesuffix("T00:00") for text in dates]
    if kind in "OU":
        if name in _WRITTEN:
            return [re.sub(r"^(?:.*/)?(.*)\.csv$", r"\1", str(text)) for text in values]
        return [str(text).replace("_", "-" if name in _ENUMERATIONS else " ") for text in values]
    if ends := "NS" if is_latitude(coordinate) else {"degrees_east": "EW"}.get(str(coordinate.attrs.get("units"))):
        return [latitude_text(float(value), ends) for value in values]
    unit = unit_of(coordinate)
    space = "" if unit.startswith(DEGREE) else " "
    return [f"{value:g}{space}{unit}".rstrip().replace("-", MINUS) for value in values.astype(float)]


def number_text(value: float, decimals: int = 2, signed: bool = False) -> str:
    """Return a number with a minus sign; a dash for a missing value."""
    if math.isinf(value):
        return INFINITY if value > 0 else MINUS + INFINITY
    if math.isnan(value):
        return NOTHING
    text = f"{value:+,.{decimals}f}" if signed else f"{value:,.{decimals}f}"
    if not text.strip("+-0."):
        text = text.lstrip("+-")
    return text.replace("-", MINUS)


def fold(text: str, most: int = LETTERS) -> str:
    """Break a label into lines."""
    return "\n".join(part for line in text.split("\n") for part in textwrap.wrap(line, most))

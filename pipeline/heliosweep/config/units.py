"""Units that study files may use: a small exact table, so that reading a study needs no unit library."""

from __future__ import annotations

import re
from decimal import Decimal

from heliosweep.config.faults import Invalid, one_of

_DEG_PER_RAD = Decimal("57.295779513082320876798154814105170332405")

# Factor to the first unit of each kind. Decimal, so that "38 ft" is 11.5824 m and not a neighbour of it.
_FACTORS: dict[str, dict[str, Decimal | int | str]] = {
    "a length": {"m": 1, "mm": "0.001", "cm": "0.01", "km": 1000, "in": "0.0254", "ft": "0.3048"},
    "an angle": {
        **{"deg": 1, "rad": _DEG_PER_RAD, "mrad": _DEG_PER_RAD / 1000, "urad": _DEG_PER_RAD / 1_000_000},
        **{"arcmin": Decimal(1) / 60, "arcsec": Decimal(1) / 3600, "\u00b0": 1},
    },
    "a duration": {"s": 1, "min": 60, "h": 3600, "d": 86400},
    "an amount of memory": {
        **{"B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12},
        **{"KiB": 2**10, "MiB": 2**20, "GiB": 2**30, "TiB": 2**40},
    },
    "a pressure": {"Pa": 1, "hPa": 100, "kPa": 1000, "mbar": 100},
    "a temperature": {"degC": 1},
    "a speed": {"m/s": 1, "km/h": Decimal(1) / Decimal("3.6")},
    "a power": {"MW": 1, "kW": "0.001", "GW": 1000},
    "an irradiance": {"W/m2": 1, "kW/m2": 1000, "MW/m2": 10**6},
    "a vapour density": {"g/m3": 1, "kg/m3": 1000},
    "a plain number": {"1": 1, "%": "0.01"},
}
_KINDS = {kind: {unit: Decimal(factor) for unit, factor in units.items()} for kind, units in _FACTORS.items()}
_KIND_OF = {unit: kind for kind, units in _KINDS.items() for unit in units}


def parse(text: str, unit: str) -> float:
    """Read a number with its unit, such as ``"1.2 mrad"``, as a number in `unit`. Raises Invalid."""
    number_form = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
    match = re.fullmatch(rf"\s*({number_form})\s*([^0-9\W_].*?|%|\u00b0|)\s*", text)
    if match is None:
        raise Invalid(f"must be {expected(unit)}{_hint(text, unit)}")
    number, given = float(match[1]), match[2]
    if not given:
        raise Invalid("must be a number without quotes, or a number with its unit")
    kind = _KIND_OF[unit]
    if given not in _KIND_OF:
        raise Invalid(f"unknown unit '{given[:20]}'; use {one_of(_KINDS[kind])}")
    if _KIND_OF[given] != kind:
        raise Invalid(f"must be {expected(unit)}; '{given}' is the unit of {_KIND_OF[given]}")
    if number in (float("inf"), float("-inf")):
        return number
    factors = _KINDS[kind]
    return float(Decimal(repr(number)) * factors[given] / factors[unit])


def _hint(text: str, unit: str) -> str:
    """Return a hint for text that is not a number."""
    if re.fullmatch(r"\s*[-+]?[0-9]+,[0-9]+\s*\D*", text):
        return "; decimals follow a point, not a comma"
    if clock := re.fullmatch(r"\s*([0-9]{1,2}):([0-9]{2})\s*", text):
        return f"; '{text.strip()}' is {int(clock[1]) + int(clock[2]) / 60:g} h" if unit == "h" else ""
    if re.search(r"[0-9]\s*:\s*[-+0-9]|range|linspace", text):
        return "; a range is {start, stop, step} or {start, stop, num}"
    return ""


def expected(unit: str) -> str:
    """Return what to write for a quantity: ``an angle in deg, a number or text such as '30 deg'``."""
    if unit == "1":
        return "a number"
    examples = {"m": "1.5 m", "deg": "30 deg", "h": "1.5 h", "B": "2 GB", "mrad": "1.2 mrad"}
    return f"{_KIND_OF[unit]} in {unit}, a number or text such as '{examples.get(unit, f'1 {unit}')}'"


def suffix(unit: str) -> str:
    """Return the unit as it follows a number in text: `` deg``; nothing for pure numbers."""
    return "" if unit == "1" else f" {unit}"


def is_unit(text: str) -> bool:
    """Return True if a text is the name of a unit."""
    return text in _KIND_OF


def factor(given: str, wanted: str) -> float:
    """Return the factor from one unit to another. Raises ValueError."""
    if given not in _KIND_OF or _KIND_OF[given] != _KIND_OF.get(wanted):
        raise ValueError(f"'{given}' is no multiple of '{wanted}'")
    factors = _KINDS[_KIND_OF[given]]
    return float(factors[given] / factors[wanted])

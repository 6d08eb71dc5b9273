"""Single fields of a table of measured spots; every reader raises ValueError with the rest of a sentence."""

from __future__ import annotations

import datetime as dt
import re

import numpy as np

from heliosweep.config.times import FIRST_YEAR, LAST_YEAR

__all__ = ["WHOLE", "angle", "finite", "place", "time", "weight"]

#: Farthest spot from the aim point. [m]
FARTHEST = 1e6

WHOLE = re.compile(r"\s*[0-9]{1,9}\s*")
_PLAIN = re.compile(r"[0-9+\-.eE\s]*")  # float() also takes 1_0, nan and digits of other scripts


def finite(text: str) -> float:
    """Number that a text holds. Raises ValueError."""
    try:
        number = float(text) if _PLAIN.fullmatch(text) else np.nan
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise ValueError(f"must be a finite number (got {text.strip()[:40]!r})")
    return number


def place(text: str) -> float:
    """Coordinate of a spot that a text holds. Raises ValueError. [m]"""
    value = finite(text)
    if abs(value) > FARTHEST:
        raise ValueError(f"must be between -1e6 and 1e6 m (got {text.strip()[:40]!r})")
    return value


def weight(text: str) -> float:
    """Weight that a text holds, in any unit. Raises ValueError."""
    value = finite(text)
    if value < 0.0:
        raise ValueError(f"must be at least 0: it is an inverse variance (got {text.strip()[:40]!r})")
    return value


def angle(text: str) -> float:
    """Angle that a text holds. Raises ValueError. [deg]"""
    value = finite(text)
    if abs(value) > 720.0:
        raise ValueError(f"must be between -720 and 720 deg (got {text.strip()[:40]!r})")
    return value


def time(text: str) -> np.datetime64:
    """Universal time that a text holds. Raises ValueError."""
    given = text.strip()
    try:
        stamp = dt.datetime.fromisoformat(given)
    except ValueError:
        example = "2024-06-21T09:30:00+02:00"
        raise ValueError(f"must be a time as ISO 8601 has it, such as {example} (got {given[:40]!r})") from None
    if stamp.tzinfo is None:
        raise ValueError(f"needs an offset from UTC, such as +02:00 or Z, at its end (got {given[:40]!r})")
    if not FIRST_YEAR <= stamp.year <= LAST_YEAR:
        raise ValueError(f"must be of the years {FIRST_YEAR} to {LAST_YEAR} (got {given[:40]!r})")
    return np.datetime64(stamp.astimezone(dt.UTC).replace(tzinfo=None), "ns")

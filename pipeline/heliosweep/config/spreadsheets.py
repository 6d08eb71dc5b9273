"""Conventions of spreadsheets in tables: separators, decimal commas, titles with units, dates in any order.

Numbers and dates with two meanings are refused.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

from heliosweep.config.units import is_unit

_ENCLOSED = re.compile(r'"[^"]*"|\([^)]*\)|\[[^\]]*\]')
_SEPARATOR = re.compile(r'"?sep=([;,\t])"?[;,\t]*')
_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?")
_POINT = re.compile(r"[-+]?[0-9]*\.[0-9]+([eE][-+]?[0-9]+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")
_TITLE = re.compile(r"(.*\S)\s*[(\[]([^()\[\]]+)[)\]]+\s*")
_DATE = re.compile(
    r"([DMY])\1*([-/.])([DMY])\3*\2([DMY])\4*(?:[ T]+HH:MM(?::SS)?)?(?:,? *(Z|UTC|[+-]\d\d:\d\d))?", re.I
)
_CELL = re.compile(
    r"(\d+)([-/.])(\d+)\2(\d+)(?:[ T]+(\d{1,2}):(\d\d)(?::(\d\d)(?:\.\d*)?)?(?: *([AP])\.?M\.?)?)?"
    r" *(Z|UTC|[+-]\d\d:?\d\d)?",
    re.I,
)
_COMPACT = re.compile(r"(\d{4})(\d\d)(\d\d)[:T ]?(\d\d)(\d\d)?(\d\d)?")
_UNIT = re.compile(r"\bin ([^\s,;]+)|\[([^\[\]]+)\]$")


def told_separator(line: str) -> str:
    """Return the separator that a first line like ``sep=;`` of Excel names; empty for any other line."""
    found = _SEPARATOR.fullmatch(line.strip(" "))
    return found.group(1) if found else ""


def separator_of(header: str) -> str:
    """Return the separator of the titles of a header: a comma, else a semicolon, else a tab."""
    bare = _ENCLOSED.sub("", header)
    return next((mark for mark in (",", ";", "\t") if mark in bare), ",")


def with_points(rows: Sequence[list[str]], separator: str) -> tuple[Sequence[list[str]], tuple[int, str] | None]:
    """Return the rows with a point in numbers that have a decimal comma, and a problem if numbers have two meanings.

    Parameters
    ----------
    rows : sequence of list of str
        Cells without the header.
    separator : str
        Separator of the cells; a comma excludes decimal commas.

    Returns
    -------
    rows : sequence of list of str
        The rows, numbers with points.
    problem : tuple of int and str, or None
        Row and end of a sentence, if numbers have points and commas.
    """
    cells = [(at, cell.strip()) for at, row in enumerate(rows) for cell in row] if separator != "," else []
    commas = [place for place in cells if "," in place[1] and _COMMA.fullmatch(place[1])]
    if not commas:
        return rows, None
    at, cell = commas[0]
    if point := next((place for place in cells if _POINT.fullmatch(place[1])), None):
        return rows, (point[0], f"has decimal points ({point[1]}) and decimal commas ({cell}); use one of them")
    if separator == "\t" and all(_THOUSANDS.fullmatch(text) for _, text in commas):
        both = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        return rows, (at, f"{cell} may be {both}; write numbers with a point")
    return [[text.replace(",", ".") if _COMMA.fullmatch(text.strip()) else text for text in row] for row in rows], None


def split_title(title: str) -> tuple[str, str]:
    """Return the name in a title and the text in brackets behind it: ``X Position (m)``, ``x [m]``."""
    found = _TITLE.fullmatch(title)
    return (found.group(1), found.group(2).strip()) if found else (title, "")


def variable_name(title: str) -> str:
    """Return the name of a variable for a title: small letters, digits and underscores."""
    plain = unicodedata.normalize("NFKD", title.lower()).encode("ascii", "ignore").decode() or title
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")


def unit_in(meaning: str) -> str:
    """Return the unit that the description of a column names; empty if there is none."""
    named = [inside or said for said, inside in _UNIT.findall(meaning)]
    return next((name for name in reversed(named) if is_unit(name)), "")


def plain_unit(text: str) -> str:
    """Return a unit in the notation of study files: ``W/m^2``, ``W m-2`` and ``W/m²`` are ``W/m2``."""
    return re.sub(r"[\s^*.]", "", text).replace("\u00b2", "2").replace("m-2", "/m2").replace("//", "/")


def iso_dates(texts: Sequence[str], form: str = "") -> list[str]:
    """Return the times of a column as ISO 8601; other text unchanged.

    Parameters
    ----------
    texts : sequence of str
        Cells such as ``21/06/2024 9:30``, ``6/21/2024 9:30 PM`` or ``20240621:0930``.
    form : str, optional
        Order that the title of the column states: ``DD/MM/YYYY hh:mm, +01:00``.

    Returns
    -------
    list of str
        Times as ``2024-06-21T09:30``. Dates whose order neither the title, the dots of ``21.06.2024`` nor a day after
        the 12th shows are unchanged.
    """
    cells = [_CELL.fullmatch(text.strip()) for text in texts]
    order, offset = _order([cell for cell in cells if cell], _DATE.fullmatch(form))
    return [
        _iso(text, cell, order, offset) if cell else _COMPACT.sub(_expanded, text.strip())
        for text, cell in zip(texts, cells, strict=True)
    ]


def _order(cells: Sequence[re.Match[str]], stated: re.Match[str] | None) -> tuple[str, str]:
    """Return the order of year, month and day, such as ``dmy``, and the stated offset; empty if unknown."""
    if stated and len({letter.lower() for letter in stated.group(1, 3, 4)}) == 3:
        return "".join(stated.group(1, 3, 4)).lower(), (stated[5] or "").upper()
    if not cells or len(cells[0][1]) == 4:
        return "ymd" * bool(cells), ""
    late = [any(int(cell[part]) > 12 for cell in cells) for part in (1, 3)]
    dots = all(cell[2] == "." for cell in cells)
    return "dmy" if dots or late == [True, False] else "mdy" * late[1], ""


def _expanded(found: re.Match[str]) -> str:
    year, month, day, hour, minute, second = found.groups()
    return f"{year}-{month}-{day}T{hour}:{minute or '00'}{':' * bool(second)}{second or ''}"


def _iso(text: str, cell: re.Match[str], order: str, offset: str) -> str:
    parts = dict(zip(order or "ymd" * (len(cell[1]) == 4), cell.group(1, 3, 4), strict=False))
    if len(parts.get("y", "")) != 4:
        return text
    hour, minute, second, half, own = cell.group(5, 6, 7, 8, 9)
    hours = int(hour or 0) % 12 + 12 * (half.upper() == "P") if half else int(hour or 0)
    zone = (own or offset).upper().replace("UTC", "Z")
    return f"{parts['y']}-{parts['m']:0>2}-{parts['d']:0>2}T{hours:02}:{minute or '00'}:{second or '00'}{zone}"


def hint(text: str) -> str:
    """Return the remedy for a date whose order is unknown; empty for any other text."""
    if not (found := _CELL.fullmatch(text.strip())) or len(found.group(1)) == 4:
        return ""
    if len(found.group(4)) != 4:
        return "; give the year with four digits"
    return "; state the order in the title of the column, as time (DD/MM/YYYY hh:mm)"

"""What spreadsheets make of tables: semicolons or tabs, decimal commas, titles with units, dates in an order of theirs.

Nothing is guessed that could be meant in two ways: such a table is refused, and the message says what to write.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from heliosweep.config.units import is_unit

_ENCLOSED = re.compile(r'"[^"]*"|\([^)]*\)|\[[^\]]*\]')
_SEPARATOR = re.compile(r'"?sep=([;,\t])"?[;,\t]*')
_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?")
_POINT = re.compile(r"[-+]?[0-9]*\.[0-9]+([eE][-+]?[0-9]+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")
_TITLE = re.compile(r"(.*\S)\s*[(\[]([^()\[\]]+)[)\]]\s*")
_DATE = re.compile(
    r"([DMY]+)([-/.])([DMY]+)\2([DMY]+)(?:[ T]+HH:MM(?::SS)?)?(?:,? *(Z|UTC|[+-]\d\d:\d\d))?", re.IGNORECASE
)
_CELL = re.compile(r"(\d+)([-/.])(\d+)\2(\d+)(?:[ T]+(\d{1,2}:\d\d(?::\d\d)?))?")
_UNIT = re.compile(r"\bin ([^\s,;]+)|\[([^\[\]]+)\]$")


def told_separator(line: str) -> str:
    """Return what a first line like ``sep=;`` of Excel says; empty for any other line."""
    found = _SEPARATOR.fullmatch(line.strip(" "))
    return found.group(1) if found else ""


def separator_of(header: str) -> str:
    """Return what stands between the titles of a header: a comma, else a semicolon, else a tab."""
    bare = _ENCLOSED.sub("", header)
    return next((mark for mark in (",", ";", "\t") if mark in bare), ",")


def with_points(rows: Sequence[list[str]], separator: str) -> tuple[Sequence[list[str]], tuple[int, str] | None]:
    """Return the rows of a table with a point in numbers that have a decimal comma; or where that cannot be told.

    Parameters
    ----------
    rows : sequence of list of str
        Cells without the header.
    separator : str
        What parts them; between commas, no number has one.

    Returns
    -------
    rows : sequence of list of str
        The same, or with points.
    problem : tuple of int and str, or None
        Row and end of a sentence, where numbers could mean two things.
    """
    if separator == "," or not any("," in cell for row in rows for cell in row):
        return rows, None
    commas = [(at, cell.strip()) for at, row in enumerate(rows) for cell in row if _COMMA.fullmatch(cell.strip())]
    points = ((at, cell.strip()) for at, row in enumerate(rows) for cell in row if _POINT.fullmatch(cell.strip()))
    if commas and (mixed := next(points, None)):
        at, cell = mixed
        return rows, (at, f"has decimal points ({cell}) and decimal commas ({commas[0][1]}); use one of them")
    # Between tabs a comma may part thousands; between semicolons it stands for the decimal point.
    if commas and separator == "\t" and all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        at, cell = commas[0]
        return rows, (
            at,
            f"{cell} may be {cell.replace(',', '.')} or {cell.replace(',', '')}; write numbers with a point",
        )
    return [[_with_point(cell) if "," in cell else cell for cell in row] for row in rows], None


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _COMMA.fullmatch(cell.strip()) else cell


def split_title(title: str) -> tuple[str, str]:
    """Return the name in a title and what stands in brackets behind it: ``X Position (m)``, ``x [m]``."""
    found = _TITLE.fullmatch(title)
    return (found.group(1), found.group(2).strip()) if found else (title, "")


def variable_name(title: str) -> str:
    """Return the name of a variable for a title: small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")


def unit_in(meaning: str) -> str:
    """Return the unit that the description of a column names; empty where it names none."""
    named = [inside or said for said, inside in _UNIT.findall(meaning)]
    return next((name for name in reversed(named) if is_unit(name)), "")


@dataclass(frozen=True)
class DateOrder:
    """Order of day, month and year that a title states, as in ``time (DD/MM/YYYY hh:mm)``.

    Parameters
    ----------
    form : str
        What the title says.
    order : str
        The letters d, m and y in that order.
    offset : str
        Offset from universal time behind it, or empty.
    """

    form: str
    order: str
    offset: str

    @classmethod
    def of(cls, form: str) -> DateOrder | None:
        """Return the order that a text in brackets states; None where it is no form of dates."""
        found = _DATE.fullmatch(form)
        if not found:
            return None
        order = "".join(found.group(number)[0].lower() for number in (1, 3, 4))
        if sorted(order) != ["d", "m", "y"]:
            return None
        offset = found.group(5) or ""
        return cls(form, order, "+00:00" if offset.upper() in ("Z", "UTC") else offset)

    def iso(self, text: str) -> str:
        """Return a cell as ISO 8601; text that has not this form as it is. Raises ValueError for no such day."""
        found = _CELL.fullmatch(text.strip())
        if not found:
            return text
        parts = dict(zip(self.order, (found.group(number) for number in (1, 3, 4)), strict=True))
        if len(parts["y"]) != 4:
            raise ValueError(f"must have the form {self.form}, the year with four digits (got {text[:40]!r})")
        hour, _, rest = (found.group(5) or "0:00").partition(":")
        return f"{parts['y']}-{parts['m']:0>2}-{parts['d']:0>2}T{hour:0>2}:{rest}{self.offset}"


def hint(text: str) -> str:
    """Return what to do about a date whose order nobody states; empty for any other text."""
    if not (found := _CELL.fullmatch(text.strip())) or len(found.group(1)) == 4:
        return ""
    return "; state the order in the title of the column, as time (DD/MM/YYYY hh:mm)"

"""Results as workbooks of Excel."""

from __future__ import annotations

import logging
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from heliosweep.errors import Problem, StudyError, load_extra, printable
from heliosweep.files import written_whole
from heliosweep.share.frames import groups, names_of, to_frame
from heliosweep.store.folder import target_file

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("heliosweep")

#: Rows of a sheet, without its header.
MOST_ROWS = 2**20 - 1
#: Maximum length of the name of a sheet, and invalid letters.
_LETTERS, _NOT_IN_NAMES = 31, r"[\[\]:*?/\\]"
#: Maximum width of a column, and number of cells that determine it. [letters, 1]
_WIDEST, _LOOKED_AT = 80, 100


def write_xlsx(
    result: xr.Dataset,
    path: str | os.PathLike[str],
    variables: str | Sequence[str] | None = None,
    *,
    tables: Mapping[str, pd.DataFrame] | None = None,
    force: bool = False,
) -> Path:
    """Write variables of a result as an Excel workbook.

    Each set of dimensions has a sheet.

    The first sheet lists all variables with units and sheets, and the fixed values.

    Parameters
    ----------
    result : xarray.Dataset
        From `open_result` or `build`; or a part of it.
    path : path
        File to write, ``.xlsx``; appears under its name when it is complete.
    variables : str or sequence of str, optional
        Default: all that fit in a sheet of 1,048,576 rows.
    tables : mapping of str to pandas.DataFrame, optional
        Further sheets, before the variables.
    force : bool
        Whether to replace an existing file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    StudyError
        If the file exists, a variable is unknown, or a named variable has more rows than a sheet.
    HeliosweepError
        If the package openpyxl is not installed, or the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.write_xlsx(data, "table.xlsx").name
    'table.xlsx'
    """
    import pandas as pd

    file = target_file(path, force, endings=(".xlsx",))
    load_extra("openpyxl", "openpyxl", "excel")
    sheets: dict[str, pd.DataFrame] = {"contents": pd.DataFrame()}
    contents = [_line(result, name, value=one.item()) for name, one in result.coords.items() if not one.dims]
    for title, table in (tables or {}).items():
        sheet = _sheet_name(title, sheets)
        sheets[sheet] = table
        contents.append({"sheet": sheet, "meaning": title})
    for dims, names in groups(result[names_of(result, variables)]).items():
        sheet, rows = _sheet_name(" ".join(dims) or "values", sheets), math.prod(result.sizes[dim] for dim in dims)
        if rows <= MOST_ROWS:
            sheets[sheet] = to_frame(result, names, units=True)
        else:
            message = f"has {rows:,} rows, and a sheet of Excel {MOST_ROWS:,}; write it as .csv"
            if variables is not None:
                raise StudyError(Problem(message, names[0]))
            log.warning("left out: %s %s", ", ".join(names), message)
            sheet = "left out: too many rows"
        contents += [_line(result, name, sheet=sheet) for name in names]
    sheets["contents"] = pd.DataFrame(contents, columns=["sheet", "name", "value", "unit", "meaning"])
    with (
        written_whole(file) as temporary,
        temporary.open("wb") as stream,
        pd.ExcelWriter(stream, engine="openpyxl") as book,
    ):
        for name, frame in sheets.items():
            printed = frame.map(lambda cell: printable(cell) if isinstance(cell, str) else cell)
            printed.to_excel(book, sheet_name=name, index=False, freeze_panes=(1, 0))
            _dress(book.sheets[name])
    return file


def _line(result: xr.Dataset, name: Any, **more: Any) -> dict[str, Any]:
    """Return the row of a variable in the contents."""
    attributes = result[name].attrs
    return {"name": name, "unit": attributes.get("units"), "meaning": attributes.get("long_name"), **more}


def _sheet_name(title: str, taken: Iterable[str]) -> str:
    """Name of a sheet that is not taken yet, in any case of letters."""
    name = re.sub(_NOT_IN_NAMES, " ", title).strip(" '")[:_LETTERS] or "table"
    number, others = 1, {one.lower() for one in taken}
    while name.lower() in others:
        number += 1
        name = f"{name[: _LETTERS - 3].rstrip(' 0123456789')} {number}"
    return name


def _dress(sheet: Any) -> None:
    """Fit the width of columns to their content, and store formulas as text."""
    for column in sheet.columns:
        width = max(len(str(cell.value or "")) for cell in column[:_LOOKED_AT])
        sheet.column_dimensions[column[0].column_letter].width = min(width, _WIDEST) + 2
        for cell in column:
            if cell.data_type == "f":  # begins with an equals sign
                cell.data_type = "s"

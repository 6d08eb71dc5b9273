"""Results as pandas tables, CSV files and Excel workbooks, with a row for each point and a column for each variable."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.config import did_you_mean
from heliosweep.errors import Problem, StudyError, load_extra, log, printable
from heliosweep.files import written_whole
from heliosweep.store.folder import target_file


def to_frame(result: xr.Dataset, variables: str | Sequence[str] | None = None, *, units: bool = False) -> pd.DataFrame:
    """Return variables of a result as a table with one row for each point.

    Parameters
    ----------
    result : xarray.Dataset
        Result from `open_result` or `build`, or a part of such a result.
    variables : str or sequence of str, optional
        Variables with equal dimensions (default: all variables, which must then have equal dimensions).
    units : bool
        If True, column titles include units, such as ``x [m]``. The attribute ``attrs["units"]`` of the table always
        contains the units.

    Returns
    -------
    pandas.DataFrame
        Table whose columns are the dimensions, other coordinates along these dimensions, and the variables.

    Raises
    ------
    StudyError
        If a variable is unknown, or variables have different dimensions.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.to_frame(data, "field_optical_efficiency").columns.tolist()
    ['receiver_height', 'field_optical_efficiency']
    """
    chosen = _chosen(result, variables)
    frame, named = _frame(chosen), _named(chosen)
    given = {str(name): one.attrs["units"] for name, one in chosen.variables.items() if "units" in one.attrs}
    frame.attrs["units"] = {named[name] if units else name: str(unit) for name, unit in given.items()}
    return frame.rename(columns=named) if units else frame


def write_csv(
    result: xr.Dataset,
    path: str | os.PathLike[str],
    variables: str | Sequence[str] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write variables of a result to a CSV file, with limited memory use.

    Parameters
    ----------
    result : xarray.Dataset
        Result from `open_result` or `build`, or a part of it.
    path : path
        File to write. It appears under its name only when it is complete. The header includes units, such as ``x [m]``.
        Numbers are written with all digits.
    variables : str or sequence of str, optional
        As in `to_frame`.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists, or as in `to_frame`.
    HeliosweepError
        If the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.write_csv(data, "table.csv", "field_optical_efficiency").name
    'table.csv'
    """
    chosen = _chosen(result, variables)
    file = target_file(path, force)
    with written_whole(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        for number, piece in enumerate(_pieces(chosen, next(iter(chosen.data_vars.values())).dims)):
            form: Any = {"index": False, "lineterminator": "\n", "date_format": "%Y-%m-%dT%H:%M:%S.%f"}
            _frame(piece).rename(columns=_named(chosen)).to_csv(stream, header=not number, **form)
    return file


def groups(result: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Return the names of the variables in groups with equal dimensions, each of which becomes a table."""
    found: dict[tuple[str, ...], list[str]] = {}
    for name, variable in result.data_vars.items():
        found.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    return found


def _chosen(result: xr.Dataset, variables: str | Sequence[str] | None) -> xr.Dataset:
    names = names_of(result, variables)
    # pandas omits the second index along a dimension, such as the names of heliostats
    result = result.drop_indexes([name for name in result.xindexes if name not in result.dims])
    if len({frozenset(result[name].dims) for name in names}) > 1:
        told = "; ".join(f"over {', '.join(dims) or 'nothing'}: {', '.join(of)}" for dims, of in groups(result).items())
        raise StudyError(
            Problem(f"variables with different dimensions do not fit in one table: choose from those {told}")
        )
    dims = result[names[0]].dims
    along = [name for name, label in result.coords.items() if label.dims and set(label.dims) <= set(dims)]
    whole = result[names].transpose(*dims).reset_coords()[[*along, *names]].set_coords(along)
    return whole.assign_coords({dim: np.arange(whole.sizes[dim]) for dim in dims if dim not in whole.coords})


def names_of(result: xr.Dataset, variables: str | Sequence[str] | None) -> list[str]:
    """Return the names of the given variables, or of all variables. Raises StudyError for unknown names."""
    if not (variables is None or isinstance(variables, str | Iterable)):
        raise StudyError(
            Problem(f"must be the name of a variable, or a list of names (got {variables!r})", "variables")
        )
    names = [variables] if isinstance(variables, str) else list(result.data_vars if variables is None else variables)
    if variables is not None and not names:
        raise StudyError(Problem("is an empty list: give variables, or omit it for all variables", "variables"))
    unknown = [name for name in names if name not in result.data_vars]
    if unknown:
        known = ", ".join(map(str, result.data_vars))
        hint = did_you_mean(str(unknown[0]), map(str, result.data_vars)) or f"; the result has {known}"
        raise StudyError(Problem(f"no such variable{hint}", str(unknown[0])))
    if not names:
        raise StudyError(Problem("the result has no variables"))
    return [str(name) for name in names]


def _frame(part: xr.Dataset) -> pd.DataFrame:
    """Return a table with columns in the order of dimensions, other coordinates and variables."""
    part, dims = part.compute(), next(iter(part.data_vars.values())).dims
    if not dims:
        return part.expand_dims("point").to_dataframe().reset_index(drop=True)
    return part.to_dataframe(dim_order=list(dims)).reset_index()


def _pieces(part: xr.Dataset, dims: Sequence[Hashable]) -> Iterator[xr.Dataset]:
    """Yield parts with consecutive rows that fit in memory. The first dimension with several values is halved."""
    dim = next((dim for dim in dims if part.sizes[dim] > 1), None)
    if dim is None or math.prod(part.sizes[dim] for dim in dims) <= 2**17:
        yield part
        return
    half = part.sizes[dim] // 2
    yield from _pieces(part.isel({dim: slice(half)}), dims)
    yield from _pieces(part.isel({dim: slice(half, None)}), dims)


def _named(chosen: xr.Dataset) -> dict[str, str]:
    units = {str(name): one.attrs.get("units", "1") for name, one in chosen.variables.items()}
    return {name: f"{name} [{unit}]" if unit != "1" else name for name, unit in units.items()}


#: Maximum number of rows in an Excel sheet, not counting the header.
MOST_ROWS = 2**20 - 1


def write_xlsx(
    result: xr.Dataset,
    path: str | os.PathLike[str],
    variables: str | Sequence[str] | None = None,
    *,
    tables: Mapping[str, pd.DataFrame] | None = None,
    force: bool = False,
) -> Path:
    """Write variables of a result as an Excel workbook.

    Variables with equal dimensions share a sheet. The first sheet lists all variables with their units and sheets, and
    the fixed values.

    Parameters
    ----------
    result : xarray.Dataset
        Result from `open_result` or `build`, or a part of it.
    path : path
        Excel file (``.xlsx``) to write. It appears under its name only when it is complete.
    variables : str or sequence of str, optional
        Names of variables (default: all variables that fit in a sheet of 1,048,576 rows).
    tables : mapping of str to pandas.DataFrame, optional
        Tables for additional sheets, which precede the sheets of the variables.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists, a variable is unknown, or a requested variable has too many rows for a sheet.
    HeliosweepError
        If the package openpyxl is not installed, or the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.write_xlsx(data, "table.xlsx").name
    'table.xlsx'
    """
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
            message = f"has {rows:,} rows, but an Excel sheet holds {MOST_ROWS:,}: write it as .csv"
            if variables is not None:
                raise StudyError(Problem(message, names[0]))
            log.warning("omitted: %s %s", ", ".join(names), message)
            sheet = "omitted: too many rows"
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
            for column in book.sheets[name].columns:  # width of the first cells, at most 80 characters
                width = max(len(str(cell.value)) for cell in column[:100])
                book.sheets[name].column_dimensions[column[0].column_letter].width = min(width, 80) + 2
                for cell in column:
                    # text that begins with an equals sign must not become a formula
                    cell.data_type = cell.data_type.replace("f", "s")
    return file


def _line(result: xr.Dataset, name: Any, **more: Any) -> dict[str, Any]:
    attributes = result[name].attrs
    return {"name": name, "unit": attributes.get("units"), "meaning": attributes.get("long_name"), **more}


def _sheet_name(title: str, taken: Iterable[str]) -> str:
    """Return an unused name for a sheet. Names that differ only in case count as equal."""
    name = re.sub(r"[\[\]:*?/\\]", " ", title).strip(" '")[:31] or "table"
    number, others = 1, {one.lower() for one in taken}
    while name.lower() in others:
        number += 1
        name = f"{name[:28].rstrip(' 0123456789')} {number}"
    return name

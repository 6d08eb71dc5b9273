"""Results as pandas tables and CSV: a row for each point, a column for each coordinate and variable."""

from __future__ import annotations

import math
import os
from collections.abc import Hashable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.config.faults import did_you_mean
from heliosweep.errors import Problem, StudyError
from heliosweep.files import written_whole
from heliosweep.store.folder import target_file

if TYPE_CHECKING:
    import pandas as pd

#: Rows of a CSV file that are held at a time.
ROWS_AT_A_TIME = 2**17


def to_frame(result: xr.Dataset, variables: str | Sequence[str] | None = None, *, units: bool = False) -> pd.DataFrame:
    """Return variables of a result as a table with one row per point.

    Parameters
    ----------
    result : xarray.Dataset
        From `open_result` or `build`; or a part of it.
    variables : str or sequence of str, optional
        All over the same dimensions; where left out, all variables, if they have the same dimensions.
    units : bool
        Whether the columns are named with their units, ``x [m]``; they are in ``attrs["units"]`` of the table anyway.

    Returns
    -------
    pandas.DataFrame
        Columns: the dimensions, other coordinates along them, the variables.

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
    """Write variables of a result as CSV, in bounded memory.

    Parameters
    ----------
    result : xarray.Dataset
        From `open_result` or `build`; or a part of it.
    path : path
        File to write; appears under its name when it is complete. The header has units, ``x [m]``; numbers are
        written such that they are read back to the last bit.
    variables : str or sequence of str, optional
        As for `to_frame`.
    force : bool
        Whether to replace an existing file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    StudyError
        If the file exists, or as for `to_frame`.
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
        for number, region in enumerate(_regions(chosen)):
            frame = _frame(chosen.isel(region)).rename(columns=_named(chosen))
            said: dict[str, Any] = {"index": False, "header": not number, "date_format": "%Y-%m-%dT%H:%M:%S.%f"}
            frame.to_csv(stream, lineterminator="\n", **said)
    return file


def groups(result: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Return the variables by their dimensions, which share a table."""
    found: dict[tuple[str, ...], list[str]] = {}
    for name, variable in result.data_vars.items():
        found.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    return found


def _chosen(result: xr.Dataset, variables: str | Sequence[str] | None) -> xr.Dataset:
    """Return variables over the same dimensions, and the coordinates along these."""
    names = names_of(result, variables)
    # pandas omits a second index of a dimension, such as the names of heliostats.
    result = result.drop_indexes([name for name in result.xindexes if name not in result.dims])
    sets = {frozenset(result[name].dims) for name in names}
    if len(sets) > 1:
        told = "; ".join(f"over {', '.join(dims) or 'nothing'}: {', '.join(of)}" for dims, of in groups(result).items())
        raise StudyError(
            Problem(f"variables over different dimensions do not fit in one table; choose from those {told}")
        )
    dims = result[names[0]].dims
    along = [name for name, label in result.coords.items() if label.dims and set(label.dims) <= set(dims)]
    whole = result[names].transpose(*dims).reset_coords()[[*along, *names]].set_coords(along)
    return whole.assign_coords({dim: np.arange(whole.sizes[dim]) for dim in dims if dim not in whole.coords})


def names_of(result: xr.Dataset, variables: str | Sequence[str] | None) -> list[str]:
    """Return the names of the given variables, or of all. Raises StudyError."""
    if not (variables is None or isinstance(variables, str | Iterable)):
        raise StudyError(
            Problem(f"must be the name of a variable, or a list of names (got {variables!r})", "variables")
        )
    names = [variables] if isinstance(variables, str) else list(result.data_vars if variables is None else variables)
    if variables is not None and not names:
        raise StudyError(Problem("is an empty list; name variables, or leave it out for all", "variables"))
    unknown = [name for name in names if name not in result.data_vars]
    if unknown:
        known = ", ".join(map(str, result.data_vars))
        hint = did_you_mean(str(unknown[0]), map(str, result.data_vars)) or f"; the result has {known}"
        raise StudyError(Problem(f"no such variable{hint}", str(unknown[0])))
    if not names:
        raise StudyError(Problem("the result has no variables"))
    return [str(name) for name in names]


def _frame(part: xr.Dataset) -> pd.DataFrame:
    """Table of a part, dimensions first, then other coordinates, then variables."""
    part, dims = part.compute(), next(iter(part.data_vars.values())).dims
    if not dims:
        return part.expand_dims("point").to_dataframe().reset_index(drop=True)
    return part.to_dataframe(dim_order=list(dims)).reset_index()


def _regions(chosen: xr.Dataset) -> Iterator[dict[Hashable, slice]]:
    """Cut in pieces of consecutive rows: single positions along the first dimensions, spans along one."""
    first = next(iter(chosen.data_vars.values()))
    inner = len(first.dims)
    while inner and math.prod(first.shape[inner - 1 :]) <= ROWS_AT_A_TIME:
        inner -= 1
    *outer, cut = first.dims[:inner] or (None,)
    if cut is None:
        yield {}
        return
    length = max(1, ROWS_AT_A_TIME // math.prod(first.shape[inner:]))
    for index in np.ndindex(*first.shape[: inner - 1]):
        places = {dim: slice(place, place + 1) for dim, place in zip(outer, index, strict=True)}
        yield from ({**places, cut: slice(start, start + length)} for start in range(0, first.sizes[cut], length))


def _named(chosen: xr.Dataset) -> dict[str, str]:
    """Return the names of columns with their units, except for the unit 1."""
    units = {str(name): one.attrs.get("units", "1") for name, one in chosen.variables.items()}
    return {name: f"{name} [{unit}]" if unit != "1" else name for name, unit in units.items()}

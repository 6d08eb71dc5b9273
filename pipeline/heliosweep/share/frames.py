"""Results as pandas tables and CSV: a row for each point, a column for each coordinate and variable."""

from __future__ import annotations

import math
import os
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.files import written_whole
from heliosweep.share.files import target_file

if TYPE_CHECKING:
    import pandas as pd

#: Rows of a CSV file that are held at a time.
ROWS_AT_A_TIME = 2**17


def to_frame(result: xr.Dataset, variables: str | Sequence[str] | None = None, *, units: bool = False) -> pd.DataFrame:
    """Put variables of a result in a table: a row for each point, coordinates first.

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
        An unknown variable, or variables over different dimensions; says which go together.
    """
    chosen = _chosen(result, variables)
    frame = _frame(chosen, {})
    named = _named(chosen, frame.columns)
    frame.attrs["units"] = {named[key] if units else key: unit for key, unit in _units(chosen).items()}
    return frame.rename(columns=named) if units else frame


def write_csv(
    result: xr.Dataset,
    path: str | os.PathLike[str],
    variables: str | Sequence[str] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write variables of a result as CSV, some rows at a time, so that results of any size fit in memory.

    Parameters
    ----------
    result : xarray.Dataset
        From `open_result` or `build`; or a part of it.
    path : path
        File to write; appears under its name when it is complete. Units stand in the header, ``x [m]``; numbers are
        written such that they are read back to the last bit.
    variables : str or sequence of str, optional
        As for `to_frame`.
    force : bool
        Whether a file that is there is replaced.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    StudyError
        The file is there already, or as for `to_frame`.
    HeliosweepError
        The file cannot be written.
    """
    chosen = _chosen(result, variables)
    file = target_file(path, force)
    with written_whole(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        for number, region in enumerate(_regions(chosen)):
            frame = _frame(chosen, region)
            if not number:
                frame = frame.rename(columns=_named(chosen, frame.columns))
            frame.to_csv(
                stream, index=False, header=not number, lineterminator="\n", date_format="%Y-%m-%dT%H:%M:%S.%f"
            )
    return file


def groups(result: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Variables that have the same dimensions, and so fit in one table."""
    found: dict[tuple[str, ...], list[str]] = {}
    for name, variable in result.data_vars.items():
        found.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    return found


def _chosen(result: xr.Dataset, variables: str | Sequence[str] | None) -> xr.Dataset:
    """Return the variables, and the coordinates along their dimensions."""
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
        raise StudyError(Problem(f"no such variable; the result has {known}", str(unknown[0])))
    if not names:
        raise StudyError(Problem("the result has no variables"))
    sets = {frozenset(result[name].dims) for name in names}
    if len(sets) > 1:
        told = "; ".join(f"over {', '.join(dims) or 'nothing'}: {', '.join(of)}" for dims, of in groups(result).items())
        raise StudyError(
            Problem(f"variables over different dimensions do not fit in one table; choose from those {told}")
        )
    dims = result[names[0]].dims
    along = [name for name, label in result.coords.items() if label.dims and set(label.dims) <= set(dims)]
    return result[names].transpose(*dims).reset_coords(drop=False)[[*along, *names]].set_coords(along)


def _frame(chosen: xr.Dataset, region: Mapping[Hashable, slice]) -> pd.DataFrame:
    """Return a table of a part, dimensions first, then other coordinates, then variables."""
    import pandas as pd

    part = chosen.isel(region).compute()
    dims = next(iter(part.data_vars.values())).dims
    shape = tuple(part.sizes[dim] for dim in dims)
    columns: dict[str, np.ndarray] = {}
    for name in [*dims, *(name for name in part.coords if name not in dims), *part.data_vars]:
        if name in part.variables:
            array = part[name]
        else:  # a dimension without labels: its positions in the whole
            start = region[name].start or 0 if name in region else 0
            array = xr.DataArray(np.arange(start, start + part.sizes[name]), dims=name)
        missing = [dim for dim in dims if dim not in array.dims]
        values = (
            array.expand_dims(missing).transpose(*dims).to_numpy() if missing else array.transpose(*dims).to_numpy()
        )
        columns[str(name)] = np.broadcast_to(values, shape).ravel()
    return pd.DataFrame(columns)


def _regions(chosen: xr.Dataset) -> Iterator[dict[Hashable, slice]]:
    """Cut in pieces of consecutive rows: single positions along the first dimensions, spans along one."""
    first = next(iter(chosen.data_vars.values()))
    dims, shape = first.dims, first.shape
    inner = len(dims)
    while inner and math.prod(shape[inner - 1 :]) <= ROWS_AT_A_TIME:
        inner -= 1
    if not inner:
        yield {}
        return
    cut = dims[inner - 1]
    length = max(1, ROWS_AT_A_TIME // math.prod(shape[inner:]))
    for index in np.ndindex(*shape[: inner - 1]):
        for start in range(0, shape[inner - 1], length):
            outer = {dim: slice(place, place + 1) for dim, place in zip(dims, index, strict=False)}
            yield {**outer, cut: slice(start, start + length)}


def _units(chosen: xr.Dataset) -> dict[str, str]:
    """Units of all columns that have one."""
    everything = {**chosen.coords, **chosen.data_vars}
    given = {str(name): variable.attrs.get("units") for name, variable in everything.items()}
    return {name: str(unit) for name, unit in given.items() if unit is not None}


def _named(chosen: xr.Dataset, columns: Sequence[str] | pd.Index) -> dict[str, str]:
    """Names of columns with their units, of those that have a unit other than one."""
    units = _units(chosen)
    return {name: f"{name} [{units[name]}]" if units.get(name, "1") != "1" else str(name) for name in columns}

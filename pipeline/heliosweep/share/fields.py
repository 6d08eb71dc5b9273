"""Selection of points in results, and tables for layouts and results."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.config import Study, Sweep, did_you_mean, few_of, yaml_text
from heliosweep.errors import Problem, StudyError, load_extra, log, printable
from heliosweep.files import user_path, write_whole, written_whole
from heliosweep.layouts.layout import (
    NAMED_BY_HELIOSTAT,
    PROPERTIES,
    Layout,
    label_of,
    read_csv,
    read_text,
    write_rows,
    write_solarpilot,
)
from heliosweep.layouts.layout import (
    write_csv as write_layout_csv,
)
from heliosweep.layouts.paint import STEPS, PaintSpots
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts
from heliosweep.store.folder import target_file

T = TypeVar("T", xr.DataArray, xr.Dataset)


def chosen(data: T, select: Mapping[str, Any] | None, keep: Sequence[str] = (), *, left: int = 0, hint: str = "") -> T:
    """Select labels along the dimensions of a result.

    Parameters
    ----------
    data : DataArray or Dataset
        Result, or a variable of a result.
    select : mapping of str to value, optional
        Labels to select, keyed by dimension name or dotted study key.
    keep : sequence of str
        Dimensions that need no label.
    left : int
        Maximum number of other dimensions without a label.
    hint : str
        Text appended to the error message if a label is missing. ``{}`` is replaced by the dimension name.

    Returns
    -------
    DataArray or Dataset
        Data at the selected labels. Dimensions of size 1 are removed unless `keep` contains them.

    Raises
    ------
    StudyError
        If a dimension or label does not exist, or if too many dimensions remain.
    """
    for key, value in (select or {}).items():
        name = dimension_of(data, key)
        data = data.sel({name: label(data, name, value)})
    single = {dim: 0 for dim, size in data.sizes.items() if size == 1 and dim not in keep}
    data = data.isel(single)
    others = [str(dim) for dim in data.dims if dim not in keep]
    if len(others) > left:
        known = "; ".join(f"{dim}: {few_of(labels_of(data[dim]))}" for dim in others)
        message = f"choose one value of {' and '.join(others)}{hint.format(others[0])} ({known})"
        raise StudyError(Problem(message, "select"))
    return data


def dimension_of(data: xr.DataArray | xr.Dataset, key: str) -> str:
    """Return the dimension for a dotted study key, such as ``receiver_height`` for ``receiver.height``."""
    parts = str(key).split(".")
    names = ["_".join(parts[start:]) for start in range(len(parts))]
    return next((name for name in names if name in data.dims), str(key))


def labels_of(coordinate: xr.DataArray) -> list[Any]:
    """Return the labels of a dimension for messages, with dates in the shortest form."""
    values = coordinate.to_numpy()
    return list(np.datetime_as_string(values, unit="auto") if values.dtype.kind == "M" else values.tolist())


def label(data: xr.DataArray | xr.Dataset, name: str, value: Any) -> Any:
    """Return the label along a dimension that matches a value, for example a heliostat name.

    Raises StudyError if no label or several labels match.
    """
    if name not in data.dims:
        dims = ", ".join(map(str, data.dims))
        raise StudyError(Problem(f"is not a dimension of the result, which has {dims}", f"select.{name}"))
    labels, known = data[name].to_numpy(), list(map(str, labels_of(data[name])))
    if name == "heliostat" and "name" in data.coords and isinstance(value, str):
        known = list(map(str, data["name"].to_numpy()))
        named = [number for number, own in zip(labels.tolist(), known, strict=True) if own == value]
        if len(named) > 1:
            message = f"is the name of {len(named)} heliostats; choose a number: {few_of(named)} (got {value})"
            raise StudyError(Problem(message, "select.heliostat"))
        if named:
            return named[0]
    is_text = labels.dtype.kind in "OU"
    with suppress(ValueError, TypeError, OverflowError):
        same = labels.astype(str) == str(value) if is_text else labels == np.asarray(value).astype(labels.dtype)
        if same.any() and (is_text or labels.dtype.kind == "M" or float(value) == labels[same][0]):
            return (
                labels[same][0] if labels.dtype.kind == "M" else labels[same][0].item() if not is_text else str(value)
            )
    hint = did_you_mean(str(value), known) if is_text else ""
    message = f"is not in the result{hint or f'; choose from {few_of(known)}'} (got {value})"
    raise StudyError(Problem(message, f"select.{name}"))


#: Variables in a corrections table that contain residuals.
_RESIDUALS = (
    *("uncalibrated_beam_residual_rms", "beam_residual_rms"),
    *("uncalibrated_held_out_residual_rms", "held_out_residual_rms"),
)
#: Comment lines at the beginning of a corrections table.
_CORRECTIONS = (
    "Mount errors. Subtract azimuth_reference and elevation_reference from commanded angles or steps, or add them",
    "to the encoder readings. The effects of the other errors vary with the angles: correct them with a model in the",
    "controller, or use the commands corrected_azimuth and corrected_elevation of the result. Steps are for the mean",
    "motor positions. Residuals are root mean square angles of the beam, which are twice the angles of the mirror.",
)


def read_layout(path: str | os.PathLike[str]) -> Layout:
    """Read a layout from a CSV file or a SolarPILOT file.

    Parameters
    ----------
    path : path
        Layout file to read.

    Returns
    -------
    Layout
        Positions of the heliostats [m] and all other columns of the file.

    Raises
    ------
    StudyError
        If the file is invalid. The message lists all problems with their line numbers.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.read_layout("layout.csv").x.size
    20
    """
    return read_csv(user_path(path))


def write_paint_spots(spots: PaintSpots, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write spots as a table for the ``calibration.spots`` key.

    The notes in `spots` are written as comments above the table.

    Parameters
    ----------
    spots : PaintSpots
        Spots and notes to write.
    path : path
        File to write atomically.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists.
    HeliosweepError
        If the file cannot be written.
    """
    file = target_file(path, force)
    rows = zip(*(values.tolist() for values in spots.columns.values()), strict=True)
    write_rows([tuple(spots.columns), *rows], file, spots.notes)
    return file


def write_corrections(
    result: xr.Dataset, path: str | os.PathLike[str], select: Mapping[str, Any] | None = None, *, force: bool = False
) -> Path:
    """Write estimated mount errors as a corrections table with one row for each heliostat.

    Angles are in degrees. If the layout has the columns ``azimuth_steps`` and ``elevation_steps``, the angles are also
    given in actuator steps. The first lines of the file explain the signs.

    Parameters
    ----------
    result : xarray.Dataset
        Result of the family `misalignment` with estimated errors.
    path : path
        Output CSV file, written atomically.
    select : mapping of str to value, optional
        Value along each dimension that distinguishes calibrations, such as ``{"parameters": 4}``.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the result is not a calibration, if several calibrations remain after selection, or if the file exists.
    HeliosweepError
        If the file cannot be written.
    """
    if "estimated_error" not in result or "heliostat" not in result["estimated_error"].dims:
        raise StudyError(Problem("the result is not a calibration: it has no variable estimated_error over heliostats"))
    steps = [name for name in STEPS if name in result.coords]
    given = label_of(result.coords)
    names = [given, "estimated_error", "standard_error", "calibration_status", "spots_used", *_RESIDUALS, *steps]
    here = chosen(result.reset_coords()[[name for name in names if name in result]], select, ("heliostat", "parameter"))
    columns: dict[str, Any] = {"heliostat": here[given].to_numpy()}
    for name in map(str, here["parameter"].to_numpy()):
        error, spread = (
            np.degrees(1e-3 * here[which].sel(parameter=name).to_numpy())
            for which in ("estimated_error", "standard_error")
        )
        if np.isfinite(error).any():
            columns |= {f"{name} [deg]": error.round(5), f"{name} standard error [deg]": spread.round(5)}
            if (axis := name.replace("_reference", "_steps")) in steps:
                columns[f"{name} [steps]"] = (error * here[axis].to_numpy()).round(1)
    status = here["calibration_status"]
    words = dict(zip(status.attrs["flag_values"].tolist(), str(status.attrs["flag_meanings"]).split(), strict=True))
    columns["status"] = [words[code].replace("_", " ") for code in status.to_numpy().tolist()]
    columns |= {f"{name} [{here[name].attrs['units']}]": here[name].to_numpy().round(3)
                for name in ("spots_used", *_RESIDUALS) if name in here}  # fmt: skip
    file = target_file(path, force)
    rows = [
        ["" if value != value else value for value in row] for row in zip(*map(list, columns.values()), strict=True)
    ]
    write_rows([[*columns], *rows], file, _CORRECTIONS)
    return file


def write_paint_study(spots: PaintSpots, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a study that calibrates heliostats from PAINT data, with a layout file and a spots file.

    Parameters
    ----------
    spots : PaintSpots
        Spots and positions of the heliostats, relative to the same target.
    path : path
        Study file, such as ``juelich.yaml``. The files ``juelich_layout.csv`` and ``juelich_spots.csv`` are written to
        the same folder.
    force : bool
        If True, replace existing files.

    Returns
    -------
    pathlib.Path
        Path of the study file.

    Raises
    ------
    StudyError
        If one of the files exists.
    HeliosweepError
        If one of the files cannot be written.
    """
    file = target_file(path, force, endings=(".yaml", ".yml"))
    layout, table = (file.with_name(f"{file.stem}_{what}.csv") for what in ("layout", "spots"))
    write_layout(spots.plant.layout, layout, force=force)
    write_paint_spots(spots, table, force=force)
    number = Counter(spots.columns["heliostat"].tolist())
    content = {
        "family": "misalignment", "mode": "calibration", "title": f"Calibration of {spots.plant.layout.name}",
        "site": spots.plant.site,
        "time": {"clock": "solar", "days": [80], "hours": {"start": 8, "stop": 16, "step": 1}},
        "receiver": {key: value for key, value in spots.plant.receiver.items() if key != "kind"},
        "layout": {"file": layout.name}, "mount": spots.mount,
        "calibration": {"spots": table.name, "parameters": 4 if min(number.values()) > 2 else 2},
    }  # fmt: skip
    write_whole(file, yaml_text(content))
    return file


def layout_of(study: Study | xr.Dataset, select: Mapping[str, Any] | None = None) -> Layout:
    """Return the layout of a study or a result.

    Mirror sizes that are fixed in the study are added to the layout as columns.

    Parameters
    ----------
    study : Study or xarray.Dataset
        Study with one layout, or result of a study. If the result has `keep`, the layout contains the kept heliostats.
    select : mapping of str to value, optional
        Value along each dimension that affects the layout of a result.

    Raises
    ------
    StudyError
        If the study or result has no layout or several layouts.

    Examples
    --------
    >>> import heliosweep
    >>> layout = heliosweep.layout_of(heliosweep.load("one_tower.yaml"))
    >>> layout.x.size
    20
    """
    if not isinstance(study, Study):
        return _layout_of_result(study, select or {})
    if getattr(study, "layout", None) is None:
        raise StudyError(study.problem("layout", "is missing: the study has no heliostat field"))
    layouts = Layouts(study)
    if layouts.dimensions:
        swept = next(iter(layouts.dimensions[0].sweeps))
        raise StudyError(study.problem(swept, "is swept, so there are several layouts: specify one value"))
    layout = layouts[()]
    heliostat: Any = getattr(study, "heliostat", None)
    sides: dict[str, Any] = {side: getattr(heliostat, side, None) for side in SIZE_COLUMNS}
    given = {side: size for side, size in sides.items() if size is not None and not isinstance(size, Sweep)}
    fixed = {side: np.full(len(layout), float(size)) for side, size in given.items()}
    return Layout(layout.x, layout.y, layout.z, {**layout.columns, **fixed}, layout.name, layout.lines)


def kept_field(result: xr.Dataset, select: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return study changes that remove the unused heliostats of a result.

    Heliostats are unused if `keep` did not select them or if they have no aim point.

    Raises StudyError if the result has several fields and `select` does not specify one.
    """
    along, select = result["kept" if "kept" in result else "x"], select or {}
    layout = layout_of(result, {key: select[key] for key in select if dimension_of(along, key) in along.dims})
    table = {"x": layout.x, "y": layout.y, "z": layout.z}
    table |= {name: values for name, values in layout.columns.items() if name in PROPERTIES}
    changes: dict[str, Any] = {"keep": None} if "kept" in result else {}
    if "aim_x" in result.data_vars:
        aims = chosen(result[["aim", "aim_x", "aim_y", "aim_z"]], select, ("heliostat",)).to_dataframe()
        aims = aims[np.isfinite(aims["aim_x"])]
        works = aims["aim"].to_numpy() >= 0
        table = {name: values[works] for name, values in table.items()}
        table |= {name: aims[name].to_numpy()[works] for name in ("aim_x", "aim_y", "aim_z")}
        changes["aim"] = {"strategy": "layout"}
    return {"layout": {name: values.tolist() for name, values in table.items()}, **changes}


def _layout_of_result(result: xr.Dataset, select: Mapping[str, Any]) -> Layout:
    if "heliostat" not in result.dims or not {"x", "y", "z"} <= set(result.coords):
        raise StudyError(Problem("the result has no heliostat field"))
    along = [name for name, one in result.coords.items() if "heliostat" in one.dims and name != "heliostat"]
    sizes = [f"heliostat_{name}" for name in NAMED_BY_HELIOSTAT if f"heliostat_{name}" in result.coords]
    names = dict.fromkeys([*along, *sizes, *(["kept"] if "kept" in result else [])])
    here = chosen(result.reset_coords()[list(names)], select, ("heliostat",))
    there = np.isfinite(here["x"].to_numpy()) & (here["kept"].to_numpy() == 1 if "kept" in here else True)
    columns: dict[str, Any] = {
        str(name).removeprefix("heliostat_" * (name in sizes)): np.broadcast_to(one.to_numpy(), there.shape)[there]
        for name, one in here.drop_vars("kept", errors="ignore").data_vars.items()
    }
    columns = {name: values.astype(str) if values.dtype == object else values for name, values in columns.items()}
    x, y, z = (columns.pop(axis) for axis in "xyz")
    return Layout(x, y, z, columns, str(result.attrs.get("title", "")))


def write_layout(
    layout: Layout | pd.DataFrame,
    path: str | os.PathLike[str],
    form: Literal["solarpilot", "csv"] = "csv",
    *,
    force: bool = False,
) -> Path:
    """Write a layout to a file. `read_layout` restores identical numbers from the file.

    Parameters
    ----------
    layout : Layout or pandas.DataFrame
        Heliostats to write. A DataFrame must have the columns ``x`` and ``y`` [m]. Other columns of a layout, such as
        ``z``, are optional.
    path : path
        File to write atomically.
    form : {"csv", "solarpilot"}
        Format of the file. The format ``csv`` is a table with a header and all columns. The format ``solarpilot`` is a
        user-defined SolarPILOT layout, which contains only positions, templates, focal lengths, canting and aim points.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists, or if the DataFrame is not a layout.
    HeliosweepError
        If the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> layout = heliosweep.layout_of(heliosweep.load("one_tower.yaml"))
    >>> heliosweep.write_layout(layout, "field.csv").name
    'field.csv'
    """
    if form not in ("csv", "solarpilot"):
        raise StudyError(Problem(f"unknown form {form!r}: use 'csv' or 'solarpilot'"))
    file = target_file(path, force)
    if not isinstance(layout, Layout):
        layout = read_text(layout.to_csv(index=False), "DataFrame")
    (write_solarpilot if form == "solarpilot" else write_layout_csv)(layout, file)
    return file


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
        Table with columns for the dimensions, other coordinates along these dimensions, and the variables.

    Raises
    ------
    StudyError
        If a variable is unknown, or if variables have different dimensions.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.to_frame(data, "field_optical_efficiency").columns.tolist()
    ['receiver_height', 'field_optical_efficiency']
    """
    part = _one_table(result, variables)
    frame, named = _frame(part), _named(part)
    given = {str(name): one.attrs["units"] for name, one in part.variables.items() if "units" in one.attrs}
    frame.attrs["units"] = {named[name] if units else name: str(unit) for name, unit in given.items()}
    return frame.rename(columns=named) if units else frame


def write_csv(
    result: xr.Dataset,
    path: str | os.PathLike[str],
    variables: str | Sequence[str] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write variables of a result to a CSV file with limited memory use.

    Parameters
    ----------
    result : xarray.Dataset
        Result from `open_result` or `build`, or a part of it.
    path : path
        Output CSV file, written atomically. The header includes units, such as ``x [m]``. Numbers are written with all
        digits.
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
        If the file exists, if a variable is unknown, or if variables have different dimensions.
    HeliosweepError
        If the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     heliosweep.write_csv(data, "table.csv", "field_optical_efficiency").name
    'table.csv'
    """
    part = _one_table(result, variables)
    file = target_file(path, force)
    with written_whole(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        for number, piece in enumerate(_pieces(part, next(iter(part.data_vars.values())).dims)):
            form: Any = {"index": False, "lineterminator": "\n", "date_format": "%Y-%m-%dT%H:%M:%S.%f"}
            _frame(piece).rename(columns=_named(part)).to_csv(stream, header=not number, **form)
    return file


def groups(result: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Group the names of the variables by dimensions. Each group becomes a table."""
    found: dict[tuple[str, ...], list[str]] = {}
    for name, variable in result.data_vars.items():
        found.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    return found


def _one_table(result: xr.Dataset, variables: str | Sequence[str] | None) -> xr.Dataset:
    """Return the variables with all coordinates along their dimensions. Raises StudyError if the dimensions differ."""
    names = names_of(result, variables)
    # pandas omits a second index along a dimension, such as heliostat names
    result = result.drop_indexes([name for name in result.xindexes if name not in result.dims])
    if len({frozenset(result[name].dims) for name in names}) > 1:
        told = "; ".join(f"over {', '.join(dims) or 'nothing'}: {', '.join(of)}" for dims, of in groups(result).items())
        raise StudyError(
            Problem(f"variables with different dimensions do not fit in one table: choose from the variables {told}")
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
        raise StudyError(
            Problem("is an empty list: specify variables, or omit the argument for all variables", "variables")
        )
    unknown = [name for name in names if name not in result.data_vars]
    if unknown:
        known = ", ".join(map(str, result.data_vars))
        hint = did_you_mean(str(unknown[0]), map(str, result.data_vars)) or f"; the result has {known}"
        raise StudyError(Problem(f"no such variable{hint}", str(unknown[0])))
    if not names:
        raise StudyError(Problem("the result has no variables"))
    return [str(name) for name in names]


def _frame(part: xr.Dataset) -> pd.DataFrame:
    """Return a table whose columns are dimensions, other coordinates and variables, in this order."""
    part, dims = part.compute(), next(iter(part.data_vars.values())).dims
    if not dims:
        return part.expand_dims("point").to_dataframe().reset_index(drop=True)
    return part.to_dataframe(dim_order=list(dims)).reset_index()


def _pieces(part: xr.Dataset, dims: Sequence[Hashable]) -> Iterator[xr.Dataset]:
    """Yield parts of at most 2**17 consecutive rows. Larger parts are halved along the first dimension."""
    dim = next((dim for dim in dims if part.sizes[dim] > 1), None)
    if dim is None or math.prod(part.sizes[dim] for dim in dims) <= 2**17:
        yield part
        return
    half = part.sizes[dim] // 2
    yield from _pieces(part.isel({dim: slice(half)}), dims)
    yield from _pieces(part.isel({dim: slice(half, None)}), dims)


def _named(part: xr.Dataset) -> dict[str, str]:
    units = {str(name): one.attrs.get("units", "1") for name, one in part.variables.items()}
    return {name: f"{name} [{unit}]" if unit != "1" else name for name, unit in units.items()}


#: Maximum number of rows in an Excel sheet, excluding the header.
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
        Excel file (``.xlsx``) to write atomically.
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
        If the file exists, if a variable is unknown, or if a requested variable has too many rows for a sheet.
    HeliosweepError
        If the package `openpyxl` is not installed, or if the file cannot be written.

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
            for column in book.sheets[name].columns:  # widest of the first 100 cells, at most 80 characters
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
    """Return an unused sheet name. Names that differ only in case are considered equal."""
    name = re.sub(r"[\[\]:*?/\\]", " ", title).strip(" '")[:31] or "table"
    number, others = 1, {one.lower() for one in taken}
    while name.lower() in others:
        number += 1
        name = f"{name[:28].rstrip(' 0123456789')} {number}"
    return name

"""One page over several results: numbers, inputs, curves on the same axes, and difference maps."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import xarray as xr

from heliosweep.config.study import Study
from heliosweep.files import user_path, write_whole
from heliosweep.report.coverage import coverage
from heliosweep.report.draw import draw
from heliosweep.report.figures import HELIOSTAT, Curves, Figure, Maps, default_figures
from heliosweep.report.inputs import MOST_ROWS, entries
from heliosweep.report.labels import NOTHING, is_quantity, labels_along, printed, title_of, unit_of, value_text
from heliosweep.report.page import PAGE, FamilyOf, embeddable, render, study_of
from heliosweep.report.style import pixels
from heliosweep.report.tables import Column, Table, ranges
from heliosweep.store.read import check_digest, locate, open_result
from heliosweep.store.targets import target_file

#: Dimension of the results.
RESULT = "result"
#: Number of variables and of points in the table of results, and size of a variable that is read.
MOST_VARIABLES, MOST_POINTS, MOST_NUMBERS = 12, 80, 8_000_000
#: Relative difference that is rounding, and number of decimals in which labels must agree.
ROUNDING, LABEL_DECIMALS = 1e-12, 9


def write_comparison(
    places: Sequence[str | os.PathLike[str]], page: str | os.PathLike[str], family_of: FamilyOf, *, force: bool = False
) -> Path:
    """Write one page over several results, as `heliosweep.comparison_page`; `family_of` returns their families."""
    file = target_file(page, force, endings=(".html",), sources=places)
    for place in places:
        check_digest(locate(place))
    names = [chr(ord("A") + number) if number < 26 else str(number + 1) for number in range(len(places))]
    with ExitStack() as opened:
        results = {}
        for name, place in zip(names, places, strict=True):
            results[name] = opened.enter_context(open_result(place))
        text = _page(list(map(user_path, places)), results, family_of, file)
    write_whole(file, text)
    return file


def _page(places: Sequence[Path], results: Mapping[str, xr.Dataset], family_of: FamilyOf, file: Path) -> str:
    folders = [place if place.is_dir() and place.suffix != ".zarr" else place.parent for place in places]
    families = [family_of(result) for result in results.values()]
    studies = [study_of(folder, family) for folder, family in zip(folders, families, strict=True)]
    covers = [coverage(result, study) for result, study in zip(results.values(), studies, strict=True)]
    family, first = families[0], next(iter(results.values()))
    names = family.headlines if family else ()
    joined = together(results)
    same = HELIOSTAT not in joined.sizes or all(RESULT not in joined[side].dims for side in "xy" if side in joined)
    declared = list(family.figures(first) if family else default_figures(joined))
    drawn = (
        draw(joined, [one for one in (_compared(each, same) for each in declared) if one]) if joined.data_vars else ()
    )
    remarks = [] if joined.data_vars else ["These results have no points in common: the table has the ranges of each."]
    remarks += [] if same else ["The heliostats of the results differ: there are maps, but no difference maps."]
    return render(
        "several.html",
        title=f"{len(results)} results compared",
        results=[_entry(*one, file) for one in zip(results, folders, results.values(), strict=True)],
        remarks=remarks,
        went_in=_inputs(list(results), list(zip(studies, covers, strict=True))).printed(),
        tables=[one.printed() for one in [numbers(joined, names)] if one] or [_ranges(results, names).printed()],
        figures=[embeddable(one, pixels(one.figure)) for one in drawn],
    )


def _entry(name: str, folder: Path, result: xr.Dataset, file: Path) -> dict[str, str]:
    """Return name, title and link of a result."""
    page = folder / PAGE
    link = quote(Path(os.path.relpath(page, file.parent)).as_posix()) if page.is_file() else ""
    title = str(result.attrs.get("title", folder.name))
    return {"name": name, "title": title, "about": folder.resolve().name, "link": link}


def _compared(figure: Figure, same: bool) -> Figure | None:
    """Return the figure of one result as a figure of several: a line or a map for each, and differences."""
    if isinstance(figure, Curves):
        return replace(figure, lines=(RESULT,))
    less = RESULT if same else ""
    return replace(figure, lines=(RESULT,), less=less) if isinstance(figure, Maps) and not figure.each else None


def together(results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the numbers that all results have, at their common points, along a dimension of results.

    Parameters
    ----------
    results : mapping of str to Dataset
        Results by name. A key that is swept in one result and fixed in another counts as swept over one value.

    Returns
    -------
    xarray.Dataset
        Over ``result`` and the dimensions of the results; without variables if they have none in common.
    """
    every = list(results.values())
    names = [str(name) for name in every[0].data_vars if all(_is_number(one, str(name)) for one in every)]
    swept = {name: {dim for one in every for dim in one[name].dims} for name in names}
    alike = [_expanded(one[names], swept) for one in every]
    names = [name for name in names if all({*one[name].dims} == swept[name] for one in alike)]
    alike = [one[names] for one in alike]
    labels = set.intersection(*({*one.coords} for one in alike))
    alike = [one.drop_vars({*one.coords} - labels) for one in alike]
    loose = {HELIOSTAT, *(dim for one in alike for dim in one.dims if dim not in one.indexes)}
    alike = list(xr.align(*alike, join="inner", exclude=loose))
    sizes = [one.sizes for one in alike]
    lost = {
        dim
        for dim in sizes[0]
        if not sizes[0][dim] or (dim != HELIOSTAT and len({size.get(dim) for size in sizes}) > 1)
    }
    alike = [one.drop_dims(lost) for one in alike]
    along = xr.IndexVariable(RESULT, list(results), {"long_name": "result"})
    return xr.concat(
        alike, along, data_vars="all", coords="different", compat="equals", join="outer", combine_attrs="override"
    ).transpose(RESULT, ...)


def _is_number(result: xr.Dataset, name: str) -> bool:
    return name in result.data_vars and is_quantity(result[name]) and result[name].size <= MOST_NUMBERS


def _expanded(result: xr.Dataset, swept: Mapping[str, set[Any]]) -> xr.Dataset:
    """Return a result over the dimensions that another one has swept, with rounded labels."""
    fixed = {dim for dims in swept.values() for dim in dims if dim in result.coords and not result[dim].ndim}
    grown = {}
    for name, one in result.data_vars.items():
        grows = swept[str(name)] & fixed
        grown[name] = one.drop_vars(fixed - grows).expand_dims([*grows])
    coords = {name: one.variable for name, one in result.coords.items() if name not in fixed}
    result = xr.Dataset(grown, coords, result.attrs)
    if HELIOSTAT in result.sizes and HELIOSTAT not in result.coords:
        result = result.assign_coords({HELIOSTAT: np.arange(result.sizes[HELIOSTAT])})
    floats = [name for name in result.indexes if result[name].dtype.kind == "f"]
    return result.assign_coords(
        {name: result[name].copy(data=result[name].to_numpy().round(LABEL_DECIMALS)) for name in floats}
    )


def numbers(joined: xr.Dataset, names: Sequence[str]) -> Table | None:
    """Tabulate the numbers of the whole at every common point, with their differences from the first result."""
    known = [name for name in names if name in joined.data_vars]
    first = next(iter(known), None) or min(map(str, joined.data_vars), key=lambda name: joined[name].ndim, default=None)
    if first is None:
        return None
    dims = [str(dim) for dim in joined[first].dims if dim != RESULT]
    same = [str(name) for name, one in joined.data_vars.items() if name != first and {*one.dims} == {RESULT, *dims}]
    points = list(np.ndindex(*(joined.sizes[dim] for dim in dims)))[:MOST_POINTS]
    places = [
        ", ".join(value_text(labels_along(joined, dim)[i]) for dim, i in zip(dims, point, strict=True))
        for point in points
    ]
    results = [str(name) for name in joined[RESULT].to_numpy()]
    rows: list[tuple[str, str, str, np.ndarray]] = []
    for name in [first, *same][:MOST_VARIABLES]:
        values = np.asarray(printed(joined[name].transpose(RESULT, *dims)), dtype=float).reshape(len(results), -1)
        rows += [(title_of(joined[name]), place, unit_of(joined[name]), values[:, i]) for i, place in enumerate(places)]
    rows = rows[:MOST_POINTS]
    columns = [Column("", [row[0] for row in rows])]
    columns += [Column("at", [row[1] for row in rows])] if any(places) else []
    cells = [[f"{value:.6g}" for value in row[3]] for row in rows]
    columns += [Column(name, [row[i] for row in cells]) for i, name in enumerate(results)]
    for i, name in enumerate(results[1:], 1):
        columns.append(Column(f"{name} \N{MINUS SIGN} {results[0]}", [_difference(row[3], i, row[2]) for row in rows]))
    columns.append(Column("unit", [row[2] for row in rows]))
    return Table("Results", columns, ["Differences of percentages are in percentage points."])


def _difference(values: np.ndarray, place: int, unit: str) -> str:
    """Return the difference from the first value, also relative to it if it is no percentage."""
    difference = values[place] - values[0]
    if not abs(difference) > ROUNDING * abs(values[0]):
        return "0" if np.isfinite(difference) else NOTHING
    share = f" ({100 * difference / values[0]:+.3g} %)" if values[0] and unit != "%" else ""
    return f"{difference:+.4g}{share}".replace("-", "\N{MINUS SIGN}")


def _inputs(names: Sequence[str], inputs: Sequence[tuple[Study | None, Sequence[tuple[str, str]]]]) -> Table:
    """Tabulate the inputs of several studies, a column for each, differences first."""
    texts: dict[str, list[str]] = {}
    given: set[str] = set()
    for number, (study, covers) in enumerate(inputs):
        rows = [([name, text, "", ""], True) for name, text in covers]
        rows += entries(study) if isinstance(study, Study) else []
        for (name, text, how, key), asked in rows:
            cells = texts.setdefault(key or name, [name, *(NOTHING for _ in inputs), key])
            cells[1 + number] = text if how in ("", "fixed") else f"{text} ({how})"
            given |= {key or name} if asked else set()
    differ = {key for key, cells in texts.items() if len({*cells[1:-1]}) > 1}
    order = [key for key in texts if key in differ][:MOST_ROWS]
    equal = len([key for key in texts if key in given - differ])
    heads = ["", *names, "key of the study"]
    columns = [
        Column(head, [texts[key][i] for key in order] or ["no difference"] * (i == 0) or [""])
        for i, head in enumerate(heads)
    ]
    return Table("Inputs", columns, [f"{equal} further inputs are equal."])


def _ranges(results: Mapping[str, xr.Dataset], names: Sequence[str]) -> Table:
    """Tabulate the ranges of each result."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name, result in results.items():
        title, low, _, high, unit = (column.values for column in ranges(result, names).columns)
        for i, text in enumerate(title):
            found.setdefault((text, unit[i]), {})[name] = low[i] if low[i] == high[i] else f"{low[i]} to {high[i]}"
    columns = [Column("", [key[0] for key in found])]
    columns += [Column(name, [cells.get(name, NOTHING) for cells in found.values()]) for name in results]
    return Table("Ranges", [*columns, Column("unit", [key[1] for key in found])])

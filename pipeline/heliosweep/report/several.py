"""Pages that compare several results with curves on the same axes, and the index of all studies in a folder."""

from __future__ import annotations

import json
import os
import string
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.errors import HeliosweepError, log
from heliosweep.files import user_path, write_whole
from heliosweep.report import comparison
from heliosweep.report.context import NOTHING, Context, is_quantity, printed, title_of, unit_of
from heliosweep.report.figures import HELIOSTAT, Curves, Figure, Maps, default_figures
from heliosweep.report.page import PAGE, embedded, render
from heliosweep.report.tables import Column, Table, columns_of, ranges
from heliosweep.store.folder import OUTPUTS, page_head, read_manifest, status_of, unfinished

#: Dimension along which the results are joined.
RESULT = "result"
#: Maximum number of variables and of points in the table of results, and maximum size of a variable.
MOST_VARIABLES, MOST_POINTS, MOST_NUMBERS = 12, 80, 2_000_000
#: Relative difference that counts as rounding, and number of decimals in which labels must agree.
ROUNDING, LABEL_DECIMALS = 1e-12, 9


class Compared(NamedTuple):
    """Path, data set and family of a result to compare."""

    path: Path
    data: xr.Dataset
    family: Any = None


def _entry(compared: Compared, file: Path) -> dict[str, str]:
    """Return the title and folder of a result, and a link from `file` to the page of the result if it exists."""
    folder = compared.path if compared.path.is_dir() else compared.path.parent
    page, title = folder / PAGE, str(compared.data.attrs.get("title", folder.name))
    link = quote(Path(os.path.relpath(page, file.parent)).as_posix()) if page.is_file() else ""
    return {"title": title, "about": folder.resolve().name, "link": link}


def write_comparison(compared: Sequence[Compared], file: Path) -> Path:
    """Write a page that compares several results with the figures that the family of the first result declares."""
    from heliosweep.report.draw import draw

    names = [*string.ascii_uppercase, *map(str, range(27, len(compared) + 1))][: len(compared)]
    results, family = dict(zip(names, (one.data for one in compared), strict=True)), compared[0].family
    headlines = family.headlines if family else ()
    joined = together(results)
    same = HELIOSTAT not in joined.sizes or all(RESULT not in joined[side].dims for side in "xy" if side in joined)
    declared = family.figures(compared[0].data) if family else default_figures(joined)
    figures = list(draw(joined, _over_results(declared, same))) if joined.data_vars else []
    remarks = [] if joined.data_vars else ["These results have no points in common; a table shows the ranges of each."]
    remarks += [] if same else ["The heliostats of the results differ; there are maps, but no difference maps."]
    tables = [replace(ranges(one, headlines), notes=[f"Ranges of result {name}."]) for name, one in results.items()]
    tables = [numbers(joined, headlines)] if joined.data_vars else tables
    text = render(
        "several.html",
        title=f"{len(results)} results compared",
        results=[{"name": name, **_entry(one, file)} for name, one in zip(names, compared, strict=True)],
        remarks=remarks,
        went_in=_inputs(results).printed(),
        tables=[table.printed() for table in tables],
        figures=[embedded(figure) for figure in figures],
    )
    write_whole(file, text)
    return file


def _over_results(figures: Iterator[Figure], same: bool) -> Iterator[Figure]:
    """Yield figures with a line or a map for each result, and figures of the differences between maps."""
    for figure in figures:
        if isinstance(figure, Curves):
            yield replace(figure, lines=(RESULT,))
        elif isinstance(figure, Maps) and not figure.each:
            yield replace(figure, lines=(RESULT,), less=RESULT if same else "")


def together(results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the common variables of results at their common points, joined along the dimension ``result``.

    Parameters
    ----------
    results : mapping of str to Dataset
        Results by name. A key that is swept in one result and fixed in another counts as swept over one value.

    Returns
    -------
    xarray.Dataset
        Data set over ``result`` and the dimensions of the results, without variables if the results have none in
        common.
    """
    every = [
        one[[name for name, array in one.data_vars.items() if is_quantity(array) and array.size <= MOST_NUMBERS]]
        for one in results.values()
    ]
    names = [name for name in every[0].data_vars if all(name in one for one in every)]
    swept = {name: {dim for one in every for dim in one[name].dims} for name in names}
    alike = [_expanded(one[names], swept) for one in every]
    names = [name for name in names if all({*one[name].dims} == swept[name] for one in alike)]
    labels = set.intersection(*({*one[names].coords} for one in alike))
    alike = [one[names].drop_vars({*one[names].coords} - labels) for one in alike]
    along = xr.IndexVariable(RESULT, list(results), {"long_name": "result"})
    how: Any = {"data_vars": "all", "coords": "different", "compat": "equals", "combine_attrs": "override"}
    return xr.concat(_aligned(alike), along, join="outer", **how).transpose(RESULT, ...)


def _aligned(results: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return results at their common points, without dimensions that have no common values."""
    loose = {HELIOSTAT, *(dim for one in results for dim in one.dims if dim not in one.indexes)}
    alike = list(xr.align(*results, join="inner", exclude=loose))
    sizes = {dim: {one.sizes.get(dim) for one in alike} for dim in alike[0].dims}
    lost = {dim for dim, found in sizes.items() if 0 in found or (dim != HELIOSTAT and len(found) > 1)}
    return [one.drop_dims(lost) for one in alike]


def _expanded(result: xr.Dataset, swept: Mapping[Any, set[Any]]) -> xr.Dataset:
    """Return a result with rounded labels, expanded along all dimensions that are swept in any result."""
    fixed = {dim for dims in swept.values() for dim in dims if dim in result.coords and not result[dim].ndim}
    grown = {
        name: one.drop_vars(fixed - swept[name]).expand_dims([*(swept[name] & fixed)])
        for name, one in result.data_vars.items()
    }
    coords = {name: one.variable for name, one in result.coords.items() if name not in fixed}
    result = xr.Dataset(grown, coords, result.attrs)
    if HELIOSTAT in result.sizes and HELIOSTAT not in result.coords:
        result = result.assign_coords({HELIOSTAT: np.arange(result.sizes[HELIOSTAT])})
    floats = [name for name in result.indexes if result[name].dtype.kind == "f"]
    return result.assign_coords({name: result[name].round(LABEL_DECIMALS) for name in floats})


def numbers(joined: xr.Dataset, names: Sequence[str]) -> Table:
    """Tabulate variables at every common point, with the differences of each result from the first result."""
    known = [name for name in names if name in joined.data_vars]
    first = [*known, min(map(str, joined.data_vars), key=lambda name: joined[name].ndim)][0]
    dims = [str(dim) for dim in joined[first].dims if dim != RESULT]
    same = [str(name) for name, one in joined.data_vars.items() if name != first and {*one.dims} == {RESULT, *dims}]
    context, results, rows = Context(joined), list(map(str, joined[RESULT].to_numpy())), list[list[str]]()
    for array in (joined[name].transpose(*dims, RESULT) for name in [first, *same][:MOST_VARIABLES]):
        unit, values = unit_of(array), np.asarray(printed(array), dtype=float)
        for index in np.ndindex(values.shape[:-1]):
            row = values[index]
            differences = [_difference(row[0], value, unit) for value in row[1:]]
            place = context.values(dict(zip(dims, index, strict=True)))
            rows.append([title_of(array), place, *(f"{value:.6g}" for value in row), *differences, unit])
    heads = ["", "at", *results, *(f"{name} \N{MINUS SIGN} {results[0]}" for name in results[1:]), "unit"]
    return Table(
        "Results", columns_of(heads, rows[:MOST_POINTS]), ["Differences of percentages are in percentage points."]
    )


def _difference(first: float, value: float, unit: str) -> str:
    difference = value - first
    if not abs(difference) > ROUNDING * abs(first):
        return "0" if np.isfinite(difference) else NOTHING
    share = f" ({100 * difference / first:+.3g} %)" if first and unit != "%" else ""
    return f"{difference:+.4g}{share}".replace("-", "\N{MINUS SIGN}")


def _inputs(results: Mapping[str, xr.Dataset]) -> Table:
    studies = {name: pd.json_normalize([json.loads(one.attrs.get("study", "{}"))]) for name, one in results.items()}
    texts = pd.concat(studies).T.sort_index().astype(object).fillna(NOTHING).map(str)
    differ = texts[texts.nunique(axis=1) > 1]
    columns = [Column("study key", [*map(str, differ.index)] or ["no difference"])]
    columns += [Column(name, list(differ[name, 0]) or [""]) for name in results]
    return Table("Inputs", columns, [f"{len(texts) - len(differ)} further inputs are equal."])


def update_index(folder: str | os.PathLike[str]) -> Path | None:
    """Update the index of all studies after a result folder in ``outputs`` has changed.

    A failure is logged as a warning.
    """
    place = user_path(folder).absolute().parent
    try:
        return write_index(place) if place.name == OUTPUTS else None
    except (OSError, HeliosweepError) as error:
        log.warning("the list of all studies was not written: %s", error)
        return None


def write_index(outputs: str | os.PathLike[str]) -> Path:
    """Write the page ``index.html`` of all studies in a folder of result folders."""
    file, studies = Path(outputs) / "index.html", studies_in(Path(outputs))
    script = resources.files("heliosweep.report").joinpath("templates/index.js").read_text(encoding="utf-8")
    families = sorted({one["family"] for one in studies} - {""})
    write_whole(file, render("index.html", title="Studies", scripts=(script,), studies=studies, families=families))
    return file


def studies_in(outputs: Path) -> list[dict[str, Any]]:
    """Return the entries of all studies for the template, starting with the latest study."""
    folders = (folder for folder in sorted(outputs.iterdir()) if folder.is_dir())
    found = [
        {**_study_entry(folder), "state": status.state, "detail": status.detail}
        for folder in folders
        if (status := status_of(folder)).state != "not run"
    ]
    return sorted(found, key=lambda one: one["finished"], reverse=True)


def _study_entry(folder: Path) -> dict[str, Any]:
    manifest: dict[str, Any] = {}
    with suppress(HeliosweepError):
        manifest = read_manifest(folder)
    identity = manifest.get("identity") or {}
    with suppress(OSError, ValueError):  # the run may be unfinished
        if not identity and (store := unfinished(folder)):
            identity = store.record.get("identity") or {}
    study, attributes = identity.get("study", {}), identity.get("attributes", {})
    finished = str(manifest.get("finished") or "")
    about = [str(study.get("family", "")).replace("_", " "), finished.replace("T", " ").rstrip("Z")]
    printable = folder.name.encode(errors="replace").decode()
    page, compared = folder / PAGE, None
    title, headline = page_head(page)
    with suppress(HeliosweepError, OSError, ValueError):
        compared = comparison.read_comparison(folder / comparison.FILE)
    return {
        "title": str(attributes.get("title") or study.get("title") or title or printable),
        "about": " \N{MIDDLE DOT} ".join(filter(None, [*about, printable])),
        "family": str(study.get("family", "")).replace("_", " "),
        "finished": finished,
        "headline": headline,
        "link": f"./{quote(folder.name, errors='surrogateescape')}/{PAGE}" if page.is_file() else "",
        "compared": compared,
    }

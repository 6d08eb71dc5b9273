"""One page over several results: what went in, what came out, difference maps, and curves on one axis."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import xarray as xr

from heliosweep.config.study import Study
from heliosweep.files import user_path, write_whole
from heliosweep.report.contents import NamedFigure, Table
from heliosweep.report.inputs import MOST_ROWS as MOST_INPUTS
from heliosweep.report.inputs import entries
from heliosweep.report.interactive import explore, scripts
from heliosweep.report.labels import (
    NOTHING,
    axis_label,
    coordinate_text,
    is_quantity,
    labels_along,
    number_text,
    printed,
    title_of,
    unit_of,
)
from heliosweep.report.page import PAGE, FamilyOf, embeddable, render, study_beside
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import about_zero, field_map, picture_figure, symbols
from heliosweep.report.sampled import sampled
from heliosweep.report.sections import MOST_NUMBERS, decimals_of, ranges
from heliosweep.report.selection import Shown, at, is_geometric
from heliosweep.report.style import pixels, small
from heliosweep.report.views import FIELD, HELIOSTAT, View, default_views, usable
from heliosweep.store.checks import blaming_damage, sound
from heliosweep.store.read import open_result
from heliosweep.store.targets import target_file

#: Dimension along which the results stand.
RESULT = "result"

#: Rows of the table of what came out, and variables that it tells.
MOST_ROWS, MOST_VARIABLES = 80, 12

#: Panels of a figure of curves, such figures, and lines of a panel; maps beside each other.
MOST_PANELS, MOST_CURVES, MOST_LINES, MOST_MAPS = 4, 3, 8, 3

#: Difference that is rounding, as part of the value.
ROUNDING = 1e-12

#: Decimals to which labels have to be the same to be one point.
LABEL_DECIMALS = 9


def write_comparison(
    places: Sequence[str | os.PathLike[str]],
    page: str | os.PathLike[str],
    family_of: FamilyOf,
    *,
    force: bool = False,
) -> Path:
    """Write one page over several results, as `heliosweep.comparison_page` does; `family_of` gives their families."""
    file = target_file(page, force, endings=(".html",), sources=places)
    sound(*places, as_written=True)
    names = [chr(ord("A") + number) if number < 26 else str(number + 1) for number in range(len(places))]
    with ExitStack() as opened:
        results = {}
        for name, place in zip(names, places, strict=True):
            opened.enter_context(blaming_damage(place))
            results[name] = opened.enter_context(open_result(place))
        text = _page(list(map(user_path, places)), results, family_of, file)
    write_whole(file, text)
    return file


def _page(places: Sequence[Path], results: Mapping[str, xr.Dataset], family_of: FamilyOf, file: Path) -> str:
    folders = [place if place.is_dir() and place.suffix != ".zarr" else place.parent for place in places]
    known = [family_of(result) for result in results.values()]
    studies = [study_beside(folder, family) for folder, family in zip(folders, known, strict=True)]
    covers = [sampled(result, study) for result, study in zip(results.values(), studies, strict=True)]
    family, first = known[0], next(iter(results.values()))
    headlines = family.headlines if family else ()
    joined = together(results)
    declared = usable(joined, family.views(first) if family else default_views(joined))
    same = _same_places(joined)
    views = [_beside(view, same) for view in declared]
    frames, plots = explore(joined, views)
    shown = Shown(joined)
    drawn = [*_curves(shown, headlines), *(_differences(shown, declared) if same else ())]
    return render(
        "several.html",
        title=f"{len(results)} results side by side",
        results=[
            _entry(name, folder, result, file) for (name, result), folder in zip(results.items(), folders, strict=True)
        ],
        remarks=_remarks(joined, same),
        went_in=_went_in(list(results), list(zip(studies, covers, strict=True))),
        came_out=came_out(joined, headlines) or _ranges(results, headlines),
        figures=[embeddable(one, small(pixels(one.figure))) for one in drawn],
        views=frames,
        plots=plots,
        scripts=scripts(bool(frames)),
    )


def _entry(name: str, folder: Path, result: xr.Dataset, file: Path) -> dict[str, str]:
    """What the head of the page tells of a result."""
    page = folder / PAGE
    link = quote(Path(os.path.relpath(page, file.parent)).as_posix()) if page.is_file() else ""
    return {
        "name": name,
        "title": str(result.attrs.get("title", folder.name)),
        "about": folder.resolve().name,
        "link": link,
    }


def together(results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """The numbers that all results have, at the points that all have, along a dimension of results.

    Parameters
    ----------
    results : mapping of str to Dataset
        By the name that each gets. What one has swept and another has fixed counts as swept over one value.

    Returns
    -------
    xarray.Dataset
        Over ``result`` and their own dimensions; without variables where they have none in common.
    """
    every = list(results.values())
    names = [str(name) for name, one in every[0].data_vars.items() if _is_number(one)]
    names = [name for name in names if all(name in one.data_vars and _is_number(one[name]) for one in every)]
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


def _is_number(array: xr.DataArray) -> bool:
    return is_quantity(array) and array.size <= MOST_NUMBERS


def _expanded(result: xr.Dataset, swept: Mapping[str, set[Any]]) -> xr.Dataset:
    """A result over the dimensions that another one has swept, with labels that differ by no rounding."""
    fixed = {dim for dims in swept.values() for dim in dims if dim in result.coords and not result[dim].ndim}
    grown = {}
    for name, one in result.data_vars.items():
        grows = swept[str(name)] & fixed
        grown[name] = one.drop_vars(fixed - grows).expand_dims([*grows])
    result = xr.Dataset(
        grown,
        {name: one.variable for name, one in result.coords.items() if name not in fixed},
        result.attrs,
    )
    if HELIOSTAT in result.sizes and HELIOSTAT not in result.coords:
        result = result.assign_coords({HELIOSTAT: np.arange(result.sizes[HELIOSTAT])})
    rounded = {
        name: one.copy(data=one.to_numpy().round(LABEL_DECIMALS))
        for name, one in result.coords.items()
        if name in result.indexes and one.dtype.kind == "f"
    }
    return result.assign_coords(rounded)


def _same_places(joined: xr.Dataset) -> bool:
    """Whether heliostats of the same number stand in the same place."""
    return HELIOSTAT not in joined.sizes or all(RESULT not in joined[side].dims for side in "xy" if side in joined)


def _beside(view: View, same: bool) -> View:
    """A view of one result as a view of several: lines and differences are theirs."""
    less = RESULT if view.kind == "raster" or (view.kind == "field" and same) else view.less
    return replace(view, lines=(RESULT, *view.lines), less=less)


def _remarks(joined: xr.Dataset, same: bool) -> list[str]:
    if not joined.data_vars:
        return ["These results have no points in common: below are the ranges of each."]
    moved = "Heliostats stand in other places, or are others: there are maps beside each other, and no difference maps."
    return [] if same else [moved]


def _went_in(names: Sequence[str], inputs: Sequence[tuple[Study | None, Sequence[tuple[str, str]]]]) -> Table:
    """Table of the inputs of several studies with a column for each, what differs first.

    Of each study the same is told as by `inputs`, and its default where another one has something else.
    """
    told: dict[str, list[str]] = {}
    given: set[str] = set()
    for number, (study, covers) in enumerate(inputs):
        rows = [([name, text, "", ""], True) for name, text in covers]
        rows += entries(study) if isinstance(study, Study) else []
        for (name, text, how, key), asked in rows:
            cells = told.setdefault(key or name, [name, *(NOTHING for _ in inputs), key])
            cells[1 + number] = text if how in ("", "fixed") else f"{text} ({how})"
            given |= {key or name} if asked else set()
    differ = {key for key, cells in told.items() if len({*cells[1:-1]}) > 1}
    order = [key for key in told if key in differ] + [key for key in told if key in given - differ]
    return Table(
        "What went in",
        ["", *names, "key of the study"],
        [told[key] for key in order[:MOST_INPUTS]],
        range(2 + len(names)),
        ["What differs comes first." if differ else "Nothing differs."]
        + [f"The first {MOST_INPUTS} of {len(order):,}; the study files have all."] * (len(order) > MOST_INPUTS),
        classes=["changed" if key in differ else "" for key in order[:MOST_INPUTS]],
    )


def came_out(joined: xr.Dataset, headlines: Sequence[str]) -> Table | None:
    """Table of the numbers of the whole at every point that all results have, with their differences from the first."""
    leading = _leading(joined, headlines)
    if leading is None:
        return None
    names, dims = leading
    names = names[:MOST_VARIABLES]
    results = [str(name) for name in joined[RESULT].to_numpy()]
    points = list(np.ndindex(*(joined.sizes[dim] for dim in dims)))
    rows = []
    for name, point in itertools.islice(itertools.product(names, points), MOST_ROWS):
        here = joined[name].isel(dict(zip(dims, point, strict=True)))
        where = ", ".join(
            coordinate_text(labels_along(joined, dim)[i]) for dim, i in zip(dims, point, strict=True) if len(points) > 1
        )
        rows.append([title_of(here), where, *_cells(np.asarray(printed(here), float), unit_of(here)), unit_of(here)])
    count = len(names) * len(points)
    notes = [f"The first {MOST_ROWS} of {count:,} rows; all are in the data sets."] * (count > MOST_ROWS)
    if any(row[-1] == "%" for row in rows):
        notes.append("Differences of percentages are in percentage points.")
    header = ["", "at", *results, *(f"{name} \N{MINUS SIGN} {results[0]}" for name in results[1:]), "unit"]
    words = [0, 1, len(header) - 1]
    if not any(row[1] for row in rows):
        header, rows, words = [header[0], *header[2:]], [[row[0], *row[2:]] for row in rows], [0, len(header) - 2]
    same = [bool(i) and row[0] == rows[i - 1][0] for i, row in enumerate(rows)]
    rows = [["" if again else row[0], *row[1:]] for row, again in zip(rows, same, strict=True)]
    return Table("What came out", header, rows, words, notes, classes=["" if again else "new" for again in same])


def _leading(joined: xr.Dataset, headlines: Sequence[str]) -> tuple[list[str], list[str]] | None:
    """Variables over the same points as the first headline, which is the first of them, and their dimensions."""
    first = next((name for name in headlines if name in joined.data_vars), None)
    first = first or min(map(str, joined.data_vars), key=lambda name: joined[name].ndim, default=None)
    if first is None:
        return None
    dims = [str(dim) for dim in joined[first].dims if dim != RESULT]
    return [
        first,
        *(str(name) for name, one in joined.data_vars.items() if name != first and {*one.dims} == {RESULT, *dims}),
    ], dims


def _cells(values: np.ndarray, unit: str) -> list[str]:
    """Values, and their differences from the first: relative too, where they are no percentages."""
    differences = values[1:] - values[0]
    differences[np.abs(differences) <= ROUNDING * np.abs(values[0])] = 0.0
    decimals = min(decimals_of(differences), 6)
    texts = [number_text(value, decimals) for value in values]
    for difference in differences:
        text = number_text(difference, decimals, signed=True)
        part = 100 * difference / values[0] if values[0] and unit != "%" else np.nan
        told = np.isfinite(part) and difference
        texts.append(f"{text} ({number_text(part, decimals_of([part]), signed=True)} %)" if told else text)
    return texts


def _ranges(results: Mapping[str, xr.Dataset], headlines: Sequence[str]) -> Table:
    """Least and greatest values of each result, where they have no points in common."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name, result in results.items():
        for title, least, _, greatest, unit, _ in ranges(result, headlines).rows:
            text = least if least == greatest else f"{least} to {greatest}"
            found.setdefault((title, unit), {})[name] = text
    rows = [[title, *(cells.get(name, NOTHING) for name in results), unit] for (title, unit), cells in found.items()]
    return Table("What came out: least to greatest", ["", *results, "unit"], rows, [0, 1 + len(results)])


def _curves(shown: Shown, headlines: Sequence[str]) -> Iterator[NamedFigure]:
    """The first numbers of the whole over each swept number, a line for each result."""
    leading = _leading(shown.result, headlines)
    if leading is None:
        return
    names, dims = leading
    numbers = [dim for dim in dims if shown.is_number(dim) and shown.several(dim)]
    words = next((dim for dim in dims if not shown.is_number(dim) and shown.several(dim)), None)
    for along in numbers[:MOST_CURVES]:
        stands = shown.fixed(names[0], RESULT, along, words)
        lines = [{**one, **word} for word in shown.chosen(words, 3) for one in shown.chosen(RESULT, MOST_LINES)][
            : 2 * MOST_LINES
        ]
        panels = []
        for name in names[:MOST_PANELS]:
            array = shown.result[name]
            drawn = {shown.values(line): at(array, stands, line) for line in lines}
            scaled = {line: one.copy(data=printed(one)) for line, one in drawn.items()}
            panels.append(Panel(axis_label(array), scaled))
        figure = curve_figure(panels, shown.label(along), logarithmic=is_geometric(shown.result[along].to_numpy()))
        caption = f"Each result over {shown.title(along)}.{shown.note(stands)}"
        yield NamedFigure(f"results_over_{along}", caption, figure)


def _differences(shown: Shown, views: Sequence[View]) -> Iterator[NamedFigure]:
    """Maps of the field: each result less the first, at some points."""
    view = next((view for view in views if view.kind == "field"), None)
    if view is None or shown.result.sizes[HELIOSTAT] < FIELD:
        return
    name = view.quantities[0]
    array = shown.result[name]
    along = next((dim for dim in shown.swept(name, RESULT, HELIOSTAT)), None)
    stands = shown.fixed(name, RESULT, HELIOSTAT, along)
    places = shown.chosen(along, MOST_MAPS)
    unit = unit_of(array).replace("%", "percentage points")
    maps = []
    for number in range(1, shown.result.sizes[RESULT]):
        for place in places:
            first, other = (printed(at(array, stands, place, {RESULT: i})) for i in (0, number))
            title = f"{shown.value(RESULT, number)} \N{MINUS SIGN} {shown.value(RESULT, 0)}"
            here = shown.result.isel({**stands, **place, RESULT: number})
            one = field_map(here, other - first, "\n".join(filter(None, [title, shown.fulls(place)])))
            maps += [one] if one else []
    if any(np.isfinite(one.values).any() for one in maps):
        label = f"difference of the {title_of(array)}{f' ({unit})' if unit else ''}"
        shades = about_zero(label, [one.values for one in maps])
        figure = picture_figure(maps, shades, len(places) if len(places) > 1 else 0)
        caption = (
            f"{title_of(array)[:1].upper()}{title_of(array)[1:]} of each heliostat: each result less the first, red "
            f"where it is larger. {symbols(maps, sized=True)}{shown.note(stands, places)}"
        )
        yield NamedFigure("differences", caption, figure)

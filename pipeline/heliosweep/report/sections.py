"""The sections of a result's page, from top to bottom; each is left out where there is nothing to say."""

from __future__ import annotations

import base64
import itertools
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.report.comparison import NUMBER_COLUMNS, Comparison, cells, summary
from heliosweep.report.html import Html, definitions, doi_of, element, join, linked, section, table
from heliosweep.report.labels import (
    axis_label,
    coordinate_text,
    flag_text,
    is_flag,
    number_text,
    printed,
    title_of,
    unit_of,
    value_text,
)

if TYPE_CHECKING:
    from heliosweep.families.registry import Table

#: Rows of the table of headline numbers.
MOST_ROWS = 60

#: Letters of the head of a column of the comparison.
LONGEST_HEAD = 18

#: Size on the screen of one inch of a figure. [CSS pixel]
PIXELS = 144

_NONE = Html("")


@dataclass(frozen=True)
class Compared:
    """A comparison with published numbers and their source."""

    values: list[Comparison]
    source: str


@dataclass(frozen=True)
class Drawing:
    """A figure that has been drawn and saved.

    Parameters
    ----------
    caption : str
        Sentences below it.
    png : bytes
        The image.
    width, height : float
        Size on paper. [inch]
    """

    caption: str
    png: bytes
    width: float
    height: float


def header(result: xr.Dataset, compared: Compared | None) -> Html:
    """Title, summary, and the verdict of the comparison."""
    attrs = result.attrs
    about = " \N{MIDDLE DOT} ".join(str(attrs[name]) for name in ("source", "study_id") if name in attrs)
    verdict = _NONE
    if compared:
        agrees = all(one.agrees for one in compared.values)
        verdict = element("p", summary(compared.values), class_=f"verdict {'agrees' if agrees else 'differs'}")
    return element(
        "header",
        element("h1", attrs.get("title", "A result")),
        element("p", about, class_="about"),
        element("p", attrs["summary"]) if attrs.get("summary") else _NONE,
        verdict,
    )


def remarks(said: Sequence[str]) -> Html:
    """What the run warned of."""
    if not said:
        return _NONE
    items = [element("li", text) for text in said]
    return element(
        "aside", element("strong", "Please note"), element("ul", "\n", join(items, "\n")), class_="remarks", role="note"
    )


def results(result: xr.Dataset, tables: Iterable[Table]) -> Html:
    """Tables that the family makes, else the numbers of the whole."""
    pieces = []
    for one in tables:
        pieces += [table(one.header, one.rows, one.label, one.words), *(element("p", note) for note in one.notes)]
    if not pieces:
        return headline(result)
    return section("Results", _shared(result, [""]), *pieces)


def headline(result: xr.Dataset) -> Html:
    """Numbers of the whole: the variables over the swept dimensions alone, a row for each point of the sweep."""
    if not result.data_vars:
        return _NONE
    common = set.intersection(*(set(array.dims) for array in result.data_vars.values()))
    first = next(iter(result.data_vars.values()))
    dims = [str(dim) for dim in first.dims if dim in common]
    shown = [array for array in result.data_vars.values() if set(array.dims) == common and array.dtype.kind in "fiu"]
    if not shown:
        return _NONE
    points = int(np.prod([result.sizes[dim] for dim in dims], dtype=np.int64))
    indices = list(itertools.islice(np.ndindex(*(result.sizes[dim] for dim in dims)), MOST_ROWS))
    columns = [_texts(array, _leading(array.transpose(*dims), indices)) for array in shown]
    names = [[_at(result, dim, index[i]) for index in indices] for i, dim in enumerate(dims)]
    head = [
        *(_dimension_title(result, dim) for dim in dims),
        *(join([str(array.name).replace("_", " "), element("small", unit_of(array))]) for array in shown),
    ]
    rows = list(zip(*names, *columns, strict=True))
    classes = [
        "new" if len(dims) > 1 and i and index[:-1] != indices[i - 1][:-1] else "" for i, index in enumerate(indices)
    ]
    words = [*range(len(dims)), *(len(dims) + i for i, array in enumerate(shown) if is_flag(array))]
    more = f"The first {len(indices)} of {points:,} points; all are in the data set." if points > len(indices) else ""
    notes = [(str(array.name).replace("_", " "), _described(array)) for array in shown]
    return section(
        "Results",
        _shared(result, dims),
        table(head, rows, "Results", words, classes),
        element("p", more) if more else _NONE,
        element("details", element("summary", "What these numbers are"), definitions(notes)),
    )


def _texts(array: xr.DataArray, values: np.ndarray) -> list[str]:
    """Cells of one column: flags in words."""
    return [flag_text(array, value) for value in values] if is_flag(array) else number_texts(values)


def number_texts(values: np.ndarray) -> list[str]:
    """Numbers of one column with the same decimals: none where all are whole, more than two where all are small."""
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    decimals = 2 if largest == 0.0 else min(8, max(2, 2 - math.floor(math.log10(largest))))
    whole = finite.size > 0 and largest >= 1.0 and bool(np.all(finite == np.round(finite)))
    return [number_text(value, 0 if whole else decimals) for value in values]


def _leading(array: xr.DataArray, indices: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Values at the first points, of which only the leading part of the array is read."""
    if not array.ndim:
        return np.atleast_1d(printed(array))
    part = array.isel({array.dims[0]: slice(0, indices[-1][0] + 1)})
    return printed(part).reshape(-1)[: len(indices)]


def _at(result: xr.Dataset, dim: str, index: int) -> str:
    names = result.coords.get("name")
    if names is not None and names.dims == (dim,) and names.dtype.kind in "OU":
        return str(names.to_numpy()[index])
    return value_text(result[dim].isel({dim: index})) if dim in result.coords else str(index + 1)


def _dimension_title(result: xr.Dataset, dim: str) -> str:
    return title_of(result[dim]) if dim in result.coords else dim.replace("_", " ")


def _shared(result: xr.Dataset, dims: Sequence[str]) -> Html:
    """Coordinates that are the same at every point."""
    texts = [
        f"{title_of(coordinate)} {value_text(coordinate)}"
        if coordinate.dtype.kind in "OU"
        else coordinate_text(coordinate)
        for name, coordinate in result.coords.items()
        if not coordinate.ndim
    ]
    return (
        element("p", f"At every point: {', '.join(texts)}.")
        if texts and dims
        else (element("p", f"At {', '.join(texts)}.") if texts else _NONE)
    )


def _described(array: xr.DataArray) -> str:
    said = [str(array.attrs[name]) for name in ("long_name", "comment") if array.attrs.get(name)]
    return "; ".join(said)


def comparison(compared: Compared | None, result: xr.Dataset) -> Html:
    """Computed, published, difference and verdict."""
    if not compared:
        return _NONE
    head, rows = cells(compared.values)
    end = len(head) - len(NUMBER_COLUMNS)  # of the coordinates; a column of numbers may share its name with one
    titles = [_column(result, name) if 0 < i < end and name in result.coords else name for i, name in enumerate(head)]
    classes = [
        f"{one.verdict} new" if i and one.quantity != compared.values[i - 1].quantity else one.verdict
        for i, one in enumerate(compared.values)
    ]
    readable = [
        [row[0].replace("_", " "), *(cell.replace("_", "-") for cell in row[1:end]), *row[end:]] for row in rows
    ]
    words = [0, *(i for i in range(1, end) if not _is_number(rows, i)), len(head) - 2, len(head) - 1]
    return section(
        "Computed and published",
        element("p", "Published numbers: ", linked(compared.source), f". {summary(compared.values)}."),
        table(titles, readable, "Computed and published", words, classes),
        element(
            "p",
            "The difference is computed minus published, in percentage points where the unit is %. "
            "A number agrees where the difference is within the tolerance.",
        ),
    )


def _column(result: xr.Dataset, name: str) -> str:
    """Head of a column: what a coordinate is called, or its name where that is long and without a unit."""
    words = axis_label(result[name])
    return words if len(words) <= LONGEST_HEAD or unit_of(result[name]) else name.replace("_", " ")


def _is_number(rows: Sequence[Sequence[str]], column: int) -> bool:
    try:
        return all(float(row[column] or 0) is not None for row in rows)
    except ValueError:
        return False


def figures(drawings: Iterable[Drawing]) -> Html:
    """All figures with their captions."""
    pieces = [
        element(
            "figure",
            element("div", _image(drawing, f"Figure {number}. {drawing.caption}"), class_="picture"),
            element("figcaption", element("strong", f"Figure {number}. "), drawing.caption),
        )
        for number, drawing in enumerate(drawings, start=1)
    ]
    return section("Figures", join(pieces, "\n")) if pieces else _NONE


def _image(drawing: Drawing, text: str) -> Html:
    source = f"data:image/png;base64,{base64.b64encode(drawing.png).decode()}"
    width, height = (round(side * PIXELS) for side in (drawing.width, drawing.height))
    markup = element("img", src=source, alt=text, width=width, height=height)
    return Html(markup.removesuffix("</img>"))


def asked(resolved: str) -> Html:
    """The study with all defaults, folded away."""
    if not resolved:
        return _NONE
    return section(
        "What was asked",
        element(
            "details",
            element("summary", "The study file, with every default written out"),
            element("pre", element("code", resolved)),
        ),
    )


def provenance(manifest: Mapping[str, Any]) -> Html:
    """How the result was made, how long it took, and how to make it again."""
    if not manifest:
        return _NONE
    result, environment = manifest.get("result", {}), manifest.get("environment", {})
    packages = environment.get("packages", {})
    pairs = [
        ("finished", manifest.get("finished")),
        ("study", manifest.get("study_id")),
        ("heliosweep", " ".join(filter(None, [packages.get("heliosweep"), _commit(environment.get("commit"))]))),
        ("Python", environment.get("python")),
        (
            "packages",
            ", ".join(
                f"{name} {packages[name]}" for name in sorted(packages) if name != "heliosweep" and packages[name]
            ),
        ),
        ("platform", environment.get("platform")),
        ("scheduler", _workers(manifest)),
        ("evaluations", _count(manifest.get("plan", {}).get("evaluations"))),
        ("time", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in manifest.get("seconds", {}).items())),
        (result.get("file", "result.nc"), f"{result['bytes']:,} bytes" if "bytes" in result else None),
        ("sha256 of the file", _code(result.get("sha256"))),
        ("digest of the content", _code(result.get("content_digest"))),
    ]
    command = shlex.join(map(str, manifest.get("command", [])))
    again = [element("h3", "Make it again"), element("pre", element("code", command))] if command else []
    return section("How it was made", definitions((name, what) for name, what in pairs if what), *again)


def _commit(commit: str | None) -> str:
    return f"(commit {commit})" if commit else ""


def _workers(manifest: Mapping[str, Any]) -> str | None:
    scheduler, workers = manifest.get("scheduler"), manifest.get("workers")
    return f"{scheduler}, {workers} workers" if scheduler and workers else scheduler


def _count(number: int | None) -> str | None:
    return None if number is None else f"{number:,}"


def _code(text: str | None) -> Html | None:
    return element("code", text) if text else None


def references(result: xr.Dataset) -> Html:
    """Sources, each once: of two entries with the same DOI the longer one."""
    entries: dict[str, str] = {}
    for text in filter(None, (entry.strip() for entry in str(result.attrs.get("references", "")).split(";"))):
        key = doi_of(text) or text
        entries[key] = max(entries.get(key, ""), text, key=len)
    items = [element("li", linked(text)) for text in entries.values()]
    return section("References", element("ul", "\n", join(items, "\n"))) if items else _NONE


def footer(result: str) -> Html:
    """Where the numbers are: the name of the result's file."""
    return element(
        "footer",
        "The numbers are in ",
        element("code", result),
        ", the figures in ",
        element("code", "figures/"),
        ", both beside this page.",
    )

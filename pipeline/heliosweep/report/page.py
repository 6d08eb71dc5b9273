"""HTML pages: report of a result, comparison of several results, and index of studies.

Each page is a single file that loads no other files and runs only its own scripts.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shlex
import string
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from importlib import resources
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd
import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from heliosweep.config import Study
from heliosweep.errors import HeliosweepError, Problem, StudyError, log
from heliosweep.files import remove_leftovers, user_path, write_whole
from heliosweep.report import comparison
from heliosweep.report.figures import (
    HELIOSTAT,
    MOST_FIGURES,
    NOTHING,
    Context,
    Curves,
    Figure,
    Maps,
    default_figures,
    is_quantity,
    printed,
    title_of,
    unit_of,
    with_heat_map,
)
from heliosweep.report.tables import (
    DOI,
    Column,
    Table,
    columns_of,
    default_tables,
    headlines,
    ranges,
    references,
    without,
)
from heliosweep.store.folder import MANIFEST, OUTPUTS, STUDIES, locate, page_head, read_manifest, status_of, unfinished

PAGE, SUMMARY, FIGURES = "report.html", "summary.html", "figures"
#: Name of the file that lists the figures of a report. The next report removes only these files.
DRAWN = ".drawn"
#: Maximum size of a result that is fully loaded into memory. [bytes]
LOADED = 2**24


def write_report(
    result: xr.Dataset,
    folder: str | os.PathLike[str],
    family: Any = None,
    study: Study | None = None,
    *,
    vector: Sequence[str] = (),
    summary: bool = False,
) -> Path:
    """Draw the figures of a result and write its page.

    Parameters
    ----------
    result : Dataset
        Result in the folder.
    folder : path
        Result folder. The page shows ``manifest.json`` and ``study.resolved.yaml`` of this folder if they exist. In an
        unpacked archive, the study file is named ``study.yaml``.
    family : Family, optional
        Family that declares headlines, figures and tables. Without a family, they are derived from the variables.
    study : Study, optional
        Study with published numbers. The default is the comparison stored in the folder.
    vector : sequence of {"svg", "pdf"}
        File formats of figures in addition to PNG.
    summary : bool
        If True, write ``summary.html`` instead, which fits on one printed page.

    Returns
    -------
    pathlib.Path
        Path of the page.

    Raises
    ------
    StudyError
        If published numbers do not match the quantities and coordinates of the result.
    """
    from heliosweep.report.draw import draw
    from heliosweep.report.interactive import client, explore

    (result if result.nbytes < LOADED else result.coords.to_dataset()).load()  # the figures reuse the loaded values
    place = user_path(folder)
    manifest, damage = _manifest(place)
    remarks = list[str]()
    noted: Any = partial(_noted, remarks, bool(manifest))
    compared = _comparison(place, study, result)
    names, script = family.headlines if family else (), ""
    # These lists stay empty if the corresponding part of the page fails.
    figures, made = list[Figure](), list[Table]()
    plots, pictures = list[dict[str, str]](), list[dict[str, Any]]()
    with noted("The figures"):
        figures = with_heat_map(result, (family.figures if family else default_figures)(result), names)
    if summary:
        with noted("The figure"):
            pictures = [embedded(named) for named in draw(result, figures, most=1)]
    else:
        pictures = _pictures(place / FIGURES, noted, result, figures, vector)
        with noted("The interactive plots"):
            script, plots = explore(result, figures)
    with noted("The tables of results"):
        made = [*(family.tables(result) if family else ())] or default_tables(result, names)
    numbers = headlines(result, names)
    source = next((name for name in STUDIES if (place / name).is_file()), "")
    content = {
        "file": locate(place).name,
        "title": str(result.attrs.get("title", place.name)),
        "headline": numbers[0]["text"] if numbers else "",
        "headlines": numbers,
        "about": " \N{MIDDLE DOT} ".join(
            str(result.attrs[key]) for key in ("source", "study_id") if key in result.attrs
        ),
        "summary": result.attrs.get("summary", ""),
        "answers": list(family.answers(result)) if family else [],
        "compared": compared,
        "published": [compared.table(result).printed()] if compared else [],
        "remarks": [*damage, *(compared.surprises if compared else ()), *manifest.get("remarks", ()), *remarks],
        "study_file": source,
        "listed": place.absolute().parent.name == OUTPUTS,
        "asked": _text(place / source),
        "tables": [one.printed() for one in without(made, numbers)],
        "picture": next(iter(pictures), None),
        "figures": pictures[1:],
        "plots": plots,
        "scripts": [_harmless(client()), _harmless(script)] if plots else [],
        "manifest": manifest,
        "command": command(manifest),
        "references": references(result),
        "rows": 12,  # maximum number of rows in the first table of a summary
    }
    name = SUMMARY if summary else PAGE
    write_whole(place / name, render(name if summary else "page.html", **content))
    return place / name


def render(template: str, **content: Any) -> str:
    """Render a page template with escaped content."""
    return _environment().get_template(template).render(**content)


@cache
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("heliosweep.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"linked": linked, "digest": digest}
    css = resources.files("heliosweep.report").joinpath("templates/page.css").read_text(encoding="utf-8")
    made.globals["style"] = Markup(css)
    return made


def linked(text: str) -> Markup:
    """Escape text and convert digital object identifiers to links."""
    return Markup(DOI.sub(r'<a href="https://doi.org/\1">\g<0></a>', str(escape(text))))


def digest(script: str) -> str:
    """Return the hash of a script for a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def _harmless(script: str) -> str:
    """Return a script that cannot close its HTML element early."""
    script = re.sub(r"^//# sourceMappingURL=.*$", "", script, flags=re.MULTILINE)  # browsers would fetch the source map
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


@contextmanager
def _noted(remarks: list[str], sound: bool, what: str) -> Iterator[None]:
    """Add a remark if a part of a page cannot be created. The error is raised if `sound` is False."""
    try:
        yield
    except (HeliosweepError, OSError):
        raise
    except Exception as error:
        if not sound:
            raise
        remarks.append(f"{what} could not be drawn ({type(error).__name__}: {error}).")
        log.warning("%s", remarks[-1])
        log.debug("why", exc_info=True)


def _pictures(
    folder: Path, noted: Callable[[str], Any], result: xr.Dataset, figures: Sequence[Figure], vector: Sequence[str]
) -> list[dict[str, Any]]:
    """Draw and save figures and remove outdated figures of an earlier report."""
    from heliosweep.report.draw import drawn, image, pixels, png

    if folder.is_symlink():
        raise StudyError(Problem("is a symbolic link, not a result folder; move it away", file=str(folder)))
    folder.mkdir(exist_ok=True)
    remove_leftovers(folder)
    written, shown, before = list[str](), list[dict[str, Any]](), _text(folder / DRAWN).splitlines()
    for figure in figures:
        with noted(f"The figure {figure.name}"):
            for named in drawn(result, figure)[: MOST_FIGURES - len(shown)]:
                picture = pixels(named.figure)
                for kind in ("png", *vector):
                    written.append(f"{named.name}.{kind}")
                    write_whole(folder / written[-1], png(picture) if kind == "png" else image(named.figure, kind))
                shown.append(embedded(named, picture))
    for name in {Path(name).name for name in before} - {"", *written}:
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / DRAWN, "".join(f"{name}\n" for name in written))
    return shown


def embedded(named: Any, picture: Any = None) -> dict[str, Any]:
    """Return the template entry of a figure. `picture` is its raster image, if already drawn."""
    from PIL.Image import Dither, Quantize

    from heliosweep.report.draw import pixels, png

    picture = picture or pixels(named.figure)
    width, height = (round(0.55 * side) for side in picture.size)  # size in CSS pixels
    small = png(picture.quantize(256, method=Quantize.FASTOCTREE, dither=Dither.NONE))  # reduces the size to a quarter
    about: Any = {"name": named.name, "caption": named.caption, "width": width, "height": height}
    return about | {"png": base64.b64encode(small).decode()}


def for_others(page: str, study: str) -> str:
    """Return a page for publication, without the author's machine, command and paths.

    `study` replaces the text of the study file.
    """
    machine = r'<section id="provenance">.*?</section>\n?|<a class="ours"[^>]*>[^<]*</a>\n?'
    page = re.sub(machine, "", page, flags=re.DOTALL).replace('href="study.resolved.yaml"', 'href="study.yaml"')
    file = r'(?<=<pre id="study-file"><code>).*?(?=</code>)'
    return re.sub(file, lambda _: escape(study), page, flags=re.DOTALL)


def _comparison(place: Path, study: Study | None, result: xr.Dataset) -> comparison.Compared | None:
    """Compute and store the comparison of a study with published numbers, or read the stored comparison."""
    stored = place / comparison.FILE
    if study is None:
        return comparison.read_comparison(stored) if stored.is_file() else None
    published = study.report.published
    if published is None:
        stored.unlink(missing_ok=True)
        return None
    table = comparison.read_published(study.resolve(published.file), published.source, published.file)
    compared = comparison.compare(result, table)
    write_whole(stored, comparison.comparison_csv(compared))
    log.info("%s: %s", compared.source, compared.summary)
    for surprise in compared.surprises:
        log.warning("%s: %s", compared.file, surprise)
    return compared


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _manifest(place: Path) -> tuple[dict[str, Any], list[str]]:
    if not (place / MANIFEST).exists():
        return {}, []
    try:
        return read_manifest(place), []
    except HeliosweepError as error:
        log.warning("%s: %s", place, error)
        return {}, [f"The provenance is missing: {error}"]


def command(manifest: Mapping[str, Any]) -> str:
    """Return the command that recomputes only this result, or an empty string if the command is unknown."""
    words, own = list(map(str, manifest.get("command", []))), PurePath(manifest.get("study_file", ""))
    studies = [word for word in words if word.endswith((".yaml", ".yml"))]
    others = [word for word in studies if PurePath(word) != own]  # `PurePath` removes a leading "./"
    return shlex.join(word for word in words if word not in others or len(others) == len(studies))


#: Dimension along which compared results are joined.
RESULT = "result"
#: Maximum number of variables and points in the table of results, and maximum size of a variable.
MOST_VARIABLES, MOST_POINTS, MOST_NUMBERS = 12, 80, 2_000_000
#: Maximum relative difference attributed to rounding, and number of decimals to which labels are rounded.
ROUNDING, LABEL_DECIMALS = 1e-12, 9


def write_comparison(compared: Sequence[tuple[Path, xr.Dataset, Any]], file: Path) -> Path:
    """Write a page that compares several results.

    `compared` contains the path, data set and family of each result. The first family declares the figures.
    """
    from heliosweep.report.draw import draw

    names = [*string.ascii_uppercase, *map(str, range(27, len(compared) + 1))][: len(compared)]
    results, family = dict(zip(names, (data for _, data, _ in compared), strict=True)), compared[0][2]
    entries = list[dict[str, str]]()
    for name, (path, data, _) in zip(names, compared, strict=True):
        folder = path if path.is_dir() else path.parent
        page, title = folder / PAGE, str(data.attrs.get("title", folder.name))
        link = quote(Path(os.path.relpath(page, file.parent)).as_posix()) if page.is_file() else ""
        entries.append({"name": name, "title": title, "about": folder.resolve().name, "link": link})
    joined = together(results)
    same = HELIOSTAT not in joined.sizes or all(RESULT not in joined[side].dims for side in "xy" if side in joined)
    declared = family.figures(compared[0][1]) if family else default_figures(joined)
    known = family.headlines if family else ()
    figures = list(draw(joined, _over_results(declared, same))) if joined.data_vars else []
    remarks = [] if joined.data_vars else ["The results have no common points. A table shows their ranges."]
    remarks += [] if same else ["The results have different heliostats, so difference maps are not shown."]
    made = [replace(ranges(one, known), notes=[f"Ranges of result {name}."]) for name, one in results.items()]
    made = [_differences(joined, known)] if joined.data_vars else made
    text = render(
        "several.html",
        title=f"{len(results)} results compared",
        results=entries,
        remarks=remarks,
        went_in=_inputs(results).printed(),
        tables=[table.printed() for table in made],
        figures=[embedded(figure) for figure in figures],
    )
    write_whole(file, text)
    return file


def _over_results(figures: Iterator[Figure], same: bool) -> Iterator[Figure]:
    """Yield figures with a line or map for each result, and maps of the differences."""
    for figure in figures:
        if isinstance(figure, Curves):
            yield replace(figure, lines=(RESULT,))
        elif isinstance(figure, Maps) and not figure.each:
            yield replace(figure, lines=(RESULT,), less=RESULT if same else "")


def together(results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the common variables of results at their common points, joined along the ``result`` dimension.

    Parameters
    ----------
    results : mapping of str to Dataset
        Results by name. A key that is fixed in one result but swept in another is treated as a dimension of size 1.

    Returns
    -------
    xarray.Dataset
        Data set over ``result`` and the dimensions of the results. It is empty if the results have no common variables.
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
    """Round the labels of a result and expand it along all dimensions swept in any result."""
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


def _differences(joined: xr.Dataset, names: Sequence[str]) -> Table:
    """Tabulate variables at every common point, with differences from the first result."""
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
        "Results", columns_of(heads, rows[:MOST_POINTS]), ["Differences between percentages are in percentage points."]
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
    return Table("Inputs", columns, [f"{len(texts) - len(differ)} other inputs are equal."])


def write_index(outputs: str | os.PathLike[str]) -> Path:
    """Write ``index.html``, an index of all studies in a folder of result folders."""
    file, studies = Path(outputs) / "index.html", studies_in(Path(outputs))
    script = resources.files("heliosweep.report").joinpath("templates/index.js").read_text(encoding="utf-8")
    families = sorted({one["family"] for one in studies} - {""})
    write_whole(file, render("index.html", title="Studies", scripts=(script,), studies=studies, families=families))
    return file


def studies_in(outputs: Path) -> list[dict[str, Any]]:
    """Return the index entries of all studies, latest study first."""
    statuses = (status_of(folder) for folder in sorted(outputs.iterdir()) if folder.is_dir())
    found = [
        {**_study_entry(one.folder), "state": one.state, "detail": one.detail}
        for one in statuses
        if one.state != "not run"
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

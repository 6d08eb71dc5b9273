"""Page of a result with headline numbers, main picture, tables, figures, interactive plots, inputs and provenance.

The page is a single file that loads no other files and runs only its own scripts.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, partial
from importlib import resources
from pathlib import Path, PurePath
from typing import Any

import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from heliosweep.config import Study
from heliosweep.errors import HeliosweepError, Problem, StudyError, log
from heliosweep.files import remove_leftovers, user_path, write_whole
from heliosweep.report import comparison, tables
from heliosweep.report.figures import MOST_FIGURES, Figure, default_figures, with_heat_map
from heliosweep.store.folder import MANIFEST, OUTPUTS, STUDIES, read_manifest
from heliosweep.store.read import locate

PAGE, SUMMARY, FIGURES = "report.html", "summary.html", "figures"
#: Name of the file that lists the figures of a report. The next report removes only files in this list.
DRAWN = ".drawn"
#: Maximum size of a result that a report loads completely. [bytes]
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
        Family that declares headlines, figures and tables. The default is derived from the variables.
    study : Study, optional
        Study with published numbers. By default, the page shows the comparison that is stored in the folder.
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
    # These stay empty if they cannot be made.
    figures, made = list[Figure](), list[tables.Table]()
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
        made = [*(family.tables(result) if family else ())] or tables.default_tables(result, names)
    headlines = tables.headlines(result, names)
    source = next((name for name in STUDIES if (place / name).is_file()), "")
    content = {
        "file": locate(place).name,
        "title": str(result.attrs.get("title", place.name)),
        "headline": str(next(iter(headlines), "")),
        "headlines": headlines,
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
        "tables": [one.printed() for one in tables.without(made, headlines)],
        "picture": next(iter(pictures), None),
        "figures": pictures[1:],
        "plots": plots,
        "scripts": [_harmless(client()), _harmless(script)] if plots else [],
        "manifest": manifest,
        "command": command(manifest),
        "references": tables.references(result),
        "rows": 12,  # maximum number of rows in the first table of a summary
    }
    name = SUMMARY if summary else PAGE
    write_whole(place / name, render(name if summary else "page.html", **content))
    return place / name


def render(template: str, **content: Any) -> str:
    """Return a page from a template and escaped content."""
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
    """Return a string in which digital object identifiers are links."""
    pieces, end = [], 0
    for found in tables.DOI.finditer(text):
        link = Markup('<a href="https://doi.org/{}">{}</a>').format(found.group(1), found.group())
        pieces += [escape(text[end : found.start()]), link]
        end = found.end()
    return Markup("").join([*pieces, escape(text[end:])])


def digest(script: str) -> str:
    """Return the hash of a script for a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def _harmless(script: str) -> str:
    """Return a script that cannot close its HTML element early."""
    script = re.sub(r"^//# sourceMappingURL=.*$", "", script, flags=re.MULTILINE)  # browsers would fetch the map
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
    """Draw and save figures, return them for a page, and remove outdated figures of an earlier report."""
    from heliosweep.report.draw import drawn, image, pixels, png

    if folder.is_symlink():
        raise StudyError(Problem("is a link, not a folder of a run; move it away", file=str(folder)))
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
    """Return a figure in the form that templates embed. The argument `picture` is the image if it exists."""
    from PIL.Image import Dither, Quantize

    from heliosweep.report.draw import pixels, png

    picture = picture or pixels(named.figure)
    width, height = (round(0.55 * side) for side in picture.size)  # CSS pixels per pixel of the image
    small = png(picture.quantize(256, method=Quantize.FASTOCTREE, dither=Dither.NONE))  # reduces the size to a quarter
    about: Any = {"name": named.name, "caption": named.caption, "width": width, "height": height}
    return about | {"png": base64.b64encode(small).decode()}


def for_others(page: str, study: str) -> str:
    """Return a page without the author's machine, command and paths, and with `study` as the text of the study file."""
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

"""Page of a result: headline numbers and main picture, results, figures, interactive plots, inputs, provenance.

The page is one file. It fetches nothing and runs only its own scripts.
"""

from __future__ import annotations

import base64
import hashlib
import itertools
import logging
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import remove_leftovers, user_path, write_whole
from heliosweep.report import comparison, tables
from heliosweep.report.coverage import coverage
from heliosweep.report.figures import Figure, NamedFigure, default_figures, with_heat_map
from heliosweep.report.inputs import inputs
from heliosweep.store.folder import MANIFEST, OUTPUTS, STUDIES, read_manifest
from heliosweep.store.read import open_result

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("heliosweep")

#: Function that returns the family of a result, or None.
FamilyOf: TypeAlias = Callable[["xr.Dataset"], Any]

PAGE, SUMMARY, FIGURES = "report.html", "summary.html", "figures"
#: List of the figures that a report has drawn, in their folder; a later report removes no other file.
DRAWN = ".drawn"
#: Width of a figure on a page at its own size. [CSS pixel per pixel of the image]
SCALE = 0.55
#: Number of rows of the first table of a summary.
SUMMARY_ROWS = 12
#: Parts of a page about the machine.
_MACHINE = re.compile(
    r'<section id="provenance">.*?</section>\n?|<details class="asked">.*?</details>\n?'
    r'|<a class="ours"[^>]*>[^<]*</a>\n?',
    re.DOTALL,
)


def write_report(
    folder: str | os.PathLike[str], family_of: FamilyOf, study: Study | None = None, *, vector: Sequence[str] = ()
) -> Path:
    """Draw the figures of a result folder and write its page.

    Parameters
    ----------
    folder : path
        Result folder with ``result.nc`` or ``result.zarr``, and ``manifest.json`` and ``study.resolved.yaml`` (in an
        unpacked archive ``study.yaml``) if they exist.
    family_of : callable
        Function that returns the family of a result, or None.
    study : Study, optional
        Study with the published numbers; by default the comparison in the folder is shown.
    vector : sequence of {"svg", "pdf"}
        File formats of figures besides PNG.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    StudyError
        If the folder has no result, or published numbers do not fit the result.
    HeliosweepError
        If the result is damaged.
    """
    return _write(folder, family_of, PAGE, study, vector)


def write_summary(folder: str | os.PathLike[str], family_of: FamilyOf) -> Path:
    """Write ``summary.html``, which prints on one page; parameters as for `write_report`."""
    return _write(folder, family_of, SUMMARY)


def _write(
    folder: str | os.PathLike[str],
    family_of: FamilyOf,
    name: str,
    study: Study | None = None,
    vector: Sequence[str] = (),
) -> Path:
    from heliosweep.store.read import check_digest, locate

    place = user_path(folder)
    if study is None:  # else it was checked or written just now
        check_digest(locate(place))
    with open_result(place) as result:
        content = _content(place, result, family_of(result), study, vector, short=name == SUMMARY)
    write_whole(place / name, render("page.html" if name == PAGE else name, file=locate(place).name, **content))
    return place / name


def _content(
    place: Path, result: xr.Dataset, family: Any, study: Study | None, vector: Sequence[str], short: bool
) -> dict[str, Any]:
    """Return everything that the template of a page or of a summary shows."""
    names = family.headlines if family else ()
    manifest, damage = _manifest(place)
    missing = _Missing(bool(manifest))
    compared = _comparison(place, study, result)
    asked = study or study_of(place, family)
    figures: list[Figure] = []
    with missing.noted("The figures"):
        declared = family.figures(result) if family else default_figures(result)
        figures = with_heat_map(result, declared, names)
    drawn = _draw(place / FIGURES, missing, result, figures, vector) if not short else _first(missing, result, figures)
    made, went_in, (script, plots) = list[tables.Table](), None, ("", list[dict[str, str]]())
    with missing.noted("The tables of results"):
        made = list(family.tables(result) if family else ()) or tables.default_tables(result, names)
    with missing.noted("The table of inputs"):
        went_in = inputs(asked, coverage(result, asked))
    if not short:
        from heliosweep.report.interactive import client, explore

        with missing.noted("The interactive plots"):
            script, plots = explore(result, figures)
    headlines = tables.headlines(result, names)
    title = str(result.attrs.get("title", place.name))
    about = (str(result.attrs[name]) for name in ("source", "study_id") if name in result.attrs)
    published = [compared.table(result).printed()] if compared and compared.values else []
    return {
        "title": title,
        "headline": str(headlines[0]) if headlines else "",
        "headlines": headlines,
        "about": " \N{MIDDLE DOT} ".join(about),
        "summary": result.attrs.get("summary", ""),
        "answers": list(family.answers(result)) if family and hasattr(family, "answers") else [],
        "compared": compared,
        "published": published,
        "remarks": [*damage, *(compared.surprises if compared else ()), *manifest.get("remarks", ()), *missing.remarks],
        "went_in": went_in.printed() if went_in else None,
        "study_file": next((name for name in STUDIES if (place / name).is_file()), ""),
        "listed": place.absolute().parent.name == OUTPUTS,
        "asked": next(filter(None, (_text(place / name) for name in STUDIES)), ""),
        "tables": [one.printed() for one in _without(made, headlines)],
        "picture": drawn[0] if drawn else None,
        "figures": drawn[1:],
        "plots": plots,
        "scripts": [_harmless(client()), _harmless(script)] if plots else [],
        "made": provenance(manifest),
        "command": command(manifest),
        "references": tables.references(result),
        "rows": SUMMARY_ROWS,
    }


def _without(made: Sequence[tables.Table], headlines: Sequence[tables.Headline]) -> list[tables.Table]:
    """Return the tables of a single point without its headline numbers."""
    shown = {(one.value, one.unit) for one in headlines}
    kept = []
    for one in made:
        if one.size == 1:
            columns = [column for column in one.columns if (tables.number_of(column), column.unit) not in shown]
            one = replace(one, columns=columns)
        kept += [one] if len(one.columns) > one.keys else []
    return kept


def render(template: str, **content: Any) -> str:
    """Return a page from a template; all text in it is escaped."""
    return _environment().get_template(template).render(style=_style(), **content)


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
    return made


@cache
def _style() -> Markup:
    return Markup(resources.files("heliosweep.report").joinpath("templates/page.css").read_text(encoding="utf-8"))


def linked(text: str) -> Markup:
    """Return a text with its digital object identifiers as links."""
    pieces, end = [], 0
    for found in tables.DOI.finditer(text):
        link = Markup('<a href="https://doi.org/{}">{}</a>').format(found.group(1), found.group())
        pieces += [escape(text[end : found.start()]), link]
        end = found.end()
    return Markup("").join([*pieces, escape(text[end:])])


def digest(script: str) -> str:
    """Return the digest of a script for a content security policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def _harmless(script: str) -> str:
    """Return a script that cannot end its element early."""
    script = re.sub(r"^//# sourceMappingURL=.*$", "", script, flags=re.MULTILINE)  # it would be fetched
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


class _Missing:
    """Notes about missing parts of a page; without a manifest, a failure is an error instead."""

    def __init__(self, sound: bool) -> None:
        self._sound = sound
        self.remarks: list[str] = []

    @contextmanager
    def noted(self, what: str) -> Iterator[None]:
        """Note that a part is missing, and why, if making it fails."""
        try:
            yield
        except (HeliosweepError, OSError):
            raise
        except Exception as error:
            if not self._sound:
                raise
            what = " ".join(getattr(error, "__notes__", ())) or what
            self.remarks.append(f"{what} could not be drawn ({type(error).__name__}: {error}).")
            log.warning("%s", self.remarks[-1])
            log.debug("why", exc_info=True)


def _drawn(missing: _Missing, result: xr.Dataset, figures: Sequence[Figure]) -> Iterator[NamedFigure]:
    """Yield the figures of a result that can be drawn."""
    from heliosweep.report.draw import draw

    rest = draw(result, figures)
    while True:
        found = None
        with missing.noted("A figure"):
            found = next(rest, rest)
        if found is rest:
            return
        if isinstance(found, NamedFigure):
            yield found


def _first(missing: _Missing, result: xr.Dataset, figures: Sequence[Figure]) -> list[dict[str, Any]]:
    """Draw the main picture alone."""
    from heliosweep.report.style import pixels

    return [embeddable(one, pixels(one.figure)) for one in itertools.islice(_drawn(missing, result, figures), 1)]


def _draw(
    folder: Path, missing: _Missing, result: xr.Dataset, figures: Sequence[Figure], vector: Sequence[str]
) -> list[dict[str, Any]]:
    """Draw and save the figures; remove figures of an earlier report that are not drawn any more."""
    from heliosweep.report.style import image, pixels, png

    if folder.is_symlink():
        raise StudyError(Problem("is a link, and no folder of a run; move it away", file=str(folder)))
    folder.mkdir(exist_ok=True)
    remove_leftovers(folder)
    written, shown, before = list[str](), list[dict[str, Any]](), _text(folder / DRAWN).splitlines()
    for named in _drawn(missing, result, figures):
        with missing.noted(f"The figure {named.name}"):
            picture = pixels(named.figure)
            for kind in ("png", *vector):
                path = folder / f"{named.name}.{kind}"
                write_whole(path, png(picture) if kind == "png" else image(named.figure, kind))
                written.append(path.name)
            shown.append(embeddable(named, picture))
    for name in {Path(name).name for name in before} - {"", *written}:
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / DRAWN, "".join(f"{name}\n" for name in written))
    return shown


def embeddable(named: NamedFigure, picture: Any) -> dict[str, Any]:
    """Return a figure as the templates embed it in a page."""
    from heliosweep.report.style import small

    width, height = (round(SCALE * side) for side in picture.size)
    image = base64.b64encode(small(picture)).decode()
    return {"name": named.name, "caption": named.caption, "png": image, "width": width, "height": height}


def for_others(page: str) -> str:
    """Return a page without the machine, the command and the paths of its author."""
    return _MACHINE.sub("", page).replace('href="study.resolved.yaml"', 'href="study.yaml"')


def _comparison(place: Path, study: Study | None, result: xr.Dataset) -> comparison.Compared | None:
    """Return the comparison with published numbers: computed and stored with the study, else read."""
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


def study_of(place: Path, family: Any) -> Study | None:
    """Return the study of a result folder; None if it cannot be read, for instance without the files that it names."""
    from heliosweep.config.load import load

    for path in (place / name for name in STUDIES):
        if family and path.is_file():
            with suppress(HeliosweepError):
                return load(path, {family.name: family.study_class()})
    return None


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _manifest(place: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the manifest of a folder, and remarks about it."""
    if not (place / MANIFEST).exists():
        return {}, []
    try:
        return read_manifest(place), []
    except HeliosweepError as error:
        log.warning("%s: %s", place, error)
        return {}, [f"The provenance is missing: {error}"]


def provenance(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return pairs of a name and a text about how the result was computed."""
    if not manifest:
        return []
    result, environment = manifest["result"], manifest.get("environment", {})
    packages, commit = environment.get("packages", {}), environment.get("commit")
    others = [f"{name} {packages[name]}" for name in sorted(packages) if name != "heliosweep" and packages[name]]
    scheduler, workers = manifest.get("scheduler"), manifest.get("workers")
    evaluations = manifest.get("plan", {}).get("evaluations")
    pairs = [
        ("finished", manifest.get("finished")),
        ("study", manifest.get("study_id")),
        ("heliosweep", " ".join(filter(None, [packages.get("heliosweep"), commit and f"(commit {commit})"]))),
        ("Python", environment.get("python")),
        ("packages", ", ".join(others)),
        ("platform", environment.get("platform")),
        ("scheduler", f"{scheduler}, {workers} workers" if scheduler and workers else scheduler),
        ("evaluations", None if evaluations is None else f"{evaluations:,}"),
        ("time", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in manifest.get("seconds", {}).items())),
        (result["file"], f"{result['bytes']:,} bytes" if "bytes" in result else None),
        ("sha256 of the file", result.get("sha256")),
    ]
    return [(name, text) for name, text in pairs if text]


def command(manifest: Mapping[str, Any]) -> str:
    """Return the command that computes the result again, without other studies; empty if unknown."""
    words, own = list(map(str, manifest.get("command", []))), PurePath(manifest.get("study_file", ""))
    studies = [word for word in words if word.endswith((".yaml", ".yml"))]
    others = [word for word in studies if PurePath(word) != own]  # which has no "./" in front
    return shlex.join(word for word in words if word not in others or len(others) == len(studies))

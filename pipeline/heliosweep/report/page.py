"""One plain page for a result: what was asked, what came out, and how to get it again.

The page is a single file: images and scripts are part of it, nothing is fetched, and no other script can run.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable, Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from heliosweep.errors import HeliosweepError
from heliosweep.report import comparison, sections
from heliosweep.report.headline import headline
from heliosweep.report.html import Html, element, html, join
from heliosweep.report.interactive import Interactive, interactive, policy
from heliosweep.report.published import read_published
from heliosweep.report.style import image, small
from heliosweep.report.views import View, default_views
from heliosweep.store import records
from heliosweep.store.finished import MANIFEST, read_manifest
from heliosweep.store.manifest import write_atomically

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study
    from heliosweep.families.registry import Family, NamedFigure, Table

log = logging.getLogger("heliosweep")

PAGE = "report.html"
FIGURES = "figures"

#: Images of a page up to which they have all their pixels, and the scale of those beyond. [bytes]
MOST_IMAGES, REDUCED = 1_200_000, 0.6

#: Names of the figures that a report has drawn, in their folder: no other file is ours to remove.
DRAWN = ".drawn"

#: The study of a run, and of an unpacked archive.
STUDIES = ("study.resolved.yaml", "study.yaml")


class _Environment(records.Record):
    python: str | None = None
    platform: str | None = None
    packages: dict[str, str | None] = Field(default_factory=dict)
    commit: str | None = None


class _Plan(records.Record):
    evaluations: int | None = None


class _Manifest(records.Manifest):
    """A manifest, and what else of it is told on a page."""

    command: list[str] = Field(default_factory=list)
    environment: _Environment = _Environment()
    plan: _Plan = _Plan()
    remarks: list[str] = Field(default_factory=list)
    scheduler: str | None = None
    seconds: dict[str, float] = Field(default_factory=dict)
    workers: int | None = None


def write_report(folder: str | os.PathLike[str], study: Study | None = None, *, vector: Sequence[str] = ()) -> Path:
    """Draw the figures of a result folder and write its page.

    Parameters
    ----------
    folder : path
        Result folder with ``result.nc`` or ``result.zarr``; ``manifest.json`` and ``study.resolved.yaml`` (of an
        unpacked archive: ``study.yaml``) are shown where they are. Of a damaged manifest, the page says so.
    study : Study, optional
        The study, for the published numbers that it names; without it, the comparison stored in the folder is shown.
    vector : sequence of {"svg", "pdf"}
        Formats in which figures are saved besides PNG.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    StudyError
        No result in the folder, or published numbers that do not fit it.
    HeliosweepError
        The result is damaged.
    """
    from heliosweep.store.raw import locate
    from heliosweep.store.sound import blaming_damage, sound
    from heliosweep.workflow import open_result

    place = Path(folder)
    if study is None:  # else it was checked or written just now
        sound(place, as_written=True)
    with blaming_damage(place), open_result(place) as result:
        compared = _comparison(place, study, result)
        manifest, damage = _manifest(place)
        marked = comparison.told(result, compared.values) if compared else result
        drawings = list(_draw(place / FIGURES, _figures(marked), vector))
        live = interactive(result, _views(result))
        body = [
            sections.header(result, compared),
            element(
                "main",
                "\n",
                join(
                    [
                        sections.remarks([*damage, *manifest.get("remarks", ())]),
                        sections.asked(next(filter(None, (_text(place / name) for name in STUDIES)), "")),
                        sections.results(result, _tables(result)),
                        sections.comparison(compared, result),
                        live.body,
                        sections.figures(drawings),
                        sections.provenance(manifest),
                        sections.references(result),
                    ],
                    "\n",
                ),
            ),
            sections.footer(locate(place).name),
            live.end,
        ]
        title = str(result.attrs.get("title", place.name))
        number = headline(result, getattr(_family(result), "headlines", ()))
    page = place / PAGE
    write_atomically(page, _document(title, number, body, live))
    return page


def _figures(result: xr.Dataset) -> Iterable[NamedFigure]:
    """Figures that the result's family draws; none where the family is not installed."""
    family = _family(result)
    return family.figures(result) if family else ()


def _tables(result: xr.Dataset) -> Iterable[Table]:
    """Tables that the result's family makes of it, if it makes any."""
    make = getattr(_family(result), "tables", None)
    return make(result) if make else ()


def _views(result: xr.Dataset) -> Iterable[View]:
    """Interactive plots that the result's family declares, else those that its dimensions allow."""
    make = getattr(_family(result), "views", None)
    return make(result) if make else default_views(result)


def _family(result: xr.Dataset) -> Family[Any] | None:
    from heliosweep.families.registry import families

    return families().get(json.loads(result.attrs.get("study", "{}")).get("family"))


def _draw(folder: Path, figures: Iterable[NamedFigure], vector: Sequence[str]) -> Iterator[sections.Drawing]:
    """Draw, save and let go of one figure after the other; then remove those of an earlier run."""
    folder.mkdir(exist_ok=True)
    written, embedded, before = [], 0, _text(folder / DRAWN).splitlines()
    for named in figures:
        images = {kind: image(named.figure, kind) for kind in ("png", *vector)}
        for kind, content in images.items():
            path = folder / f"{named.name}.{kind}"
            _write(path, content)
            written.append(path.name)
        shown = small(images["png"], 1.0 if embedded <= MOST_IMAGES else REDUCED)
        embedded += len(shown)
        yield sections.Drawing(named.caption, shown, *map(float, named.figure.get_size_inches()))
    for name in {Path(name).name for name in before} - {"", *written}:
        (folder / name).unlink(missing_ok=True)
    _write(folder / DRAWN, "".join(f"{name}\n" for name in written).encode())


def _write(path: Path, content: bytes) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _comparison(place: Path, study: Study | None, result: xr.Dataset) -> sections.Compared | None:
    """Comparison with published numbers: made and stored where the study is at hand, else read back."""
    stored = place / comparison.FILE
    if study is None:
        return sections.Compared(*comparison.read_comparison(stored)) if stored.is_file() else None
    published = study.report.published
    if published is None:
        stored.unlink(missing_ok=True)
        return None
    table = read_published(study.resolve(published.file), published.source, published.file)
    compared = sections.Compared(comparison.compare(result, table), published.source)
    write_atomically(stored, comparison.comparison_csv(compared.values, compared.source))
    log.info("%s: %s", compared.source, comparison.summary(compared.values))
    return compared


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _manifest(place: Path) -> tuple[dict[str, Any], list[str]]:
    """The manifest of a folder, if it has one, and what is wrong with it."""
    if not (place / MANIFEST).exists():
        return {}, []
    try:
        manifest = read_manifest(place)
        try:
            return records.check(manifest, _Manifest), []
        except ValueError as error:
            raise HeliosweepError(f"{MANIFEST}: is damaged: {error}") from None
    except HeliosweepError as error:
        log.warning("%s: %s", place, error)
        return {}, [f"How it was made is not told: {error}"]


def _document(title: str, number: str, body: Iterable[Html], live: Interactive) -> str:
    css = resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    head = [
        Html('<meta charset="utf-8">'),
        policy(live.scripts),
        Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Html('<meta name="generator" content="heliosweep">'),
        Html(f'<meta name="description" content="{html(number)}">'),
        element("title", title),
        element("style", Html("\n" + css)),
    ]
    content = [element("head", "\n", join(head, "\n"), "\n"), element("body", "\n", join(body, "\n"), "\n")]
    return '<!doctype html>\n<html lang="en">\n' + join(content, "\n") + "\n</html>\n"

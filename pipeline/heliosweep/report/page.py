"""One plain page for a result: what was asked, what came out, and how to get it again.

The page is a single file: images and scripts are part of it, nothing is fetched, and no other script can run.
"""

from __future__ import annotations

import base64
import hashlib
import logging
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import remove_leftovers, user_path, write_whole
from heliosweep.report import comparison, sections
from heliosweep.report.contents import NamedFigure
from heliosweep.report.inputs import inputs
from heliosweep.report.ranking import ranked
from heliosweep.report.sampled import sampled
from heliosweep.report.views import default_views
from heliosweep.store.folder import MANIFEST, OUTPUTS, STUDIES, read_manifest
from heliosweep.store.read import open_result

if TYPE_CHECKING:
    import xarray as xr
    from PIL.Image import Image

log = logging.getLogger("heliosweep")

#: The family that tells of a result; None where nobody knows it.
FamilyOf: TypeAlias = Callable[["xr.Dataset"], Any]

PAGE = "report.html"

FIGURES = "figures"

#: Images of a page up to which they have all their pixels, and the scale of those beyond. [bytes]
MOST_IMAGES, REDUCED = 1_200_000, 0.6

#: Size on the screen of one inch of a figure. [CSS pixel]
PIXELS = 144

#: Names of the figures that a report has drawn, in their folder: no other file is ours to remove.
DRAWN = ".drawn"


#: Parts of a page that tell of the machine of who made it.
_MACHINE = re.compile(
    r'<section id="how-it-was-made">.*?</section>\n?|<details class="asked">.*?</details>\n?'
    r'|<a class="ours"[^>]*>[^<]*</a>\n?',
    re.DOTALL,
)


def write_report(
    folder: str | os.PathLike[str],
    family_of: FamilyOf,
    study: Study | None = None,
    *,
    vector: Sequence[str] = (),
) -> Path:
    """Draw the figures of a result folder and write its page.

    Parameters
    ----------
    folder : path
        Result folder with ``result.nc`` or ``result.zarr``; ``manifest.json`` and ``study.resolved.yaml`` (of an
        unpacked archive: ``study.yaml``) are shown where they are. Of a damaged manifest, the page says so.
    family_of : callable
        Gives the family of a result; without one, it is told by its numbers and dimensions.
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
    from heliosweep.store.checks import blaming_damage, sound
    from heliosweep.store.read import locate

    place = user_path(folder)
    if study is None:  # else it was checked or written just now
        sound(place, as_written=True)
    with blaming_damage(place), open_result(place) as result:
        text = _page(place, locate(place).name, result, family_of(result), study, vector)
    write_whole(place / PAGE, text)
    return place / PAGE


def _page(
    place: Path,
    file: str,
    result: xr.Dataset,
    family: Any,
    study: Study | None,
    vector: Sequence[str],
) -> str:
    from heliosweep.report.interactive import explore, scripts

    headlines = family.headlines if family else ()
    compared = _comparison(place, study, result)
    manifest, damage = _manifest(place)
    surprises = compared.surprises if compared else []
    undrawn = _Undrawn(bool(manifest))
    views: list[dict[str, Any]] = []
    plots: dict[str, Any] = {}
    results = None
    went_in, fixed_is_told = None, False
    points = None
    with undrawn.noting("The table of inputs"):
        asked = study or study_beside(place, family)
        went_in = inputs(asked, sampled(result, asked))
        fixed_is_told = isinstance(asked, Study)
    with undrawn.noting("The interactive plots"):
        views, plots = explore(result, family.views(result) if family else default_views(result))
    with undrawn.noting("The tables of results"):
        results = sections.results(result, family.tables(result) if family else (), headlines)
    with undrawn.noting("The ranking"):
        points = ranked(result, headlines)
    figures = _draw(place / FIGURES, undrawn, family, result, compared, vector)
    return render(
        "page.html",
        title=str(result.attrs.get("title", place.name)),
        heading=str(result.attrs.get("title", "A result")),
        headline=sections.headline(result, headlines),
        about=" \N{MIDDLE DOT} ".join(
            str(result.attrs[name]) for name in ("source", "study_id") if name in result.attrs
        ),
        summary=result.attrs.get("summary"),
        compared=compared,
        comparison=compared and compared.table(result),
        remarks=[*damage, *surprises, *manifest.get("remarks", ()), *undrawn.remarks],
        went_in=went_in,
        study_file=next((name for name in STUDIES if (place / name).is_file()), ""),
        listed=place.absolute().parent.name == OUTPUTS,
        asked=next(filter(None, (_text(place / name) for name in STUDIES)), ""),
        results=results,
        shared="" if fixed_is_told or not results else results["shared"],
        views=views,
        plots=plots,
        ranked=points,
        scripts=scripts(bool(views), points is not None),
        figures=figures,
        made=sections.made(manifest),
        command=sections.command(manifest),
        references=sections.references(result),
        file=file,
    )


def render(template: str, **content: Any) -> str:
    """A page from one of the templates; all that is text in it is escaped."""
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
    made.policies["json.dumps_kwargs"] = {"sort_keys": False, "allow_nan": False}  # Bokeh reads in the order of writing
    return made


@cache
def _style() -> Markup:
    return Markup(resources.files("heliosweep.report").joinpath("templates/page.css").read_text(encoding="utf-8"))


def linked(text: str) -> Markup:
    """Text with its digital object identifiers as links."""
    pieces, end = [], 0
    for found in sections.DOI.finditer(text):
        link = Markup('<a href="https://doi.org/{}">{}</a>').format(found.group(1), found.group())
        pieces += [escape(text[end : found.start()]), link]
        end = found.end()
    return Markup("").join([*pieces, escape(text[end:])])


def digest(script: str) -> str:
    """Digest of a script, as a content security policy writes it."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


class _Undrawn:
    """What could not be drawn, for the page; without a manifest, it is a fault of the result and not noted here."""

    def __init__(self, sound: bool) -> None:
        self._sound = sound
        self.remarks: list[str] = []

    @contextmanager
    def noting(self, what: str) -> Iterator[None]:
        """Note that something is missing on the page, and why, where making it fails."""
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


def _draw(
    folder: Path,
    undrawn: _Undrawn,
    family: Any,
    result: xr.Dataset,
    compared: comparison.Compared | None,
    vector: Sequence[str],
) -> list[dict[str, Any]]:
    """Draw and save one figure after the other, and let go of it; then remove those of an earlier run."""
    from heliosweep.report.style import image, pixels, png, small

    told = comparison.told(result, compared.values) if compared else result
    figures: Iterable[NamedFigure] = family.figures(told) if family else ()
    if folder.is_symlink():
        raise StudyError(Problem("is a link, and no folder of a run; move it away", file=str(folder)))
    folder.mkdir(exist_ok=True)
    remove_leftovers(folder)
    written, embedded, before = list[str](), 0, _text(folder / DRAWN).splitlines()

    def save(named: NamedFigure, picture: Image, others: Mapping[str, bytes]) -> dict[str, Any]:
        nonlocal embedded
        for kind, content in {"png": png(picture), **others}.items():
            path = folder / f"{named.name}.{kind}"
            write_whole(path, content)
            written.append(path.name)
        embedded += len(shown := small(picture, 1.0 if embedded <= MOST_IMAGES else REDUCED))
        return embeddable(named, shown)

    saved, rest = list[Future[dict[str, Any]]](), iter(figures)
    with ThreadPoolExecutor(1) as saving:  # to compress takes a fifth of the time, and leaves Python to the next figure
        while True:
            named, picture = None, None
            with undrawn.noting("A figure"):
                if (named := next(rest, None)) is None:
                    break
            if named is None:
                continue
            with undrawn.noting(f"The figure {named.name}"):
                picture, others = pixels(named.figure), {kind: image(named.figure, kind) for kind in vector}
            if picture is None:
                continue
            if saved:
                saved[-1].result()  # of more than two figures the pixels are never held
            saved.append(saving.submit(save, named, picture, others))
    drawn = [one.result() for one in saved]
    for name in {Path(name).name for name in before} - {"", *written}:
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / DRAWN, "".join(f"{name}\n" for name in written))
    return drawn


def embeddable(named: NamedFigure, png: bytes) -> dict[str, Any]:
    """A figure as the templates set it in a page."""
    width, height = (round(PIXELS * side) for side in named.figure.get_size_inches())
    return {"caption": named.caption, "png": base64.b64encode(png).decode(), "width": width, "height": height}


def for_others(page: str) -> str:
    """A page without the machine, the command and the paths of who made it."""
    return _MACHINE.sub("", page).replace('href="study.resolved.yaml"', 'href="study.yaml"')


def _comparison(place: Path, study: Study | None, result: xr.Dataset) -> comparison.Compared | None:
    """Comparison with published numbers: made and stored where the study is at hand, else read back."""
    stored = place / comparison.FILE
    if study is None:
        return comparison.read_comparison(stored) if stored.is_file() else None
    compared = _compared(study, result)
    if compared is None:
        stored.unlink(missing_ok=True)
        return None
    write_whole(stored, comparison.comparison_csv(compared))
    log.info("%s: %s", compared.source, compared.summary)
    for surprise in compared.surprises:
        log.warning("%s: %s", compared.file, surprise)
    return compared


def _compared(study: Study, result: xr.Dataset) -> comparison.Compared | None:
    """Comparison with the published numbers that a study names."""
    published = study.report.published
    if published is None:
        return None
    table = comparison.read_published(study.resolve(published.file), published.source, published.file)
    return comparison.compare(result, table)


def study_beside(place: Path, family: Any) -> Study | None:
    """The study that lies beside a result; None where it cannot be read, as files that it names are elsewhere."""
    from heliosweep.config.load import load

    for path in (place / name for name in STUDIES):
        if family and path.is_file():
            with suppress(HeliosweepError):
                return load(path, {family.name: family.study_class()})
    return None


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


def _manifest(place: Path) -> tuple[dict[str, Any], list[str]]:
    """The manifest of a folder, if it has one, and what is wrong with it."""
    if not (place / MANIFEST).exists():
        return {}, []
    try:
        return read_manifest(place), []
    except HeliosweepError as error:
        log.warning("%s: %s", place, error)
        return {}, [f"How it was made is not told: {error}"]

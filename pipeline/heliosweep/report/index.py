"""The page over all studies of a folder of results: ``index.html``, with links to their pages."""

from __future__ import annotations

import html as markup
import logging
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from heliosweep.errors import HeliosweepError
from heliosweep.report import comparison
from heliosweep.report.html import Html, element, join
from heliosweep.report.interactive import policy
from heliosweep.store import records, working
from heliosweep.store.finished import read_manifest
from heliosweep.store.manifest import write_atomically

log = logging.getLogger("heliosweep")

INDEX = "index.html"

#: Where results go when nobody says, and the only place where an index is written unasked.
OUTPUTS = "outputs"

#: Of a page, so many letters hold its headline. [byte]
_HEAD = 8192

_DESCRIPTION = re.compile(r'<meta name="description" content="([^"]*)">')
_TITLE = re.compile(r"<title>([^<]*)</title>")


@dataclass(frozen=True)
class Entry:
    """One study in the list.

    Parameters
    ----------
    folder : str
        Name of its result folder.
    title, family, finished, headline : str
        What is told of it; empty where nobody knows.
    state, detail : str
        As `heliosweep.status` tells them.
    page : str
        Name of its page in the folder; empty where there is none.
    verdict : str
        Summary of the comparison with published numbers.
    agrees : bool
        Whether all of these agree.
    """

    folder: str
    title: str
    family: str
    finished: str
    headline: str
    state: str
    detail: str
    page: str
    verdict: str
    agrees: bool


def update_index(folder: str | os.PathLike[str]) -> Path | None:
    """Write the index anew after something happened in a result folder, if that lies in ``outputs``.

    Parameters
    ----------
    folder : path
        A result folder.

    Returns
    -------
    pathlib.Path or None
        The index; None where none is kept. An index that cannot be written stops nobody: the log says why.
    """
    place = Path(folder).absolute().parent
    if place.name != OUTPUTS:
        return None
    try:
        return write_index(place)
    except (OSError, HeliosweepError) as error:
        log.warning("the list of all studies was not written: %s", error)
        return None


def write_index(outputs: str | os.PathLike[str]) -> Path:
    """Write the page over all studies of a folder of results.

    Parameters
    ----------
    outputs : path
        Folder with result folders.

    Returns
    -------
    pathlib.Path
        ``index.html`` in it.
    """
    place = Path(outputs)
    page = place / INDEX
    write_atomically(page, _document(entries(place)))
    return page


def entries(outputs: Path) -> list[Entry]:
    """What is told of each study, the latest first."""
    folders = sorted(path for path in outputs.iterdir() if path.is_dir())
    found = [one for one in map(_entry, folders) if one.state != "not run"]
    return sorted(found, key=lambda one: one.finished, reverse=True)


def _entry(folder: Path) -> Entry:
    from heliosweep.workflow import status as status_of

    try:
        (status,) = status_of(folder)
        state, detail = status.state, status.detail
    except (HeliosweepError, OSError, ValueError, KeyError, TypeError) as error:
        state, detail = "damaged", str(error)
    manifest: dict[str, Any] = {}
    with suppress(HeliosweepError):
        manifest = read_manifest(folder)
    identity = manifest.get("identity") or _identity(folder)
    study, attributes = identity.get("study", {}), identity.get("attributes", {})
    page = folder / "report.html"
    head = _head(page)
    verdict, agrees = _verdict(folder / comparison.FILE)
    return Entry(
        folder.name,
        str(attributes.get("title") or study.get("title") or _found(_TITLE, head) or folder.name),
        str(study.get("family", "")).replace("_", " "),
        str(manifest.get("finished") or ""),
        _found(_DESCRIPTION, head),
        state,
        detail,
        page.name if page.is_file() else "",
        verdict,
        agrees,
    )


def _identity(folder: Path) -> dict[str, Any]:
    """What a run that goes on in a folder says of itself; nothing where that is missing or broken."""
    with suppress(OSError, ValueError):
        return records.check(records.read_json(folder / working.NAME / "study.json"), records.Identity)
    return {}


def _head(page: Path) -> str:
    """Beginning of a page, with its title and headline."""
    try:
        with page.open(encoding="utf-8", errors="replace") as file:
            return file.read(_HEAD)
    except OSError:
        return ""


def _found(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    return markup.unescape(found.group(1)) if found else ""


def _verdict(path: Path) -> tuple[str, bool]:
    try:
        values, _ = comparison.read_comparison(path) if path.is_file() else ([], "")
    except (HeliosweepError, OSError, ValueError):
        return "", False
    return (comparison.summary(values), all(one.agrees for one in values)) if values else ("", False)


def _document(found: list[Entry]) -> str:
    css = resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    head = [
        Html('<meta charset="utf-8">'),
        policy(()),
        Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Html('<meta name="generator" content="heliosweep">'),
        element("title", "Studies"),
        element("style", Html("\n" + css)),
    ]
    number = f"{len(found)} {'study' if len(found) == 1 else 'studies'}, the latest first."
    body = [
        element("header", element("h1", "Studies"), element("p", number, class_="about")),
        element("main", element("ul", "\n", join(map(_item, found), "\n"), "\n", class_="studies")),
        element("footer", "Written by heliosweep after each run and report."),
    ]
    content = [element("head", "\n", join(head, "\n"), "\n"), element("body", "\n", join(body, "\n"), "\n")]
    return '<!doctype html>\n<html lang="en">\n' + join(content, "\n") + "\n</html>\n"


def _item(one: Entry) -> Html:
    link = f"{quote(one.folder, errors='surrogateescape')}/{one.page}"
    printable = one.folder.encode(errors="replace").decode()
    name = element("a", one.title, href=f"./{link}") if one.page else one.title
    about = " \N{MIDDLE DOT} ".join(filter(None, [one.family, one.finished.replace("T", " ").rstrip("Z"), printable]))
    pieces = [element("h2", name), element("p", about, class_="about")]
    if one.state != "complete":
        pieces.append(element("p", element("strong", one.state), f": {one.detail}", class_="state"))
    if one.headline:
        pieces.append(element("p", one.headline))
    if one.verdict:
        pieces.append(element("p", one.verdict, class_=f"verdict {'agrees' if one.agrees else 'differs'}"))
    return element("li", *pieces)

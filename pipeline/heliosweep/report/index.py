"""The page over all studies of a folder of results: ``index.html``, with links to their pages."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

from heliosweep.errors import HeliosweepError
from heliosweep.files import user_path, write_whole
from heliosweep.report import comparison
from heliosweep.report.page import PAGE, render
from heliosweep.store.folder import read_manifest
from heliosweep.store.parts import WORKING, PartStore

log = logging.getLogger("heliosweep")

INDEX = "index.html"

#: Where results go when nobody says, and the only place where an index is written unasked.
OUTPUTS = "outputs"

#: Of a page, so many letters hold its headline. [byte]
_HEAD = 8192

_DESCRIPTION = re.compile(r'<meta name="description" content="([^"]*)">')
_TITLE = re.compile(r"<title>([^<]*)</title>")


class Status(Protocol):
    """What became of the study of a result folder, as `heliosweep.status` tells it."""

    @property
    def state(self) -> str:
        """``complete``, ``running``, ``interrupted``, ``damaged`` or ``not run``."""

    @property
    def detail(self) -> str:
        """In words: what is done and what is left."""


@dataclass(frozen=True)
class Entry:
    """One study in the list.

    Parameters
    ----------
    title, about, finished, headline : str
        What is told of it; empty where nobody knows.
    state, detail : str
        As `heliosweep.status` tells them.
    link : str
        Address of its page; empty where there is none.
    compared : Compared or None
        Comparison with published numbers.
    """

    title: str
    about: str
    finished: str
    headline: str
    state: str
    detail: str
    link: str
    compared: comparison.Compared | None


def update_index(folder: str | os.PathLike[str], status_of: Callable[[Path], Status]) -> Path | None:
    """Write the index anew after something happened in a result folder, if that lies in ``outputs``.

    Parameters
    ----------
    folder : path
        A result folder.
    status_of : callable
        What became of the study of a result folder.

    Returns
    -------
    pathlib.Path or None
        The index; None where none is kept. An index that cannot be written stops nobody: the log says why.
    """
    place = user_path(folder).absolute().parent
    if place.name != OUTPUTS:
        return None
    try:
        return write_index(place, status_of)
    except (OSError, HeliosweepError) as error:
        log.warning("the list of all studies was not written: %s", error)
        return None


def write_index(outputs: str | os.PathLike[str], status_of: Callable[[Path], Status]) -> Path:
    """Write the page over all studies of a folder of results.

    Parameters
    ----------
    outputs : path
        Folder with result folders.
    status_of : callable
        What became of the study of a result folder.

    Returns
    -------
    pathlib.Path
        ``index.html`` in it.
    """
    place = Path(outputs)
    studies = entries(place, status_of)
    write_whole(place / INDEX, render("index.html", title="Studies", scripts=(), studies=studies))
    return place / INDEX


def entries(outputs: Path, status_of: Callable[[Path], Status]) -> list[Entry]:
    """What is told of each study, the latest first."""
    folders = sorted(path for path in outputs.iterdir() if path.is_dir())
    told = [(folder, status_of(folder)) for folder in folders]
    found = [_entry(folder, status) for folder, status in told if status.state != "not run"]
    return sorted(found, key=lambda one: one.finished, reverse=True)


def _entry(folder: Path, status: Status) -> Entry:
    manifest: dict[str, Any] = {}
    with suppress(HeliosweepError):
        manifest = read_manifest(folder)
    identity = manifest.get("identity") or _identity(folder)
    study, attributes = identity.get("study", {}), identity.get("attributes", {})
    finished = str(manifest.get("finished") or "")
    family = str(study.get("family", "")).replace("_", " ")
    printable = folder.name.encode(errors="replace").decode()
    page = folder / PAGE
    head = _head(page)
    compared = None
    with suppress(HeliosweepError, OSError, ValueError):
        compared = comparison.read_comparison(folder / comparison.FILE)
    return Entry(
        str(attributes.get("title") or study.get("title") or _found(_TITLE, head) or printable),
        " \N{MIDDLE DOT} ".join(filter(None, [family, finished.replace("T", " ").rstrip("Z"), printable])),
        finished,
        _found(_DESCRIPTION, head),
        status.state,
        status.detail,
        f"./{quote(folder.name, errors='surrogateescape')}/{PAGE}" if page.is_file() else "",
        compared,
    )


def _identity(folder: Path) -> dict[str, Any]:
    """What a run that goes on in a folder says of itself; nothing where that is missing or broken."""
    with suppress(HeliosweepError):
        return PartStore.open(folder / WORKING).identity
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
    return unescape(found.group(1)) if found else ""

"""The page over all studies of a folder of results: ``index.html``, with links to their pages."""

from __future__ import annotations

import logging
import os
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from heliosweep.errors import HeliosweepError
from heliosweep.files import user_path, write_whole
from heliosweep.report import comparison
from heliosweep.report.page import PAGE, render
from heliosweep.store.chunks import unfinished
from heliosweep.store.folder import OUTPUTS, page_head, read_manifest, status_of

log = logging.getLogger("heliosweep")

INDEX = "index.html"


def update_index(folder: str | os.PathLike[str]) -> Path | None:
    """Update the index of all studies after a change of a result folder in ``outputs``.

    A failure is logged as a warning.
    """
    place = user_path(folder).absolute().parent
    if place.name != OUTPUTS:
        return None
    try:
        return write_index(place)
    except (OSError, HeliosweepError) as error:
        log.warning("the list of all studies was not written: %s", error)
        return None


def write_index(outputs: str | os.PathLike[str]) -> Path:
    """Write ``index.html``, the page over all studies of a folder of result folders."""
    place = Path(outputs)
    studies = entries(place)
    script = resources.files("heliosweep.report").joinpath("templates/index.js").read_text(encoding="utf-8")
    families = sorted({one["family"] for one in studies} - {""})
    text = render("index.html", title="Studies", scripts=(script,), studies=studies, families=families)
    write_whole(place / INDEX, text)
    return place / INDEX


def entries(outputs: Path) -> list[dict[str, Any]]:
    """Return the content of the template for each study, the latest first."""
    folders = sorted(path for path in outputs.iterdir() if path.is_dir())
    told = [(folder, status_of(folder)) for folder in folders]
    found = [
        {**_entry(folder), "state": status.state, "detail": status.detail}
        for folder, status in told
        if status.state != "not run"
    ]
    return sorted(found, key=lambda one: one["finished"], reverse=True)


def _entry(folder: Path) -> dict[str, Any]:
    manifest: dict[str, Any] = {}
    with suppress(HeliosweepError):
        manifest = read_manifest(folder)
    identity = manifest.get("identity") or {}
    with suppress(OSError, ValueError):  # an unfinished run
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

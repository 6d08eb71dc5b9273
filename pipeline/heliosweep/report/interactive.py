"""Interactive plots of a page: their places in the text, their numbers, and the scripts that draw them.

The scripts are Bokeh's, of which two bundles are embedded once, and those in the folder ``interactive_js``. They run
by their digests alone: nothing that a study says can become a script.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources, util
from pathlib import Path
from typing import Any

import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.report.html import Html, element, join, section
from heliosweep.report.payload import PAGE_VALUES, shares, view_payload, wanted
from heliosweep.report.views import View, usable

#: Bundles of Bokeh's scripts that are needed, in the order in which they run.
BUNDLES = ("bokeh.min.js", "bokeh-api.min.js")

#: Our own.
PARTS = ("numbers.js", "looks.js", "switches.js", "maps.js", "curves.js", "page.js")

#: Colours of a scale.
SHADES = 128

_ESCAPES = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


@dataclass(frozen=True)
class Interactive:
    """Interactive plots as pieces of a page.

    Parameters
    ----------
    body : Html
        Section for the body; empty where there is nothing to show.
    end : Html
        Data and scripts for the end of the body.
    scripts : tuple of str
        Digests of the scripts, as a content security policy writes them.
    """

    body: Html
    end: Html
    scripts: tuple[str, ...]


def interactive(result: xr.Dataset, views: Iterable[View]) -> Interactive:
    """Make the interactive plots of a result.

    Parameters
    ----------
    result : xarray.Dataset
        From `heliosweep.open_result`.
    views : iterable of View
        What its family declares.

    Returns
    -------
    Interactive
    """
    chosen = usable(result, views)
    if not chosen:
        return Interactive(Html(""), Html(""), ())
    budgets = shares([wanted(result, view) for view in chosen], PAGE_VALUES)
    payloads = [view_payload(result, view, budget) for view, budget in zip(chosen, budgets, strict=True)]
    frames = [_frame(number, view, made) for number, (view, made) in enumerate(zip(chosen, payloads, strict=True))]
    missing = element(
        "noscript", element("p", "These plots need JavaScript. The figures below and the tables above do without.")
    )
    words = element(
        "p",
        "Choose what is shown, hover for values, drag a rectangle to zoom in; with the keyboard, arrows move a plot, "
        "+ and \N{MINUS SIGN} zoom, 0 shows everything again. Every plot can be read as a table.",
        class_="hint",
    )
    data = script_json({"views": payloads, "palettes": _palettes()})
    sources = [*map(_bundle, BUNDLES), _own()]
    return Interactive(
        section("Explore", missing, words, join(frames, "\n")),
        join(
            [
                Html(f'<script type="application/json" id="heliosweep-data">{data}</script>'),
                *(Html(f"<script>{source}</script>") for source in sources),
            ],
            "\n",
        ),
        tuple(map(digest, sources)),
    )


def policy(scripts: Sequence[str]) -> Html:
    """Content security policy of a page: nothing is fetched, and only the known scripts run."""
    allowed = " ".join(f"'{one}'" for one in scripts) or "'none'"
    rules = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}; base-uri 'none'"
    return Html(f'<meta http-equiv="Content-Security-Policy" content="{rules}">')


def digest(script: str) -> str:
    """Digest of a script, as a content security policy writes it."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"


def script_json(value: Any) -> str:
    """JSON that can stand in a script element: no word in it ends or opens anything."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return re.sub("[<>&]", lambda found: _ESCAPES[found.group()], text)


def _frame(number: int, view: View, made: dict[str, Any]) -> Html:
    """Where one plot goes, with what can be said without scripts."""
    name = f"view-{number + 1}"
    said = " ".join(filter(None, [view.caption, made["thinned"]]))
    return element(
        "figure",
        element("h3", made["title"], id=f"{name}-title"),
        element("div", class_="switches", role="group", aria_label=f"Choose what is shown: {made['title']}"),
        element("p", class_="said", role="status", aria_live="polite"),
        element(
            "div",
            class_="plot",
            role="group",
            tabindex=0,
            aria_labelledby=f"{name}-title",
            aria_description="Arrow keys move, plus and minus zoom, 0 shows everything again.",
        ),
        element("div", class_="keys"),
        element("details", element("summary", "Values as a table"), element("div"), class_="values"),
        element("figcaption", said) if said else Html(""),
        class_="view",
        id=name,
        data_view=number,
    )


def _palettes() -> dict[str, list[str]]:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    from heliosweep.report.style import COLOURS, DIFFERENCES, NO_VALUE, VALUES

    scales = {"values": colormaps[VALUES], "differences": colormaps[DIFFERENCES]}  # each is made when asked for
    found = {key: [to_hex(scale(i / (SHADES - 1))) for i in range(SHADES)] for key, scale in scales.items()}
    return {**found, "lines": list(COLOURS[:-1]), "none": [NO_VALUE]}


@cache
def _bundle(name: str) -> str:
    """Script of the installed Bokeh, which need not be imported for it."""
    spec = util.find_spec("bokeh")
    places = list(spec.submodule_search_locations or []) if spec else []
    for place in places:
        path = Path(place) / "server" / "static" / "js" / name
        if path.is_file():
            text = path.read_text(encoding="utf-8")
            # A map of the sources would be fetched by the developer tools.
            return _harmless(re.sub(r"\n//# sourceMappingURL=\S*\s*$", "\n", text), name)
    raise HeliosweepError(f"{name} of Bokeh is not installed; reinstall bokeh")


@cache
def _own() -> str:
    folder = resources.files(__package__).joinpath("interactive_js")
    parts = [folder.joinpath(name).read_text(encoding="utf-8") for name in PARTS]
    return _harmless("(function () {\n'use strict';\n" + "\n".join(parts) + "}());\n", "interactive_js")


def _harmless(script: str, name: str) -> str:
    if re.search(r"</script|<!--", script, re.IGNORECASE):
        raise HeliosweepError(f"{name} cannot be part of a page: it holds the end of a script")
    return script

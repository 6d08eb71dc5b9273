"""Bokeh's client: its script, and plots in the JSON that it reads.

Bokeh's own models in Python are not imported, for a page waited 0.4 s for them. A name, an attribute or a value that
Bokeh does not know is found by its client, which throws, and in the tests by those models.
"""

from __future__ import annotations

import base64
import gzip
import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import bokeh
import numpy as np


class Model:
    """One of Bokeh's models, with its attributes where they are not the defaults."""

    def __init__(self, kind: str, /, **attributes: Any) -> None:
        self.kind, self.attributes = kind, attributes


def field(name: str, **more: Any) -> dict[str, Any]:
    """What a property of a glyph is read from: a column of its source."""
    return {"field": name, **more}


def item(root: Model, target: str) -> dict[str, Any]:
    """A plot as ``Bokeh.embed.embed_item`` takes it, and the element of the page in which it is drawn."""
    names: dict[Model, str] = {}

    def written(value: Any) -> Any:
        if isinstance(value, Model):
            if value in names:
                return {"id": names[value]}
            names[value] = f"{target}-{len(names) + 1}"
            attributes = {key: written(one) for key, one in value.attributes.items()}
            return {"type": "object", "name": value.kind, "id": names[value], "attributes": attributes}
        if isinstance(value, np.ndarray):
            data = base64.b64encode(gzip.compress(value.tobytes(), 6, mtime=1)).decode()
            kind = {"dtype": value.dtype.name, "order": "big" if value.dtype.str[0] == ">" else "little"}
            return {"type": "ndarray", "array": {"type": "bytes", "data": data}, "shape": list(value.shape), **kind}
        if isinstance(value, Mapping):  # as pairs, for keys may be anybody's words
            return {"type": "map", "entries": [[key, written(one)] for key, one in value.items()]}
        return [written(one) for one in value] if isinstance(value, list | tuple) else value

    roots = [written(root)]
    return {"target_id": target, "root_id": names[root], "doc": {"version": bokeh.__version__, "roots": roots}}


@cache
def script() -> str:
    """Bokeh's client, which logs warnings and what is worse."""
    whole = resources.files(bokeh).joinpath("server/static/js/bokeh.min.js").read_text("utf-8")
    # A map of the sources would be fetched by the developer tools.
    return re.sub(r"^//# sourceMappingURL=.*$", "", f'{whole}\nBokeh.set_log_level("warn");', flags=re.MULTILINE)

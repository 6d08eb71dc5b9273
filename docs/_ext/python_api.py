"""Directive `python-api`: public names of the package, one on each line, from their docstrings."""

from __future__ import annotations

import inspect
from pkgutil import resolve_name

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class PythonApi(SphinxDirective):
    """`{python-api}`."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the documentation of the functions and classes of the content."""
        lines = ["```{eval-rst}"]
        for name in self.content:
            value = resolve_name(f"heliosweep.{name}")
            is_error = inspect.isclass(value) and issubclass(value, Exception)
            kind = "exception" if is_error else "class" if inspect.isclass(value) else "function"
            lines += [f".. auto{kind}:: heliosweep.{name}", *(["   :members:"] if kind == "class" else []), ""]
        return self.parse_text_to_nodes(StringList([*lines, "```"], source="python-api"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("python-api", PythonApi)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

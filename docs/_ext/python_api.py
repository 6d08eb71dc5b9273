"""Directive `python-api`: all public names of the package, from their docstrings."""

from __future__ import annotations

import inspect

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class PythonApi(SphinxDirective):
    """`{python-api}`."""

    def run(self) -> list[nodes.Node]:
        """Return functions first, then classes, then errors."""
        import heliosweep

        public = {name: getattr(heliosweep, name) for name in heliosweep.__all__ if not name.startswith("_")}
        kinds = {
            "autofunction": [name for name, value in public.items() if inspect.isfunction(value)],
            "autoclass": [n for n, v in public.items() if inspect.isclass(v) and not issubclass(v, Exception)],
            "autoexception": [n for n, v in public.items() if inspect.isclass(v) and issubclass(v, Exception)],
        }
        lines = ["```{eval-rst}"]
        for directive, names in kinds.items():
            for name in names:
                lines.append(f".. {directive}:: heliosweep.{name}")
                if directive == "autoclass":
                    lines.append("   :members:")
                lines.append("")
        if not kinds["autoclass"]:
            lines += [".. autoclass:: heliosweep.results.Result", "   :members:", ""]
        for name in ("HeliosweepAccessor", "Plots"):
            lines += [f".. autoclass:: heliosweep.accessor.{name}", "   :members:", ""]
        lines.append("```")
        return self.parse_text_to_nodes(StringList(lines, source="python-api"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("python-api", PythonApi)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

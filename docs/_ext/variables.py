"""Directive `variables`: the quantities of a study's result with dimensions and units, from the lazy result."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parent.parent.parent


#: Option of the directive -> key of the `output` block.
_OPTIONS = {"series": "time_series", "maps": "maps", "angles": "tracking_angles", "geometry": "field_geometry"}


class Variables(SphinxDirective):
    """`{variables} studies/NAME.yaml`; with `:series:` and other options those of time series and more too."""

    required_arguments = 1
    option_spec: ClassVar = dict.fromkeys(_OPTIONS, directives.flag)

    def run(self) -> list[nodes.Node]:
        """Return a table of the variables."""
        import heliosweep

        path = ROOT / self.arguments[0]
        study = heliosweep.load(path)
        wanted = {key: True for option, key in _OPTIONS.items() if option in self.options}
        output = study.output.model_copy(update=wanted)
        result = heliosweep.build(study.model_copy(update={"output": output}))
        lines = ["| variable | what | unit | over |", "|---|---|---|---|"]
        for name, array in result.data_vars.items():
            what = str(array.attrs.get("long_name", ""))
            if comment := array.attrs.get("comment"):
                what += f": {comment}"
            unit = array.attrs.get("units", "date" if array.dtype.kind == "M" else "")
            over = ", ".join(map(str, array.dims))
            lines.append(f"| `{name}` | {what.replace('|', chr(92) + '|')} | {unit} | {over} |")
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("variables", Variables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

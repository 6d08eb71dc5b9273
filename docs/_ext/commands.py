"""Directive `commands`: every command with its arguments, from the command line's own help."""

from __future__ import annotations

import argparse

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Commands(SphinxDirective):
    """`{commands}`."""

    def run(self) -> list[nodes.Node]:
        """Return a section for each command."""
        from heliosweep.cli import parser

        found = next(action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
        lines: list[str] = []
        for name, sub in found.choices.items():
            lines += [f"## {name}", "", sub.description or "", "", "| argument | what |", "|---|---|"]
            for action in sub._actions:
                if isinstance(action, argparse._HelpAction) or action.help == argparse.SUPPRESS:
                    continue
                shown = ", ".join(action.option_strings) or str(action.metavar or action.dest)
                if action.option_strings and action.nargs != 0 and (action.metavar or action.choices):
                    shown += f" {action.metavar or '{' + ','.join(map(str, action.choices or ())) + '}'}"
                shown, text = (text.replace("|", "\\|") for text in (shown, action.help or ""))
                lines.append(f"| `{shown}` | {text.replace('<', '&lt;')} |")
            lines.append("")
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

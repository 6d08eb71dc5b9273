"""Formulas as MathML, written while the site is built: browsers draw it, nothing is fetched."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def _tex(node: nodes.Element) -> str:
    """Return the formula with thin spaces about functions, which not every browser sets by itself."""
    text = re.sub(r"\\(arcsin|sin|cos|max)(\^\d)?\s*(?=([({\\])?)", r"\\,\\\1\2\\,", node.astext())
    return text.replace("°", r"^{\circ}")


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(tex2mathml(_tex(node)))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(tex2mathml(_tex(node), as_block=True))
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

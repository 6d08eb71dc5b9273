"""Markers of hard English in code and documentation stay within a budget, which only falls."""

import ast
import io
import re
import tokenize
from collections.abc import Iterable, Iterator

import pytest

from tests.conftest import ROOT

from .pages import PAGES

#: Markers in 1,000 sentences. Lower a budget when the text improves; never raise one.
BUDGET = {"code": 15, "docs": 15}

MARKERS = [
    re.compile(r"\bwhat (is|are|was|it|they|a|an|the|each|no|of|has|comes|follows|belongs|keeps)\b", re.IGNORECASE),
    re.compile(r"\bwhere (there|none|it|no|one|some|a|an|they|nothing|all|that|he|she)\b", re.IGNORECASE),
    re.compile(r"\b(says?|tells?|told|said|asks?|asked|knows?)\b", re.IGNORECASE),
    re.compile(r"\b(that|those) (of|that|which|who)\b", re.IGNORECASE),
    re.compile(r"\b(stands?|stood)\b", re.IGNORECASE),
    re.compile(r"\bso (many|much|large|small|long|often)\b", re.IGNORECASE),
    re.compile(r"\bbesides?\b", re.IGNORECASE),
    re.compile(r"^(What|Whether|Where|How|Which|Who|Whom|Those|Of|By|As|From|With)\b"),
]


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a text that have at least three words; code and equations count as one word."""
    text = re.sub(r"`[^`]*`|\$[^$]*\$", "X", text)
    for part in re.split(r"(?<=[.!?:;])\s+|\n\s*\n|\n\s*[-*|#]", text):
        words = part.split()
        if len(words) >= 3:
            yield " ".join(words)


def code() -> Iterator[str]:
    """Yield docstrings, other strings of at least four words, and comments of the package."""
    for path in sorted((ROOT / "pipeline").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                yield ast.get_docstring(node) or ""
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value.split()) >= 4:
                yield node.value
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.COMMENT:
                yield token.string.lstrip("#: ")


def docs() -> Iterator[str]:
    """Yield the pages of the documentation, without code blocks and comments."""
    for path in [*PAGES, ROOT / "studies/README.md"]:
        text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        yield re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)


def rate(texts: Iterable[str]) -> float:
    """Number of markers in 1,000 sentences."""
    counts = [sum(len(marker.findall(one)) for marker in MARKERS) for text in texts for one in sentences(text)]
    return 1000 * sum(counts) / len(counts)


@pytest.mark.parametrize(("name", "texts"), [("code", code), ("docs", docs)])
def test_markers_are_within_their_budget(name, texts):
    assert rate(texts()) <= BUDGET[name], "rewrite the sentences that carry a marker"

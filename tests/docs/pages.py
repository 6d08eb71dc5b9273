"""The pages of the documentation, their code blocks and their links.

What stands in a comment before a block says how it is tested:

    <!-- file: NAME -->       the block is written to that file, in the folder in which the page is run
    <!-- part of: FAMILY -->  YAML that is merged into the example of a family; `null` takes a key away
    <!-- exit: N -->          the exit code of the last command of the block
    <!-- output -->           what the block before it printed; `...` stands for anything
    <!-- not run: REASON -->  it cannot run in a test

A block of YAML that names a family is loaded and planned, whatever is said before it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *(path for path in sorted(DOCS.rglob("*.md")) if "_build" not in path.parts)]

_FENCE = re.compile(r"^(\s*)(`{3,})(\S*)[^`\n]*\n(.*?)^\1\2\s*$", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"<!--\s*(file|part of|exit|output|not run)\b:?\s*(.*?)\s*-->\s*\Z")


@dataclass(frozen=True)
class CodeBlock:
    """A block of code, what it is written in, and what the comment before it says."""

    page: Path
    line: int
    language: str
    text: str
    mark: str = ""
    said: str = ""

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> Iterator[CodeBlock]:
    """Yield the code blocks of a page; directives of Sphinx are none."""
    text = page.read_text(encoding="utf-8")
    for found in _FENCE.finditer(text):
        indent, _, language, body = found.groups()
        if language.startswith("{"):
            continue
        comment = _COMMENT.search(text[: found.start()])
        mark, said = comment.groups() if comment else ("", "")
        body = "".join(line.removeprefix(indent) for line in body.splitlines(keepends=True))
        yield CodeBlock(page, text[: found.start()].count("\n") + 1, language, body, mark, said)


def without_code(text: str) -> str:
    """Return a page without its code, in which nothing is a link."""
    return re.sub(r"`[^`\n]+`", "`code`", _FENCE.sub("", text))

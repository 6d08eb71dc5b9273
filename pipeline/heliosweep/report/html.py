"""Small pieces of HTML: everything that is text is escaped, whatever a title or a file name holds."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from html import escape

_DOI = re.compile(r"\b(?:https?://(?:dx\.)?doi\.org/|doi:?\s*)(10\.\d{4,9}/[^\s,;]*[^\s,;.)])", re.IGNORECASE)


class Html(str):
    """Text that is markup already."""


def html(value: object) -> Html:
    """Markup of a value: text is escaped, markup stays as it is."""
    return value if isinstance(value, Html) else Html(escape(str(value), quote=True))


def element(name: str, *content: object, **attributes: object) -> Html:
    """One element; ``class_`` stands for ``class``, an attribute that is None is left out."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value), quote=True)}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{given}>{join(content)}</{name}>")


def join(pieces: Iterable[object], between: str = "") -> Html:
    """Markup of several values after each other."""
    return Html(between.join(html(piece) for piece in pieces))


def section(heading: str, *content: object) -> Html:
    """A section of the page, with an anchor made of its heading."""
    anchor = re.sub(r"[^a-z]+", "-", heading.lower()).strip("-")
    return element("section", element("h2", heading), "\n", *content, id=anchor)


def table(
    header: Sequence[object],
    rows: Iterable[Sequence[object]],
    label: str,
    words: Collection[int] = (),
    classes: Sequence[str] = (),
) -> Html:
    """A table in a box of its own, which scrolls where the page is narrow.

    Parameters
    ----------
    header : sequence
        Names of the columns.
    rows : iterable of sequences
        Cells.
    label : str
        What the table holds, for readers who hear the page.
    words : collection of int
        Columns of text; the others are numbers, set to the right.
    classes : sequence of str
        Class of each row.

    Returns
    -------
    Html
    """

    def line(name: str, cells: Sequence[object], kind: str | None = None) -> Html:
        scope = "col" if name == "th" else None
        marked = [
            element(name, cell, class_="word" if i in words else None, scope=scope) for i, cell in enumerate(cells)
        ]
        return element("tr", *marked, class_=kind or None)

    lines = [line("td", row, classes[i] if classes else None) for i, row in enumerate(rows)]
    content = element("thead", line("th", header)), "\n", element("tbody", "\n", join(lines, "\n"))
    return element("div", element("table", *content), class_="scroll", role="region", aria_label=label, tabindex=0)


def definitions(pairs: Iterable[tuple[object, object]]) -> Html:
    """A list of names and what they are."""
    return element("dl", *(join([element("dt", name), element("dd", what)]) for name, what in pairs))


def linked(text: str) -> Html:
    """Text with its digital object identifiers as links."""
    pieces: list[object] = []
    end = 0
    for found in _DOI.finditer(text):
        pieces += [text[end : found.start()], element("a", found.group(), href=f"https://doi.org/{found.group(1)}")]
        end = found.end()
    return join([*pieces, text[end:]])


def doi_of(text: str) -> str | None:
    """First digital object identifier in a text, in lower case."""
    found = _DOI.search(text)
    return found.group(1).lower() if found else None

"""What the first lines of a result's page tell, without a library."""

from __future__ import annotations

import re
from contextlib import suppress
from html import unescape
from pathlib import Path

#: Of a page, so many letters hold its title and headline. [byte]
_HEAD = 8192

_DESCRIPTION = re.compile(r'<meta name="description" content="([^"]*)">')
_TITLE = re.compile(r"<title>([^<]*)</title>")


def head_of(page: Path) -> tuple[str, str]:
    """Return title and headline of a page; empty where there is none."""
    head = ""
    with suppress(OSError), page.open(encoding="utf-8", errors="replace") as file:
        head = file.read(_HEAD)
    found = (pattern.search(head) for pattern in (_TITLE, _DESCRIPTION))
    title, headline = (unescape(one.group(1)) if one else "" for one in found)
    return title, headline

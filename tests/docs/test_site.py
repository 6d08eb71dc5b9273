"""The site builds without a warning (`make docs`, `make long`), its links lead somewhere, and it needs no network."""

import os
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from heliosweep.config.study import json_schema
from heliosweep.families.family import families
from tests.conftest import ROOT

from .pages import DOCS, PAGES, without_code

#: What a browser loads by itself; a link is only followed by someone who clicks.
LOADED = {"img": "src", "script": "src", "link": "href", "source": "src", "iframe": "src"}


class Page(HTMLParser):
    """What a page links to, what it loads, and its anchors."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.without_text: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := found.get(key))}
        if tag == "a" and found.get("href"):
            self.links.append(str(found["href"]))
        if tag in LOADED and found.get(LOADED[tag]) and found.get("rel") not in ("canonical", "search", "index"):
            self.loaded.append(str(found[LOADED[tag]]))
        if tag == "img" and not found.get("alt"):
            self.without_text.append(str(found.get("src")))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site strictly, without running studies for the page of studies."""
    pytest.importorskip("sphinx")
    target = tmp_path_factory.mktemp("site")
    options = ["-W", "--keep-going", "-n", "-E", "-q", "-b", "html", "-d", str(target / "doctrees")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(DOCS), str(target / "html")],
        env={**os.environ, "HELIOSWEEP_DOCS_STUDIES": "no"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return target / "html"


@cache
def read(path: Path) -> Page:
    return Page(path)


@pytest.mark.long
def test_links_of_the_site_lead_somewhere(site: Path) -> None:
    broken = []
    for path in site.rglob("*.html"):
        for link in read(path).links + read(path).loaded:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file():
                broken.append(f"{path.name}: {link}")
            elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in read(target).anchors:
                broken.append(f"{path.name}: {link}: no such place")
    assert not broken


@pytest.mark.long
def test_nothing_is_fetched_from_the_network(site: Path) -> None:
    for path in site.rglob("*.html"):
        assert not [link for link in read(path).loaded if urlsplit(link).netloc], path.name
    for path in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*['\"]?(https?:)?//", path.read_text(encoding="utf-8")), path.name


@pytest.mark.long
def test_every_key_of_the_schema_has_a_place(site: Path) -> None:
    common = read(site / "reference" / "index.html").anchors
    for name, family in families().items():
        page = site / "reference" / f"{name}.html"
        assert page.exists(), f"the family {name} has no page"
        found = common | read(page).anchors
        for key in json_schema(family.study_class())["properties"]:
            places = {f"{owner}-{key}".replace("_", "-") for owner in (name, "field_efficiency")}
            assert places & found, (name, key)
    assert "field-efficiency-site-latitude" in read(site / "reference" / "field_efficiency.html").anchors


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_in_the_sources_lead_somewhere(page: Path) -> None:
    """As whoever reads the files themselves follows them."""
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
        parts = urlsplit(target)
        if parts.scheme:
            assert parts.scheme == "https", target
        elif parts.path and not parts.path.startswith("gallery/"):  # written by sphinx-gallery
            assert (page.parent / parts.path).exists(), target

"""The tables of keys on the pages of the reference are those of the schema."""

import sys
from pathlib import Path

import pytest

from .pages import DOCS

pytest.importorskip("sphinx")
sys.path.insert(0, str(DOCS / "_ext"))


@pytest.mark.parametrize("page", sorted((DOCS / "reference").glob("*.md")), ids=lambda page: page.stem)
def test_tables_are_those_of_the_schema(page: Path) -> None:
    from study_keys import filled

    text = page.read_text(encoding="utf-8")
    assert text == filled(text), "the keys have changed: run `make reference`"
    assert "Undefined" not in text  # a default that is built by a function
    assert page.stem == "commands" or text.count("\n| <a id=") > 5

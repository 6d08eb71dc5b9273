"""The nomenclature names keys and variables that exist."""

import re

import pytest

from heliosweep.config.study import keys_of
from heliosweep.families.family import families
from tests.conftest import ROOT

ROWS = [
    line.split("|")[1:-1] for line in (ROOT / "docs/nomenclature.md").read_text("utf-8").splitlines() if "|" in line
]
KEYS = [key for row in ROWS for key in re.findall(r"`([\w.]+)`", row[2])]


@pytest.fixture(scope="module")
def known() -> set[str]:
    return {key.name for family in families().values() for key in keys_of(family.study_class())}


@pytest.mark.parametrize("key", KEYS)
def test_keys_exist(key: str, known: set[str]) -> None:
    assert key in known

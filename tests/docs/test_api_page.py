"""The page on the Python interface documents each public name once."""

import re
from pkgutil import resolve_name

import heliosweep
from tests.conftest import ROOT


def test_each_public_name_is_documented_once():
    page = (ROOT / "docs/api.md").read_text(encoding="utf-8")
    names = [name for block in re.findall(r"```{python-api}\n(.*?)```", page, re.DOTALL) for name in block.split()]
    assert len(names) == len(set(names))
    assert {name for name in names if "." not in name} == {name for name in heliosweep.__all__ if name[0] != "_"}
    for name in names:
        assert resolve_name(f"heliosweep.{name}").__doc__

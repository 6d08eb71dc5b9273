"""The versions of what computes: libraries, and the code of a family."""

from importlib import metadata

import pytest

from heliosweep.store import manifest as codes

MODULE = "heliosweep.families.dish_tracking.compute"


@pytest.fixture(autouse=True)
def _forget():
    codes.code_versions.cache_clear()
    yield
    codes.code_versions.cache_clear()


def test_libraries_are_named():
    versions = codes.code_versions(MODULE)
    assert versions["numpy"] == metadata.version("numpy")
    assert all(isinstance(version, str) for version in versions.values())
    assert "missing" not in versions.values()


def test_another_library(monkeypatch):
    before = codes.code_versions(MODULE)
    codes.code_versions.cache_clear()
    monkeypatch.setattr(codes, "_version", lambda name: "1.0")
    assert codes.code_versions(MODULE) != before


def test_each_family_has_its_own():
    names = [f"heliosweep.families.{name}.compute" for name in ("dish_tracking", "field_efficiency")]
    assert len({codes.code_versions(name)["heliosweep"] for name in names}) == 2

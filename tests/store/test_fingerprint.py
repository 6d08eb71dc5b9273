"""The versions of what computes: libraries, the package's own sources, other packages' families."""

from __future__ import annotations

import shutil
from importlib import metadata
from pathlib import Path

import pytest

from heliosweep.store import fingerprint


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A copy of the sources that the fingerprint is taken of."""
    source = Path(fingerprint.__file__).parent.parent
    shutil.copytree(source, tmp_path / "heliosweep", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(fingerprint, "__file__", str(tmp_path / "heliosweep/store/fingerprint.py"))
    fingerprint.code_versions.cache_clear()
    return tmp_path / "heliosweep"


@pytest.fixture(autouse=True)
def _forget():
    yield
    fingerprint.code_versions.cache_clear()


def now() -> dict[str, str]:
    fingerprint.code_versions.cache_clear()
    return fingerprint.code_versions()


def test_libraries_are_named():
    versions = fingerprint.code_versions()
    assert versions["numpy"] == metadata.version("numpy")
    assert all(isinstance(version, str) for version in versions.values())
    assert "missing" not in versions.values()


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("kernels/sun.py", True), ("store/encoding.py", True),
        ("report/page.py", False), ("runtime/run.py", False), ("cli.py", False),
    ],
)  # fmt: skip
def test_sources_that_numbers_depend_on(package, name, counts):
    before = now()
    with (package / name).open("a") as file:
        file.write("# another line\n")
    assert (now() != before) == counts


def test_a_new_module_and_a_renamed_one(package):
    before = now()
    (package / "kernels/new.py").write_text("")
    added = now()
    (package / "kernels/new.py").rename(package / "kernels/newer.py")
    renamed = now()
    assert before != added != renamed != before


def test_another_library(package, monkeypatch):
    before = now()
    monkeypatch.setattr(fingerprint, "_version", lambda name: "1.0")
    assert now() != before

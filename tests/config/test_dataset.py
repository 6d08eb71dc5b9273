"""Licences and DOIs of data sets."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize("name", ["CC-BY-4.0", "CC0-1.0", "ODbL-1.0", "GPL-3.0-or-later", "LicenseRef-Our-own.2"])
def test_known_licences(name, load_study) -> None:
    assert load_study(f"dataset: {{license: {name}}}").dataset.license == name


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("FOO", "use one as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME"),
        ("cc-by-4.0", "did you mean 'CC-BY-4.0'?"),
        ("CC BY 4.0", "did you mean 'CC-BY-4.0'?"),
        ("CC-BY", "did you mean 'CC-BY-4.0'?"),
        ("ODBL", "did you mean 'ODbL-1.0'?"),
        ("GPL-3.0", "did you mean 'GPL-3.0-only'?"),
        ("LicenseRef-a b", "LicenseRef-NAME has letters"),
        ("LicenseRef-", "LicenseRef-NAME has letters"),
    ],
)
def test_unknown_licences(name, hint, refused) -> None:
    (problem,) = refused(f"dataset: {{license: '{name}'}}")
    assert (problem.file, problem.line, problem.key) == ("study.yaml", 8, "dataset.license")
    assert hint in problem.message


@pytest.mark.parametrize("before", ["", "https://doi.org/", "http://dx.doi.org/", "doi:"])
@pytest.mark.parametrize("doi", ["10.5281/zenodo.1234567", "10.1000.10/a(b)/c"])
def test_dois_are_stored_bare(before, doi, load_study) -> None:
    assert load_study(f"dataset: {{doi: '{before}{doi}'}}").dataset.doi == doi


@pytest.mark.parametrize("doi", ["notadoi", "10.5281", "10.52/x", "https://example.org/10.5281/x", "10.5281/a b"])
def test_what_is_no_doi(doi, refused) -> None:
    licence, problem = refused(f"dataset: {{license: FOO, doi: '{doi}'}}")
    assert licence.key == "dataset.license"
    assert (problem.file, problem.line, problem.key) == ("study.yaml", 8, "dataset.doi")
    assert "must be a DOI, as 10.5281/zenodo.1234567" in problem.message

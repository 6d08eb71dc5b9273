"""Licences, DOIs and persons of data sets."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize("name", ["CC-BY-4.0", "CC0-1.0", "ODbL-1.0", "GPL-3.0-or-later", "LicenseRef-Our-own.2"])
def test_licences(name, load_study) -> None:
    assert load_study(f"dataset: {{license: {name}}}").dataset.license == name


@pytest.mark.parametrize("before", ["", "https://doi.org/", "http://dx.doi.org/", "doi:"])
@pytest.mark.parametrize("doi", ["10.5281/zenodo.1234567", "10.1000.10/a(b)/c"])
def test_dois_are_stored_bare(before, doi, load_study) -> None:
    assert load_study(f"dataset: {{doi: '{before}{doi}'}}").dataset.doi == doi


@pytest.mark.parametrize(
    ("block", "key", "message"),
    [
        ("license: 'CC BY 4.0'", "license", "must be an SPDX identifier such as CC-BY-4.0"),
        ("license: 'LicenseRef-a b'", "license", "or LicenseRef-NAME"),
        *((f"doi: '{doi}'", "doi", "must be a DOI such as 10.5281/zenodo.1234567")
          for doi in ("notadoi", "10.5281", "10.52/x", "https://example.org/10.5281/x", "10.5281/a b")),
        ("creators: [{name: A, orcid: '12'}]", "creators[0].orcid", "must be an ORCID iD such as 0000-0002-1825-0097"),
    ],
)  # fmt: skip
def test_bad_values_are_located(block, key, message, refused) -> None:
    (problem,) = refused(f"dataset: {{{block}}}")
    assert (problem.file, problem.line, problem.key) == ("study.yaml", 8, f"dataset.{key}")
    assert message in problem.message or message in str(problem)

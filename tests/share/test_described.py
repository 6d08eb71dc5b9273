"""Texts of an archive: RO-Crate, citation, licence, README."""

import importlib.metadata
import zipfile
from typing import Any

import pytest
import yaml

import heliosweep
from heliosweep.errors import StudyError
from heliosweep.share.archive import pack_result

DATASET: dict[str, Any] = {
    "creators": [
        {"name": "Doe, Jane", "orcid": "0000-0002-1825-0097", "affiliation": "Institute of the Sun",
         "email": "jane@example.org"},
        {"name": "Solar Working Group"},
    ],
    "license": "CC-BY-SA-4.0", "doi": "10.5281/zenodo.1234567", "keywords": ["field"], "version": "1.1",
    "publisher": "Zenodo", "funding": [{"funder": "Sun Foundation", "award": "SF-12"}],
    "naming_authority": "sun.example.org",
}  # fmt: skip


@pytest.fixture(scope="module")
def folders(small, tmp_path_factory):
    """Unpacked archives of one study with and without people and licence."""
    unpacked = {}
    blocks = {"named": {"dataset": DATASET}, "nameless": {}}
    for name, more in blocks.items():
        place = tmp_path_factory.mktemp(name)
        heliosweep.run(small(**more), place / "result", report=False)
        with zipfile.ZipFile(pack_result(place / "result", draft=True)) as zipped:
            zipped.extractall(place / "elsewhere")
        (unpacked[name],) = (place / "elsewhere").iterdir()
    return unpacked


@pytest.fixture(params=["named", "nameless"])
def folder(request, folders):
    return folders[request.param]


def test_people_and_licence(folders):
    folder = folders["named"]
    cff = yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))
    assert (cff["type"], cff["license"], cff["doi"]) == ("dataset", "CC-BY-SA-4.0", "10.5281/zenodo.1234567")
    assert (cff["authors"][0]["family-names"], cff["authors"][0]["orcid"][-19:]) == ("Doe", "0000-0002-1825-0097")
    assert cff["authors"][1] == {"name": "Solar Working Group"}
    assert "https://spdx.org/licenses/CC-BY-SA-4.0.html" in (folder / "LICENSE").read_text("utf-8")
    assert "Doe, Jane; Solar Working Group (20" in (folder / "README.md").read_text("utf-8")
    with heliosweep.open_result(folder) as data:
        assert data.attrs["naming_authority"] == "sun.example.org"
        assert (data.attrs["product_version"], data.attrs["publisher_name"]) == ("1.1", "Zenodo")
        assert data.attrs["acknowledgement"] == "Sun Foundation, SF-12"


def test_the_environment_is_locked(folder):
    lines = (folder / "requirements.txt").read_text("utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert pinned["numpy"] == importlib.metadata.version("numpy")
    assert {"xarray", "dask", "numba", "netcdf4", "pyyaml"} <= set(pinned)  # also what packages need in turn
    assert "heliosweep" not in pinned


def test_without_people_and_licence_it_is_a_draft(folders, tmp_path, caplog):
    """Refused with each missing key and both remedies."""
    with pytest.raises(StudyError) as caught:
        pack_result(folders["nameless"], tmp_path / "a.zip")
    creators, licence = str(caught.value).splitlines()
    assert "needs 'dataset.creators'; add it to the study and run the study again" in creators
    assert "'dataset.license', or --license CC-BY-4.0" in licence
    assert licence.endswith("or use --draft")
    with pytest.raises(StudyError) as caught:
        pack_result(folders["nameless"], tmp_path / "a.zip", license="CC0-1.0")
    assert "license" not in str(caught.value).split(";")[0]
    assert not (tmp_path / "a.zip").exists()
    pack_result(folders["nameless"], tmp_path / "a.zip", draft=True)
    assert "dataset.license" in caplog.text
    assert "draft" in (folders["nameless"] / "LICENSE").read_text("utf-8")

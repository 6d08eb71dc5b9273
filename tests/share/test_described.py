"""What an archive says of itself: crate, citation, licence, README, notebook."""

from __future__ import annotations

import contextlib
import importlib
import importlib.metadata
import io
import json
import re
import subprocess
import sys
import zipfile
from typing import Any

import pytest
import yaml

import heliosweep
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.runs.verify import verify
from heliosweep.share.archive import pack_result, writing
from heliosweep.share.texts import Licence

DATASET: dict[str, Any] = {
    "creators": [
        {
            "name": "Doe, Jane",
            "orcid": "0000-0002-1825-0097",
            "affiliation": "Institute of the Sun",
            "email": "jane@example.org",
        },
        {"name": "Solar Working Group"},
    ],
    "license": "CC-BY-SA-4.0",
    "doi": "10.5281/zenodo.1234567",
    "keywords": ["field"],
    "version": "1.1",
    "publisher": "Zenodo",
    "contact": {"name": "Helpdesk", "email": "help@example.org"},
    "funding": [{"funder": "Sun Foundation", "award": "SF-12"}],
    "related": [
        {"identifier": "10.1155/2012/908364", "relation": "is_supplement_to"},
        {"identifier": "https://example.org/a"},
    ],
    "naming_authority": "sun.example.org",
}


@pytest.fixture(scope="module")
def folders(small, tmp_path_factory):
    """Unpacked archives of one study in three forms."""
    found = {}
    blocks = {"named": {"dataset": DATASET}, "nameless": {}, "zarr": {"output": {"format": "zarr"}}}
    for name, more in blocks.items():
        place = tmp_path_factory.mktemp(name)
        heliosweep.run(small(**more), place / "result", report=False)
        with zipfile.ZipFile(pack_result(place / "result", draft=True)) as zipped:
            zipped.extractall(place / "elsewhere")
        (found[name],) = (place / "elsewhere").iterdir()
    return found


@pytest.fixture(params=["named", "nameless", "zarr"])
def folder(request, folders):
    return folders[request.param]


def entities(folder: Any) -> dict[str, Any]:
    crate = json.loads((folder / "ro-crate-metadata.json").read_text("utf-8"))
    assert crate["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    found = {entity["@id"]: entity for entity in crate["@graph"]}
    assert len(found) == len(crate["@graph"])
    return found


def links(value: Any) -> set[str]:
    """Every entity that something refers to."""
    if isinstance(value, dict):
        return {value["@id"]} if set(value) == {"@id"} else set().union(*map(links, value.values()))
    return set().union(*map(links, value)) if isinstance(value, list) else set()


def test_crate(folder):
    """What RO-Crate 1.1 demands, and that all that it refers to is there."""
    found = entities(folder)
    descriptor, root = found["ro-crate-metadata.json"], found["./"]
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert descriptor["about"] == {"@id": "./"}
    assert root["@type"] == "Dataset"
    assert all(root[key] for key in ("name", "description", "datePublished", "license", "author", "publisher"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", root["datePublished"])
    outside = {"https://w3id.org/ro/crate/1.1", "http://schema.org/CompletedActionStatus"}
    assert set().union(*map(links, found.values())) - outside <= set(found)
    files = {name for name, entity in found.items() if entity["@type"] == "File"}
    parts = {part["@id"] for part in root["hasPart"]}
    assert files <= parts
    for name in files:
        path = folder / name
        assert path.is_file()
        if name != "SHA256SUMS":
            assert found[name]["contentSize"] == str(path.stat().st_size)
            assert len(found[name]["sha256"]) == 64
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert {name for name in there if not name.startswith("result.zarr/")} == files | {"ro-crate-metadata.json"}
    run = found["#run"]
    assert run["result"]["@id"] in parts
    assert run["instrument"] == {"@id": "#heliosweep"}
    assert links(run["agent"]) <= set(found)
    # Process Run Crate 0.5: the crate says so, the profile is told, the program has a version, the inputs are objects.
    assert root["conformsTo"]["@id"] == "https://w3id.org/ro/wfrun/process/0.5"
    assert found["https://w3id.org/ro/wfrun/process/0.5"]["version"] == "0.5"
    assert found["#heliosweep"]["softwareVersion"]
    assert {"study.yaml", "requirements.txt"} <= links(run["object"])
    for entity in found.values():
        # A list of one is not recommended.
        assert all(len(value) > 1 for value in entity.values() if isinstance(value, list))


def test_people_and_licence(folders):
    folder = folders["named"]
    found = entities(folder)
    people = [link["@id"] for link in found["./"]["creator"]]
    assert [found[one]["name"] for one in people] == ["Doe, Jane", "Solar Working Group"]
    assert people[0] == "https://orcid.org/0000-0002-1825-0097"
    assert found[found[people[0]]["affiliation"]["@id"]]["name"] == "Institute of the Sun"
    assert found["./"]["license"] == {"@id": "https://creativecommons.org/licenses/by-sa/4.0/"}
    assert found["./"]["identifier"] == "https://doi.org/10.5281/zenodo.1234567"

    cff = yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))
    assert cff["type"] == "dataset"
    assert cff["license"] == "CC-BY-SA-4.0"
    assert cff["doi"] == "10.5281/zenodo.1234567"
    assert cff["authors"][0]["family-names"] == "Doe"
    assert cff["authors"][1] == {"name": "Solar Working Group"}
    notice = (folder / "LICENSE").read_text("utf-8")
    assert "https://creativecommons.org/licenses/by-sa/4.0/legalcode" in notice
    assert "Doe, Jane; Solar Working Group (20" in (folder / "README.md").read_text("utf-8")


def test_repositories(folders):
    """What Zenodo and DataCite are told: who, whom to ask, who paid, what it goes with, and where."""
    folder = folders["named"]
    zenodo = json.loads((folder / ".zenodo.json").read_text("utf-8"))
    assert zenodo["upload_type"] == "dataset"
    assert zenodo["license"] == "cc-by-sa-4.0"
    assert zenodo["creators"][0] == {
        "name": "Doe, Jane", "affiliation": "Institute of the Sun", "orcid": "0000-0002-1825-0097",
    }  # fmt: skip
    assert zenodo["contributors"] == [{"name": "Helpdesk", "type": "ContactPerson"}]
    assert zenodo["related_identifiers"] == [
        {"identifier": "10.1155/2012/908364", "relation": "isSupplementTo"},
        {"identifier": "https://example.org/a", "relation": "references"},
    ]
    assert zenodo["notes"] == "Funding: Sun Foundation, SF-12"
    cite = json.loads((folder / "datacite.json").read_text("utf-8"))
    # What the schema demands of every data set.
    assert {"creators", "titles", "publisher", "publicationYear", "types", "schemaVersion"} <= set(cite)
    assert cite["identifiers"] == [{"identifier": "10.5281/zenodo.1234567", "identifierType": "DOI"}]
    assert cite["creators"][0]["nameIdentifiers"][0]["nameIdentifier"] == "https://orcid.org/0000-0002-1825-0097"
    assert cite["creators"][1] == {"name": "Solar Working Group", "nameType": "Organizational"}
    assert (cite["publisher"], cite["version"]) == ({"name": "Zenodo"}, "1.1")
    assert cite["fundingReferences"] == [{"funderName": "Sun Foundation", "awardNumber": "SF-12"}]
    assert [one["relationType"] for one in cite["relatedIdentifiers"]] == ["IsSupplementTo", "References"]
    assert [one["relatedIdentifierType"] for one in cite["relatedIdentifiers"]] == ["DOI", "URL"]
    found = entities(folder)
    assert found["#contact"]["email"] == "help@example.org"
    assert found["https://doi.org/10.1155/2012/908364"]["description"] == "Relation: is_supplement_to"
    with heliosweep.open_result(folder) as data:
        assert data.attrs["naming_authority"] == "sun.example.org"
        assert (data.attrs["product_version"], data.attrs["publisher_name"]) == ("1.1", "Zenodo")
        assert data.attrs["acknowledgement"] == "Sun Foundation, SF-12"
    with heliosweep.open_result(folders["nameless"]) as data:
        assert "naming_authority" not in data.attrs


def test_the_environment_is_locked(folder):
    lines = (folder / "requirements.txt").read_text("utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert pinned["numpy"] == importlib.metadata.version("numpy")
    assert {"xarray", "dask", "numba", "netcdf4", "pyyaml"} <= set(pinned)  # also what packages need in turn
    assert "heliosweep" not in pinned


def test_without_people_and_licence_it_is_a_draft(folders, tmp_path):
    """Refused with what is missing, how to add it, and how to pack it nevertheless."""
    with pytest.raises(StudyError) as caught:
        pack_result(folders["nameless"], tmp_path / "a.zip")
    creators, licence = str(caught.value).splitlines()
    assert "needs 'dataset.creators': nobody is named who made it; add it to the study and run it again" in creators
    assert "'dataset.license', or --license CC-BY-4.0" in licence
    assert licence.endswith("or pack a --draft")
    with pytest.raises(StudyError) as caught:
        pack_result(folders["nameless"], tmp_path / "a.zip", license="CC0-1.0")
    assert "license" not in str(caught.value).split(";")[0]
    assert not (tmp_path / "a.zip").exists()


def test_a_collection(folders, small, tmp_path):
    with pytest.raises(StudyError, match="name the archive of several results"):
        pack_result([folders["named"], folders["named"]], draft=True)
    with pytest.raises(StudyError, match="same study"):
        pack_result([folders["named"], folders["nameless"]], tmp_path / "a.zip", draft=True)
    other = heliosweep.run(small(site={"latitude": 11}), tmp_path / "other", report=False).folder
    both = [folders["named"], other]
    archive = pack_result(both, tmp_path / "both.zip", draft=True)
    assert pack_result(both[::-1], tmp_path / "turned.zip", draft=True).read_bytes() == archive.read_bytes()
    with zipfile.ZipFile(archive) as zipped:
        zipped.extractall(tmp_path / "both")
    (top,) = (tmp_path / "both").iterdir()
    crate = json.loads((top / "ro-crate-metadata.json").read_text("utf-8"))
    parts = [link["@id"] for link in crate["@graph"][1]["hasPart"]]
    assert len(parts) == 2
    for part in parts:
        assert verify(top / part).ok
        assert entities(top / part)["./"]["name"]
        assert f"]({part}README.md)" in (top / "README.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"creators": [{"name": "A", "orcid": "0000-0002-1825-0098"}]}, "must be an ORCID iD"),
        ({"naming_authority": "heliosweep"}, "must be a domain"),
        ({"related": [{"identifier": "a book"}]}, "must be a DOI, as 10.5281/zenodo.1234567, or an address"),
        ({"related": [{"identifier": "10.1000/1", "relation": "likes"}]}, "related"),
    ],
)
def test_bad_words_about_a_data_set(small, change, said):
    with pytest.raises(StudyError, match=said):
        small(dataset=change)


def test_nobody_named_is_said(folders, tmp_path, caplog):
    folder = folders["nameless"]
    pack_result(folder, tmp_path / "again.zip", draft=True)
    assert "dataset.license" in caplog.text
    assert (
        "has named no licence" in (folder / "LICENSE").read_text("utf-8") or "draft" in (folder / "LICENSE").read_text()
    )
    assert "dataset.creators" in caplog.text
    found = entities(folder)
    assert found[found["./"]["author"]["@id"]]["@type"] == "Organization"
    cff = yaml.safe_load((folder / "CITATION.cff").read_text("utf-8"))
    assert {"cff-version", "message", "title", "authors", "date-released"} <= set(cff)
    assert "doi" not in cff


def test_readme(folder):
    text = (folder / "README.md").read_text("utf-8")
    with heliosweep.open_result(folder) as data:
        for name, variable in (*data.data_vars.items(), *data.coords.items()):
            row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
            assert variable.attrs["long_name"] in row
            assert row.count(" | ") == 3
    assert "sha256sum -c SHA256SUMS" in text
    assert "heliosweep run study.yaml --output again" in text


@pytest.mark.parametrize("name", ["nameless", "zarr"])
def test_notebook_opens_the_data(folders, name):
    folder = folders[name]
    notebook = json.loads((folder / "open.ipynb").read_text("utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
    with contextlib.suppress(ImportError):
        nbformat: Any = importlib.import_module("nbformat")
        nbformat.validate(nbformat.reads(json.dumps(notebook), as_version=4))
    code = "\n".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code")
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "optical_efficiency [1]" in done.stdout


@pytest.mark.parametrize(
    ("text", "spdx", "url"),
    [
        ("CC-BY-4.0", "CC-BY-4.0", "https://creativecommons.org/licenses/by/4.0/"),
        ("MIT", "MIT", "https://spdx.org/licenses/MIT.html"),
        ("LicenseRef-Ours", None, None),
        ("LicenseRef-Draft", None, None),
    ],
)
def test_licences(text, spdx, url):
    licence = Licence(text)
    assert (licence.spdx, licence.url) == (spdx, url)
    assert (spdx or text) in licence.notice("Title", "People")


def test_large_files_are_streamed_and_fit(tmp_path):
    """More than memory should hold at once: what is copied is never more than a piece."""

    class Source(io.RawIOBase):
        left = 5 * 2**20
        most = 0

        def read(self, size: int = -1) -> bytes:
            Source.most = max(self.most, size)
            take = min(size, self.left)
            self.left -= take
            return bytes(take)

    with writing(tmp_path / "a.zip", "top") as archive:
        archive.add("large", Source(), 2**32)  # type: ignore[arg-type]
    assert 0 < Source.most <= 2**20
    with zipfile.ZipFile(tmp_path / "a.zip") as zipped:
        assert zipped.testzip() is None
        assert zipped.getinfo("top/large").file_size == 5 * 2**20


def test_nothing_is_left_of_an_archive_that_failed(tmp_path):
    with pytest.raises(HeliosweepError, match=r"a\.zip: cannot be written: gone"), writing(tmp_path / "a.zip", "top"):
        raise OSError("gone")
    assert list(tmp_path.iterdir()) == []

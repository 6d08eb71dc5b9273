"""Texts of an archive: README, licence, citation and notebook for readers, RO-Crate 1.1 for machines.

The crate is written by hand: the package `rocrate` dates each one by the clock, so that no two have the same bytes, and
brings requests, arcp, python-dateutil and click.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import PurePath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from heliosweep.config.dataset import OWN, Creator, Dataset
from heliosweep.config.study import Study
from heliosweep.errors import printable

if TYPE_CHECKING:
    import xarray as xr

#: Stands for the creators of a study that names none.
NOBODY = "The authors of this data set"
#: Stands for the licence of a draft that has none.
DRAFT = "LicenseRef-Draft"
#: Profile of crates that tell a run (Leo et al. 2024, doi:10.1371/journal.pone.0309210).
PROCESS = "https://w3id.org/ro/wfrun/process/0.5"
#: Name of the description in its archive.
METADATA = "ro-crate-metadata.json"

_CC = "https://creativecommons.org"
_ODC = "https://opendatacommons.org/licenses"
_KNOWN = {
    "CC-BY-4.0": ("Creative Commons Attribution 4.0 International", f"{_CC}/licenses/by/4.0/"),
    "CC-BY-SA-4.0": ("Creative Commons Attribution-ShareAlike 4.0 International", f"{_CC}/licenses/by-sa/4.0/"),
    "CC-BY-NC-4.0": ("Creative Commons Attribution-NonCommercial 4.0 International", f"{_CC}/licenses/by-nc/4.0/"),
    "CC0-1.0": ("Creative Commons CC0 1.0 Universal (public domain dedication)", f"{_CC}/publicdomain/zero/1.0/"),
    "ODbL-1.0": ("Open Database License 1.0", f"{_ODC}/odbl/1-0/"),
    "ODC-By-1.0": ("Open Data Commons Attribution License 1.0", f"{_ODC}/by/1-0/"),
    DRAFT: ("none yet: a draft", None),
    "PDDL-1.0": ("Open Data Commons Public Domain Dedication 1.0", f"{_ODC}/pddl/1-0/"),
}
_MEANS = {
    "CC-BY-4.0": (
        "You may share and adapt the data for any purpose, also commercially, if you give appropriate credit, link to "
        "the licence and say what you changed."
    ),
    DRAFT: "This is a draft. Its creators have named no licence: it must not be used or passed on without asking them.",
    "CC0-1.0": "To the extent possible under law, the creators have waived all rights to the data.",
}

#: The second one names what schema.org has learned since.
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_TYPES = {
    ".nc": "application/x-netcdf",
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".md": "text/markdown",
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
    ".cff": "application/yaml",
    ".ipynb": "application/x-ipynb+json",
    ".csv": "text/csv",
    ".png": "image/png",
    ".tif": "image/tiff",
    ".tiff": "image/tiff",
    ".fits": "application/fits",
    ".npy": "application/octet-stream",
}
_NAMES = {
    "study.yaml": "The study: every parameter of the computation",
    "manifest.json": "Versions and digests of the result and its parts",
    "README.md": "What this is, how to open, cite, verify and rerun it",
    "LICENSE": "What is allowed",
    "CITATION.cff": "How to cite",
    "open.ipynb": "A notebook that opens the data",
    "SHA256SUMS": "Checksums of all files",
    ".zenodo.json": "Description for Zenodo",
    "datacite.json": "Description by DataCite's schema",
    "requirements.txt": "Versions of all packages that computed it",
    "report.html": "The page of the result: what was asked, what came out, figures",
}
#: Code of the notebook.
_MEANINGS = """\
for name, values in data.data_vars.items():
    units = values.attrs.get("units", "")
    print(f"{name} [{units}] {tuple(values.dims)}: {values.attrs['long_name']}")"""


@dataclass(frozen=True)
class Licence:
    """The licence of a data set: an SPDX identifier, or ``LicenseRef-NAME``."""

    text: str

    @property
    def spdx(self) -> str | None:
        """SPDX identifier; None for a licence of one's own."""
        return None if self.text.startswith(OWN) else self.text

    @property
    def name(self) -> str:
        """Name, for readers."""
        return _KNOWN.get(self.text, (self.text,))[0]

    @property
    def url(self) -> str | None:
        """Address of its full text; None for a licence of one's own."""
        return _KNOWN.get(self.text, ("", self.spdx and f"https://spdx.org/licenses/{self.spdx}.html"))[1]

    def notice(self, title: str, people: str) -> str:
        """The file that goes with the data."""
        said = [_MEANS.get(self.text, "The creators name the terms.")]
        if self.url:
            legal = f"{self.url}legalcode" if self.text.startswith("CC") and self.text in _KNOWN else self.url
            said = [
                f"This data set is licensed under: {self.name} ({self.spdx}).",
                *filter(None, [_MEANS.get(self.text)]),
            ]
            said.append(f"Full text of the licence: {legal}")
        return "\n\n".join([printable(f"{title}\n{people}"), *said, f"SPDX-License-Identifier: {self.text}\n"])


@dataclass(frozen=True)
class Described:
    """A data set as its texts tell it.

    Parameters
    ----------
    study : Study
        The study.
    manifest : mapping
        That of its result, cleaned.
    attributes : mapping
        Global attributes of the result.
    sizes : mapping of str to int
        Dimensions.
    coordinates, data : mapping of str to xarray.Variable
        Variables of the result.
    inputs : mapping of str to str
        Name of each input in the archive: what it is to the study, its key.
    licence : Licence
        Of the data.
    """

    study: Study
    manifest: Mapping[str, Any]
    attributes: Mapping[str, Any]
    sizes: Mapping[str, int]
    coordinates: Mapping[str, xr.Variable]
    data: Mapping[str, xr.Variable]
    inputs: Mapping[str, str]
    licence: Licence

    @cached_property
    def told(self) -> dict[str, Any]:
        """What the texts say, by the names that they have for it."""
        attributes, manifest, dataset = self.attributes, self.manifest, self.study.dataset
        result = str(manifest["result"]["file"])
        creators = dataset.creators if dataset else ()
        return {
            **{one.name: getattr(self, one.name) for one in fields(self)},
            "title": str(attributes["title"]),
            "result": result,
            "is_zarr": result.endswith(".zarr"),
            "opening": "xr.open_zarr" if result.endswith(".zarr") else "xr.open_dataset",
            "study_id": str(manifest["study_id"]),
            "finished": str(manifest["finished"]),  # ISO 8601
            "software": str(attributes["source"]).removeprefix("heliosweep ").partition(",")[0],
            "commit": manifest.get("environment", {}).get("commit"),
            "creators": creators,
            "people": "; ".join(creator.name for creator in creators) or NOBODY,
            "doi": dataset.doi if dataset else None,  # without the address of its resolver
            "version": dataset.version if dataset else None,
            "references": list(filter(None, str(attributes.get("references", "")).split("; "))),
        }


def readme(described: Described) -> str:
    """README.md: what this is, how to open, cite, verify and rerun it."""
    options: dict[str, Any] = {"undefined": StrictUndefined, "trim_blocks": True, "keep_trailing_newline": True}
    texts = Environment(loader=PackageLoader("heliosweep.share"), **options)
    texts.filters |= {"cell": _cell, "prose": prose, "units": _units}
    return texts.get_template("README.md").render(described.told)


def prose(text: object) -> str:
    """Text on one line of Markdown, where nothing in it is markup, a formula or HTML."""
    return re.sub(r"([\\`*\[\]<>|$~#&])", r"\\\1", printable(" ".join(str(text).split())))


def _cell(text: str) -> str:
    """Text in a table of Markdown."""
    return re.sub(r"([|\\])", r"\\\1", " ".join(text.split()))


def _units(variable: xr.Variable) -> str:
    """Units as readers of a table know them; times are decoded when the result is opened."""
    units = str(variable.attrs.get("units", ""))
    return "date" if " since " in units else units


def licence(described: Described) -> str:
    """LICENSE."""
    return described.licence.notice(described.told["title"], described.told["people"])


def citation(described: Described) -> str:
    """CITATION.cff of the data set."""
    told = described.told
    study = {"type": "other", "value": told["study_id"], "description": "identifier of the study"}
    content = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it as below.",
        "type": "dataset",
        "title": told["title"],
        "abstract": str(described.attributes["summary"]),
        "authors": [_author(creator) for creator in told["creators"]] or [{"name": NOBODY}],
        "date-released": told["finished"][:10],
        "keywords": str(described.attributes["keywords"]).split(", "),
        "doi": told["doi"],
        "version": told["version"],
        "identifiers": None if told["doi"] else [study],
        "license": described.licence.spdx,
        "references": [
            {
                "type": "software",
                "title": "heliosweep",
                "version": told["software"],
                "authors": [{"name": "The heliosweep developers"}],
            }
        ],
    }
    return yaml.safe_dump(known(content), sort_keys=False, allow_unicode=True, width=120)


def _author(creator: Creator) -> dict[str, Any]:
    family, comma, given = creator.name.partition(", ")
    return known(
        {
            **({"family-names": family, "given-names": given} if comma else {"name": creator.name}),
            "affiliation": creator.affiliation if comma else None,
            "email": creator.email,
            "orcid": orcid(creator),
        }
    )


def orcid(creator: Creator) -> str | None:
    """Address of a creator's ORCID iD."""
    return f"https://orcid.org/{creator.orcid}" if creator.orcid else None


def known(entity: Mapping[str, Any]) -> dict[str, Any]:
    """The same without what is not known."""
    return {key: value for key, value in entity.items() if value}


def notebook(described: Described) -> str:
    """open.ipynb, format 4.5, without outputs."""
    told, (first, variable) = described.told, next(iter(described.data.items()))
    look = f'data["{first}"]'
    if variable.dims:
        look += f'.isel({{dim: slice(0, 5) for dim in data["{first}"].dims}}).to_series().head(20)'
    needs = "zarr" if told["is_zarr"] else "netCDF4"
    texts = [
        f"# {prose(told['title'])}\n\n{prose(described.attributes['summary'])}\n\nNeeds xarray and {needs}.",
        f'import xarray as xr\n\ndata = {told["opening"]}("{told["result"]}")\ndata',
        "What each variable means:",
        _MEANINGS,
        f"The values of `{first}`, as a table:",
        look,
    ]
    ran: list[dict[str, Any]] = [
        {"cell_type": "markdown"},
        {"cell_type": "code", "execution_count": None, "outputs": []},
    ]
    cells = [
        {**ran[number % 2], "id": f"cell-{number}", "metadata": {}, "source": text.splitlines(keepends=True)}
        for number, text in enumerate(texts)
    ]
    metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    content = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(content, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def crate(described: Described, digests: Mapping[str, str], sizes: Mapping[str, int]) -> str:
    """ro-crate-metadata.json.

    Parameters
    ----------
    described : Described
        The data set.
    digests, sizes : mapping
        SHA-256 and size of each file in the archive, by name. [bytes]
    """
    told, licence, summary = described.told, described.licence, str(described.attributes["summary"])
    doi, result, commit, released = told["doi"], told["result"], told["commit"], told["finished"][:10]
    stored = f"{result}/" if told["is_zarr"] else result
    names = [name for name in digests if not name.startswith(f"{result}/")] + ["SHA256SUMS"]
    names_of = {**_NAMES, **{name: f"Input of the study: {key}" for name, key in described.inputs.items()}}
    terms = licence.url or "#licence"
    people, organizations = _people(told["creators"])
    funders, related, contact = _others(described.study.dataset or Dataset())
    files = [
        {
            "@id": _id(name),
            "@type": "File",
            "name": "The data" if name == result else names_of.get(name, name),
            "description": summary if name == result else None,
            "encodingFormat": _TYPES.get(PurePath(name).suffix.lower(), "text/plain"),
            "contentSize": str(sizes[name]) if name in sizes else None,
            "sha256": digests.get(name),
        }
        for name in names
    ]
    zarr = {
        "@id": stored,
        "@type": "Dataset",
        "name": "The data, Zarr version 2",
        "description": summary,
        "encodingFormat": "application/vnd+zarr",
    }
    graph: list[dict[str, Any]] = [
        {
            "@id": METADATA,
            "@type": "CreativeWork",
            "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
            "about": {"@id": "./"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": told["title"],
            "description": summary,
            "datePublished": released,
            "keywords": str(described.attributes["keywords"]),
            "identifier": f"https://doi.org/{doi}" if doi else told["study_id"],
            "version": told["version"],
            "conformsTo": {"@id": PROCESS},
            "funder": _linked(one["@id"] for one in funders),
            "contactPoint": contact and {"@id": "#contact"},
            "citation": _linked(one["@id"] for one in related),
            "license": {"@id": terms},
            "creator": _linked(person["@id"] for person in people),
            "author": _linked(person["@id"] for person in people),
            "publisher": {"@id": (organizations or people)[0]["@id"]},
            "hasPart": _linked(map(_id, [*([stored] if told["is_zarr"] else []), *names])),
            "mentions": {"@id": "#run"},
            "variableMeasured": ", ".join(described.data),
        },
        *([zarr] if told["is_zarr"] else []),
        *files,
        {
            "@id": "#run",
            "@type": "CreateAction",
            "description": "Computes every point of the study, from the versions that requirements.txt lists",
            "actionStatus": {"@id": "http://schema.org/CompletedActionStatus"},
            "agent": _linked(person["@id"] for person in people),
            "name": f"heliosweep run of study {told['study_id']}",
            "endTime": told["finished"],
            "instrument": {"@id": "#heliosweep"},
            "object": _linked(map(_id, ("study.yaml", "requirements.txt", *described.inputs))),
            "result": {"@id": _id(stored)},
        },
        {
            "@id": "#heliosweep",
            "@type": "SoftwareApplication",
            "name": "heliosweep",
            "softwareVersion": told["software"],
            "description": "Batch studies of solar-concentrator tracking and optics",
            "identifier": commit and f"commit {commit}",
        },
        {
            "@id": terms,
            "@type": "CreativeWork",
            "name": licence.name,
            "identifier": licence.spdx,
            "description": licence.notice(told["title"], told["people"]),
        },
        {"@id": PROCESS, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"},
        *people,
        *organizations,
        *funders,
        *related,
        *([contact] if contact else []),
    ]
    content = {"@context": _CONTEXT, "@graph": [known(entity) for entity in graph]}
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _linked(ids: Iterable[str]) -> Any:
    """References to entities; to a single one without a list."""
    links = [{"@id": each} for each in ids]
    return links[0] if len(links) == 1 else links


def _id(name: str) -> str:
    """Address of a file in the crate."""
    return quote(name, safe="/-_.~")


def _people(creators: Iterable[Creator]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Creators, and the organizations that they belong to."""
    names = dict.fromkeys(creator.affiliation for creator in creators if creator.affiliation)
    ids = {name: f"#organization-{number}" for number, name in enumerate(names, 1)}
    people = [
        {
            "@id": orcid(creator) or f"#creator-{number}",
            "@type": "Person",
            "name": creator.name,
            "affiliation": creator.affiliation and {"@id": ids[creator.affiliation]},
            "email": creator.email,
        }
        for number, creator in enumerate(creators, 1)
    ]
    organizations = [{"@id": place, "@type": "Organization", "name": name} for name, place in ids.items()]
    return people or [{"@id": "#authors", "@type": "Organization", "name": NOBODY}], organizations


def contact_of(dataset: Dataset) -> Creator | None:
    """Whom to ask: who is named, or else the first creator with an address."""
    return dataset.contact or next((creator for creator in dataset.creators if creator.email), None)


def _others(dataset: Dataset) -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, Any] | None]:
    """Funders, related works, and whom to ask."""
    funders = [
        {"@id": f"#funder-{number}", "@type": "Organization", "name": one.funder, "description": one.award}
        for number, one in enumerate(dataset.funding, 1)
    ]
    addresses = {one.identifier if "://" in one.identifier else f"https://doi.org/{one.identifier}": one.relation
                 for one in dataset.related}  # fmt: skip
    related = [
        {"@id": address, "@type": "CreativeWork", "name": address, "description": f"Relation: {relation}"}
        for address, relation in addresses.items()
    ]
    one = contact_of(dataset)
    contact = {"@id": "#contact", "@type": "ContactPoint", "name": one.name, "email": one.email} if one else None
    return funders, related, contact

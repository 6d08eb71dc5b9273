"""RO-Crate 1.1 of an archive, for machines: what its files are, how they were computed, who made them.

It is written by hand: the package `rocrate` dates each one by the clock, so that no two have the same bytes, and brings
requests, arcp, python-dateutil and click.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Any
from urllib.parse import quote

from heliosweep.config.dataset import Creator, Dataset
from heliosweep.share.texts import NOBODY, Described, contact_of, known, orcid

#: Profile of crates that tell a run (Leo et al. 2024, doi:10.1371/journal.pone.0309210).
PROCESS = "https://w3id.org/ro/wfrun/process/0.5"
#: Name of the description in its archive.
METADATA = "ro-crate-metadata.json"

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
    return _written(
        {
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
    )


def collection_crate(members: Mapping[str, Described]) -> str:
    """ro-crate-metadata.json over the results, each of which has its own below."""
    parts = [
        {
            "@id": f"{name}/",
            "@type": "Dataset",
            "name": one.told["title"],
            "description": str(one.attributes["summary"]),
            "license": one.licence.url or one.licence.text,
            "creator": one.told["people"],
            "datePublished": one.told["finished"][:10],
            "conformsTo": {"@id": "https://w3id.org/ro/crate"},
            "subjectOf": {"@id": f"{name}/{METADATA}"},
        }
        for name, one in members.items()
    ]
    described = [
        {"@id": f"{name}/{METADATA}", "@type": "CreativeWork", "encodingFormat": "application/ld+json"}
        for name in members
    ]
    licences = sorted({one.licence.url or one.licence.text for one in members.values()})
    return _written(
        {
            "@type": "Dataset",
            "name": f"{len(members)} results of heliosweep",
            "description": "; ".join(one.told["title"] for one in members.values()),
            "datePublished": max(one.told["finished"][:10] for one in members.values()),
            "license": ", ".join(licences),
            "hasPart": _linked(part["@id"] for part in parts),
        },
        *parts,
        *described,
    )


def _written(root: Mapping[str, Any], *others: Mapping[str, Any]) -> str:
    """The file: what the archive is, and all that it names."""
    head = {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }
    content = {"@context": _CONTEXT, "@graph": [known(one) for one in (head, {"@id": "./", **root}, *others)]}
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

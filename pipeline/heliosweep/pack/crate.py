"""RO-Crate 1.1: an archive described for machines."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import quote

from heliosweep.config.dataset import Creator
from heliosweep.pack.described import NOBODY, Described

#: Name of the description in its archive.
METADATA = "ro-crate-metadata.json"

#: The second one names what schema.org has learned since.
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_TYPES = {
    ".nc": "application/x-netcdf",
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".md": "text/markdown",
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
    stored = f"{described.result}/" if described.result.endswith(".zarr") else described.result
    names = [name for name in digests if not name.startswith(f"{described.result}/")]
    parts = [*([stored] if stored.endswith("/") else []), *names, "SHA256SUMS"]
    people, organizations = _people(described)
    graph = [
        {
            "@id": METADATA,
            "@type": "CreativeWork",
            "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
            "about": {"@id": "./"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": described.title,
            "description": described.summary,
            "datePublished": described.finished[:10],
            "keywords": ", ".join(described.keywords),
            "identifier": f"https://doi.org/{described.doi}" if described.doi else described.study_id,
            "license": {"@id": _licence_id(described)},
            "creator": _linked(person["@id"] for person in people),
            "author": _linked(person["@id"] for person in people),
            "publisher": {"@id": (organizations or people)[0]["@id"]},
            "hasPart": _linked(map(_id, parts)),
            "mentions": {"@id": "#run"},
            "variableMeasured": ", ".join(column.name for column in described.data),
        },
        *([_zarr(described, stored)] if stored.endswith("/") else []),
        *(_file(described, name, digests.get(name), sizes.get(name)) for name in (*names, "SHA256SUMS")),
        {
            "@id": "#run",
            "@type": "CreateAction",
            "name": f"heliosweep run of study {described.study_id}",
            "endTime": described.finished,
            "instrument": {"@id": "#heliosweep"},
            "object": _linked(map(_id, ("study.yaml", *described.inputs))),
            "result": {"@id": _id(stored)},
        },
        _software(described),
        _licence(described),
        *people,
        *organizations,
    ]
    return json.dumps({"@context": _CONTEXT, "@graph": graph}, indent=2, ensure_ascii=False) + "\n"


def _linked(ids: Iterable[str]) -> Any:
    """References to entities; to a single one without a list."""
    links = [{"@id": each} for each in ids]
    return links[0] if len(links) == 1 else links


def _id(name: str) -> str:
    """Address of a file in the crate."""
    return quote(name, safe="/-_.~")


def _file(described: Described, name: str, digest: str | None, size: int | None) -> dict[str, Any]:
    suffix = f".{name.rpartition('.')[2].lower()}" if "." in name else ""
    entity: dict[str, Any] = {"@id": _id(name), "@type": "File"}
    if name == described.result:
        entity |= {"name": "The data", "description": described.summary}
    elif name in described.inputs:
        entity["name"] = f"Input of the study: {described.inputs[name]}"
    else:
        entity["name"] = _NAMES.get(name, name)
    entity["encodingFormat"] = _TYPES.get(suffix, "text/plain")
    if digest is not None:
        entity |= {"contentSize": str(size), "sha256": digest}
    return entity


def _zarr(described: Described, stored: str) -> dict[str, Any]:
    return {
        "@id": stored,
        "@type": "Dataset",
        "name": "The data, Zarr version 2",
        "description": described.summary,
        "encodingFormat": "application/vnd+zarr",
    }


def _software(described: Described) -> dict[str, Any]:
    entity: dict[str, Any] = {
        "@id": "#heliosweep",
        "@type": "SoftwareApplication",
        "name": "heliosweep",
        "version": described.software,
        "description": "Batch studies of solar-concentrator tracking and optics",
    }
    if commit := described.manifest.get("environment", {}).get("commit"):
        entity["identifier"] = f"commit {commit}"
    return entity


def _licence_id(described: Described) -> str:
    return described.licence.url or "LICENSE"


def _licence(described: Described) -> dict[str, Any]:
    entity = {"@id": _licence_id(described), "@type": "CreativeWork", "name": described.licence.name}
    if described.licence.spdx:
        entity["identifier"] = described.licence.spdx
    return entity | {"description": described.licence.notice(described.title, described.people)}


def _people(described: Described) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Creators, and the organizations that they belong to."""
    if not described.creators:
        return [{"@id": "#authors", "@type": "Organization", "name": NOBODY}], []
    names = dict.fromkeys(creator.affiliation for creator in described.creators if creator.affiliation)
    ids = {name: f"#organization-{number}" for number, name in enumerate(names, 1)}
    people = [_person(creator, number, ids) for number, creator in enumerate(described.creators, 1)]
    return people, [{"@id": place, "@type": "Organization", "name": name} for name, place in ids.items()]


def _person(creator: Creator, number: int, organizations: Mapping[str, str]) -> dict[str, Any]:
    place = f"https://orcid.org/{creator.orcid}" if creator.orcid else f"#creator-{number}"
    person: dict[str, Any] = {"@id": place, "@type": "Person", "name": creator.name}
    if creator.affiliation:
        person["affiliation"] = {"@id": organizations[creator.affiliation]}
    if creator.email:
        person["email"] = creator.email
    return person

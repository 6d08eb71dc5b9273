"""Descriptions of a data set for repositories: ``.zenodo.json`` and DataCite's ``datacite.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from heliosweep.config.dataset import Creator, Dataset
from heliosweep.share.texts import NOBODY, Described, Licence, contact_of, known, orcid

#: What stands for a publisher that nobody named, as DataCite has it.
UNAVAILABLE = ":unav"


def zenodo(described: Described) -> str:
    """Metadata that Zenodo takes for a deposit (https://developers.zenodo.org, version 1 of its metadata)."""
    told, dataset = described.told, described.study.dataset or Dataset()
    contact = contact_of(dataset)
    content = {
        "upload_type": "dataset",
        "title": told["title"],
        "publication_date": told["finished"][:10],
        "description": str(described.attributes["summary"]),
        "creators": [_depositor(creator) for creator in dataset.creators] or [{"name": NOBODY}],
        "contributors": [{**_depositor(contact), "type": "ContactPerson"}] if contact else None,
        "access_right": "open",
        "license": described.licence.spdx and described.licence.spdx.lower(),
        "doi": dataset.doi,
        "version": dataset.version,
        "keywords": str(described.attributes["keywords"]).split(", "),
        "related_identifiers": [
            {"identifier": one.identifier, "relation": _camel(one.relation, 0)} for one in dataset.related
        ],
        "references": told["references"],
        "notes": "; ".join(funded(dataset)) and f"Funding: {'; '.join(funded(dataset))}",
    }
    return _written(content)


def datacite(described: Described) -> str:
    """Metadata by DataCite's schema, version 4.5, as its JSON has it."""
    told, dataset = described.told, described.study.dataset or Dataset()
    contact, attributes = contact_of(dataset), described.attributes
    box = {
        name: attributes.get(f"geospatial_{axis}_{end}")
        for name, axis, end in (
            ("westBoundLongitude", "lon", "min"),
            ("eastBoundLongitude", "lon", "max"),
            ("southBoundLatitude", "lat", "min"),
            ("northBoundLatitude", "lat", "max"),
        )
    }
    corners = {name: float(value) for name, value in box.items() if value is not None}
    ends = [attributes.get(f"time_coverage_{end}") for end in ("start", "end")]
    covered = "/".join(str(end) for end in ends if end)
    content = {
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Dataset"},
        "identifiers": [{"identifier": dataset.doi, "identifierType": "DOI"}] if dataset.doi else None,
        "alternateIdentifiers": [
            {"alternateIdentifier": told["study_id"], "alternateIdentifierType": "heliosweep study"}
        ],
        "titles": [{"title": told["title"]}],
        "creators": [_person(creator) for creator in dataset.creators] or [{"name": NOBODY}],
        "contributors": [{**_person(contact), "contributorType": "ContactPerson"}] if contact else None,
        "publisher": {"name": dataset.publisher or UNAVAILABLE},
        "publicationYear": told["finished"][:4],
        "dates": [
            {"date": told["finished"][:10], "dateType": "Created"},
            *([{"date": covered, "dateType": "Coverage"}] if covered else []),
        ],
        "version": dataset.version,
        "subjects": [{"subject": word} for word in str(attributes["keywords"]).split(", ")],
        "descriptions": [{"description": str(attributes["summary"]), "descriptionType": "Abstract"}],
        "rightsList": _rights(described.licence),
        "relatedIdentifiers": [
            {
                "relatedIdentifier": one.identifier,
                "relatedIdentifierType": "URL" if "://" in one.identifier else "DOI",
                "relationType": _camel(one.relation, 1),
            }
            for one in dataset.related
        ],
        "fundingReferences": [known({"funderName": one.funder, "awardNumber": one.award}) for one in dataset.funding],
        "geoLocations": [{"geoLocationBox": corners}] if len(corners) == len(box) else None,
        "formats": ["application/vnd+zarr" if told["is_zarr"] else "application/x-netcdf"],
        "language": "en",
    }
    return _written(content)


def funded(dataset: Dataset) -> list[str]:
    """Who paid, and for what."""
    return [", ".join(filter(None, (one.funder, one.award))) for one in dataset.funding]


def lock(manifest: Mapping[str, Any]) -> str:
    """``requirements.txt``: versions of all packages with which the result was computed."""
    environment = manifest.get("environment", {})
    versions = environment.get("lock") or environment.get("packages", {})
    commit = environment.get("commit")
    own = f"# heliosweep {versions.get('heliosweep') or 'of unknown version'}{f', commit {commit}' if commit else ''}"
    pinned = (f"{name}=={version}" for name, version in sorted(versions.items()) if version and name != "heliosweep")
    head = ("# Packages with which the result was computed, as pip installs them.", own)
    return "\n".join((*head, f"# Python {environment.get('python', 'of unknown version')}", *pinned, ""))


def _depositor(creator: Creator) -> dict[str, Any]:
    return known({"name": creator.name, "affiliation": creator.affiliation, "orcid": creator.orcid})


def _person(creator: Creator) -> dict[str, Any]:
    family, comma, given = creator.name.partition(", ")
    identifier = {"nameIdentifierScheme": "ORCID", "schemeUri": "https://orcid.org", "nameIdentifier": orcid(creator)}
    return known(
        {
            "name": creator.name,
            "nameType": "Personal" if comma else "Organizational",
            "familyName": family if comma else None,
            "givenName": given,
            "nameIdentifiers": [identifier] if creator.orcid else None,
            "affiliation": [{"name": creator.affiliation}] if creator.affiliation else None,
        }
    )


def _rights(licence: Licence) -> list[dict[str, Any]]:
    spdx = {"rightsIdentifier": licence.spdx, "rightsIdentifierScheme": "SPDX"} if licence.spdx else {}
    return [known({"rights": licence.name, "rightsUri": licence.url, **spdx})]


def _camel(relation: str, start: int) -> str:
    """``is_part_of`` as ``isPartOf``, or with a capital at the start."""
    words = relation.split("_")
    return "".join([*words[: 1 - start], *(word.capitalize() for word in words[1 - start :])])


def _written(content: Mapping[str, Any]) -> str:
    return json.dumps(known(content), indent=2, ensure_ascii=False) + "\n"

"""Texts of an archive of several results: what is in which folder, for readers and as RO-Crate 1.1 for machines."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from heliosweep.share.texts import METADATA, Described, known, prose


def collection_readme(members: Mapping[str, Described]) -> str:
    """README.md over the results in the folders of these names."""
    lines = [f"- [`{name}`]({name}/README.md): {prose(one.told['title'])}" for name, one in members.items()]
    return "\n".join(
        [
            f"# {len(members)} results of heliosweep",
            "",
            "Each folder holds a result with its study, licence, citation, checksums and a README.",
            "",
            *lines,
            "",
        ]
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
            "name": f"{len(members)} results of heliosweep",
            "description": "; ".join(one.told["title"] for one in members.values()),
            "datePublished": max(one.told["finished"][:10] for one in members.values()),
            "license": ", ".join(licences),
            "hasPart": [{"@id": part["@id"]} for part in parts],
        },
        *parts,
        *described,
    ]
    content = {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": [known(entity) for entity in graph]}
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"

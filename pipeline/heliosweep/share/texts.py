"""Texts of an archive for its readers: README, licence, citation, package versions and RO-Crate metadata."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from heliosweep.config.blocks import OWN
from heliosweep.config.study import Study
from heliosweep.errors import load_extra, printable

if TYPE_CHECKING:
    import xarray as xr

#: Creators of a study that names none.
DEFAULT_CREATOR = "The authors of this data set"
#: Licence of a draft that has none.
DRAFT = "LicenseRef-Draft"


@dataclass(frozen=True)
class Described:
    """A data set with all that its texts contain.

    Parameters
    ----------
    study : Study
        The study.
    manifest : mapping
        Manifest of its result, without paths and machine.
    attributes : mapping
        Global attributes of the result.
    sizes : mapping of str to int
        Dimensions.
    coordinates, data : mapping of str to xarray.Variable
        Variables of the result.
    inputs : mapping of str to str
        Key of the study that names each input, by the name of the input in the archive.
    licence : str
        SPDX identifier, or ``LicenseRef-NAME``.
    place, file : pathlib.Path
        Result folder, and file of the result.
    """

    study: Study
    manifest: Mapping[str, Any]
    attributes: Mapping[str, Any]
    sizes: Mapping[str, int]
    coordinates: Mapping[str, xr.Variable]
    data: Mapping[str, xr.Variable]
    inputs: Mapping[str, str]
    licence: str
    place: Path
    file: Path

    @cached_property
    def words(self) -> dict[str, Any]:
        """Values that the texts use, by name."""
        attributes, manifest, dataset = self.attributes, self.manifest, self.study.dataset
        result, environment = str(manifest["result"]["file"]), manifest.get("environment", {})
        creators = dataset.creators if dataset else ()
        return {
            **{field.name: getattr(self, field.name) for field in fields(self)},
            # SPDX does not list licences of one's own.
            "licence_url": None if self.licence.startswith(OWN) else f"https://spdx.org/licenses/{self.licence}.html",
            "title": str(attributes["title"]),
            "summary": str(attributes["summary"]),
            "keywords": str(attributes["keywords"]).split(", "),
            "result": result,
            "is_zarr": result.endswith(".zarr"),
            "study_id": str(manifest["study_id"]),
            "finished": str(manifest["finished"]),  # ISO 8601
            "software": str(attributes["source"]).removeprefix("heliosweep ").partition(",")[0],
            "commit": environment.get("commit"),
            "python": environment.get("python"),
            "versions": environment.get("lock") or environment.get("packages", {}),
            "is_draft": self.licence == DRAFT,
            "creators": creators,
            "people": "; ".join(creator.name for creator in creators) or DEFAULT_CREATOR,
            "doi": dataset.doi if dataset else None,  # without the address of its resolver
            "version": dataset.version if dataset else None,
            "references": list(filter(None, str(attributes.get("references", "")).split("; "))),
        }


@cache
def _templates() -> Environment:
    """Return the templates of the texts."""
    options: dict[str, Any] = {"undefined": StrictUndefined, "trim_blocks": True, "keep_trailing_newline": True}
    texts = Environment(loader=PackageLoader("heliosweep.share"), **options)
    cell = partial(re.sub, r"([|\\])", r"\\\1")
    # Times are decoded when the result is opened.
    units: Any = lambda one: "date" if " since " in (unit := str(one.attrs.get("units", ""))) else unit  # noqa: E731
    texts.filters |= {"cell": lambda text: cell(" ".join(text.split())), "prose": prose, "units": units}
    texts.filters["printable"] = printable
    return texts


def text_of(template: str, **words: Any) -> str:
    """Return README.md, LICENSE, requirements.txt, or COLLECTION.md of several results, from its template."""
    return _templates().get_template(template).render(words)


def prose(text: object) -> str:
    """Return text on one line of Markdown, with markup, formulas and HTML escaped."""
    return re.sub(r"([\\`*\[\]<>|$~#&])", r"\\\1", printable(" ".join(str(text).split())))


def citation(described: Described) -> str:
    """Return the text of CITATION.cff."""
    words, authors = described.words, list[dict[str, Any]]()
    for one in words["creators"]:
        family, comma, given = one.name.partition(", ")
        names = {"family-names": family, "given-names": given} if comma else {"name": one.name}
        address = {"affiliation": one.affiliation if comma else None, "email": one.email, "orcid": one.orcid_url}
        authors.append(_without_empty({**names, **address}))
    software = {"type": "software", "title": "heliosweep", "version": words["software"],
                "authors": [{"name": "The heliosweep developers"}]}  # fmt: skip
    content = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it as below.",
        "type": "dataset",
        "title": words["title"],
        "abstract": words["summary"],
        "authors": authors or [{"name": DEFAULT_CREATOR}],
        "date-released": words["finished"][:10],
        "keywords": words["keywords"],
        "doi": words["doi"],
        "version": words["version"],
        "identifiers": [{"type": "other", "value": words["study_id"], "description": "identifier of the study"}],
        "license": described.licence if words["licence_url"] else None,
        "references": [software],
    }
    return yaml.safe_dump(_without_empty(content), sort_keys=False, allow_unicode=True, width=120)


def _without_empty(entity: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entity.items() if value}


#: Name of the metadata file in the archive.
METADATA = "ro-crate-metadata.json"


def crate(described: Described, digests: Mapping[str, str], sizes: Mapping[str, int]) -> str:
    """Return the text of ``ro-crate-metadata.json``: the files, their creators and the run.

    Parameters
    ----------
    described : Described
        Data set of the archive.
    digests, sizes : mapping of str to str, int
        SHA-256 and size of each file in the archive, by name. [bytes]

    Raises
    ------
    HeliosweepError
        If the package `rocrate` is not installed.
    """
    library = load_extra("rocrate.rocrate", "rocrate", "crate")
    from rocrate.model import ContextEntity, File, Person

    words = described.words
    made = library.ROCrate()
    made.name, made.description, made.keywords = words["title"], words["summary"], ", ".join(words["keywords"])
    made.license, made.datePublished = words["licence_url"] or described.licence, words["finished"][:10]
    made.creator = [
        made.add(Person(made, creator.orcid_url or f"#creator-{number}", {"name": creator.name}))
        for number, creator in enumerate(words["creators"], 1)
    ]
    files = {
        name: made.add(File(made, None, name, properties={"sha256": digest, "contentSize": str(sizes[name])}))
        for name, digest in digests.items()
    }
    program = {"@type": "SoftwareApplication", "name": "heliosweep", "version": words["software"]}
    run = made.add(ContextEntity(made, "#run", {"@type": "CreateAction", "endTime": words["finished"]}))
    run["instrument"] = made.add(ContextEntity(made, "#heliosweep", program))
    run["object"] = [files[name] for name in ("study.yaml", *described.inputs)]
    run["result"] = [entity for name, entity in files.items() if name.partition("/")[0] == words["result"]]
    return json.dumps(made.metadata.generate(), indent=2, ensure_ascii=False) + "\n"

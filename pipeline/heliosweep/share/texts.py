"""Texts of an archive for its readers: README, licence, citation and notebook."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

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


def contact_of(dataset: Dataset) -> Creator | None:
    """Whom to ask: who is named, or else the first creator with an address."""
    return dataset.contact or next((creator for creator in dataset.creators if creator.email), None)

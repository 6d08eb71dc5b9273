"""The block ``dataset``: authors, licence and keywords of a published result."""

from __future__ import annotations

import re
from functools import partial
from typing import Annotated, Any

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.faults import Invalid
from heliosweep.config.values import Choice, Text, free_text

#: Start of the name of a licence that SPDX does not list.
OWN = "LicenseRef-"

_LICENCE = r"[A-Za-z0-9][A-Za-z0-9.+-]*"
_ORCID = r"(?:https://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])"
_DOI = r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}(?:\.\d+)*/\S+)"
#: Relations to other works, as DataCite names them, with their meaning.
RELATIONS = {
    "references": "the data set uses or names it",
    "cites": "the data set cites it",
    "is_supplement_to": "publication that the data set accompanies",
    "is_documented_by": "description of the data set",
    "is_derived_from": "source of the data set",
    "is_version_of": "the data set is one of its versions",
    "is_part_of": "collection that contains the data set",
    "compiles": "program that computed the data set",
}


def _matched(expression: str, example: str, raw: Any) -> str:
    """Return the text, or its only group. Raises Invalid."""
    match = re.fullmatch(expression, free_text(raw).strip())
    if match is None:
        raise Invalid(f"must be {example}")
    return match[1] if match.re.groups and match[1] else match[0]


def licence(text: str) -> str:
    """Return the identifier of a licence. Raises Invalid."""
    return _matched(_LICENCE, f"an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or {OWN}NAME", text)


_orcid = partial(_matched, _ORCID, "an ORCID iD such as 0000-0002-1825-0097")
_doi = partial(_matched, _DOI, "a DOI such as 10.5281/zenodo.1234567")
_work = partial(_matched, rf"{_DOI}|https?://\S+", "a DOI such as 10.5281/zenodo.1234567, or an address")


class Creator(Block):
    """A person or a group that made the data set."""

    name: Annotated[str, Text("Name, 'Family, Given' for a person")]
    orcid: Annotated[
        str | None,
        Text("ORCID iD, such as 0000-0002-1825-0097", form=_orcid),
    ] = None
    affiliation: Annotated[str | None, Text("Institution")] = None
    email: Annotated[str | None, Text("E-mail address for questions")] = None

    @property
    def orcid_url(self) -> str | None:
        """Address of the ORCID iD."""
        return f"https://orcid.org/{self.orcid}" if self.orcid else None


class Funding(Block):
    """A source of funding."""

    funder: Annotated[str, Text("Funding organization")]
    award: Annotated[str | None, Text("Number or title of the grant")] = None


class Related(Block):
    """A publication, data set or program related to the data set."""

    identifier: Annotated[
        str,
        Text("DOI or address", form=_work),
    ]
    relation: Annotated[str, Choice("Relation of the data set to it", RELATIONS, sweep=False)] = "references"


class Dataset(Block):
    """Authors, licence and keywords of the result as a publication; not part of the study's identity."""

    creators: Annotated[tuple[Creator, ...], Field(description="Authors, in the order of citation")] = ()
    license: Annotated[
        str | None,
        Text(
            "Licence of the data: an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME",
            form=licence,
        ),
    ] = None
    doi: Annotated[
        str | None,
        Text("DOI of the published data set, such as 10.5281/zenodo.1234567",
             form=_doi),
    ] = None  # fmt: skip
    keywords: Annotated[
        tuple[Annotated[str, Text("Keyword")], ...], Field(description="Keywords in addition to the family's keywords")
    ] = ()
    version: Annotated[str | None, Text("Version of the data set, such as '1.0'")] = None
    publisher: Annotated[str | None, Text("Repository or institution that publishes it, such as Zenodo")] = None
    contact: Annotated[
        Creator | None, Field(description="Contact person (default: the first creator with an e-mail address)")
    ] = None
    funding: Annotated[tuple[Funding, ...], Field(description="Sources of funding")] = ()
    related: Annotated[tuple[Related, ...], Field(description="Related publications, data sets and programs")] = ()
    naming_authority: Annotated[
        str | None, Text("Domain of the organization that assigns the result's 'id', such as institute.example.org")
    ] = None

"""The block ``dataset``: who made a data set, how it may be used, and what it has to do with."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.faults import Invalid, nearest
from heliosweep.config.values import Choice, Text, free_text, pattern

_CC = ("CC-BY", "CC-BY-SA", "CC-BY-NC", "CC-BY-ND", "CC-BY-NC-SA", "CC-BY-NC-ND")
_GNU = ("GPL-2.0", "GPL-3.0", "LGPL-2.1", "LGPL-3.0", "AGPL-3.0", "GFDL-1.3")
#: SPDX identifiers of the licences that data sets usually have.
LICENCES = (
    "CC0-1.0", *(f"{name}-{version}" for name in _CC for version in ("1.0", "2.0", "2.5", "3.0", "4.0")),
    "ODbL-1.0", "ODC-By-1.0", "PDDL-1.0", "CDLA-Permissive-1.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0",
    "C-UDA-1.0", "O-UDA-1.0", "DL-DE-BY-2.0", "DL-DE-ZERO-2.0", "etalab-2.0", "NLOD-2.0", "OGL-Canada-2.0",
    "OGL-UK-3.0", "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD-3-Clause-Clear", "BSL-1.0", "CECILL-2.1",
    "EUPL-1.1", "EUPL-1.2", "ISC", "MIT", "MIT-0", "MPL-2.0", "Unlicense", "Zlib",
    *(f"{name}-{which}" for name in _GNU for which in ("only", "or-later")),
)  # fmt: skip
#: Begins the name of a licence that SPDX does not list.
OWN = "LicenseRef-"

_OWN = r"LicenseRef-[A-Za-z0-9.-]+"
_ORCID = r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]"
_ORCID_URL = rf"(https://orcid\.org/)?{_ORCID}"
_DOMAIN = r"([A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?\.)+[A-Za-z]{2,63}"
_URL = r"https?://[^\s]+"
#: What a data set is to another work, and how DataCite and Zenodo say so.
RELATIONS = {
    "references": "uses or names it",
    "cites": "cites it",
    "is_supplement_to": "goes with this publication",
    "is_documented_by": "is described there",
    "is_derived_from": "was made from it",
    "is_version_of": "is one of its versions",
    "is_part_of": "is a part of it",
    "compiles": "was computed by it",
}
_DOI = r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}(?:\.\d+)*/\S+)"


def licence(text: str) -> str:
    """Return the identifier of a licence as it was given. Raises Invalid."""
    if text in LICENCES or re.fullmatch(_OWN, text):
        return text
    if text.startswith(OWN):
        raise Invalid(f"{OWN}NAME has letters, digits, '.' and '-' in its name")
    meant = nearest(text.casefold(), by_fold := {name.casefold(): name for name in LICENCES})
    hint = f"; did you mean '{by_fold[meant]}'?" if meant else f"; use one as CC-BY-4.0 or CC0-1.0, or {OWN}NAME"
    raise Invalid(f"is no SPDX identifier of a usual licence{hint}")


def _bare_doi(raw: Any) -> str:
    """Return a DOI without the address of doi.org. Raises Invalid."""
    found = re.fullmatch(_DOI, free_text(raw).strip())
    if found is None:
        raise Invalid("must be a DOI, as 10.5281/zenodo.1234567")
    return found[1]


def _orcid(raw: Any) -> str:
    """Return an ORCID iD whose check digit is right (ISO 7064, MOD 11-2). Raises Invalid."""
    text = free_text(raw).strip().removeprefix("https://orcid.org/")
    total = 0
    for digit in text.replace("-", "")[:-1] if re.fullmatch(_ORCID, text) else "":
        total = (total + int(digit)) * 2
    if not total or text[-1] != "0123456789X"[(12 - total % 11) % 11]:
        raise Invalid("must be an ORCID iD, as 0000-0002-1825-0097, whose last sign checks the others")
    return text


def _domain(raw: Any) -> str:
    """Return a domain. Raises Invalid."""
    text = free_text(raw).strip()
    if not re.fullmatch(_DOMAIN, text):
        raise Invalid("must be a domain, as institute.example.org")
    return text


def _identifier(raw: Any) -> str:
    """Return an address, or a DOI without that of doi.org. Raises Invalid."""
    text = free_text(raw).strip()
    if found := re.fullmatch(_DOI, text):
        return found[1]
    if not re.fullmatch(_URL, text):
        raise Invalid("must be a DOI, as 10.5281/zenodo.1234567, or an address that begins with https://")
    return text


class Creator(Block):
    """A person, or a group, that made the data set."""

    name: Annotated[str, Text("Name, as 'Family, Given' or as the group calls itself")]
    orcid: Annotated[
        str | None, Text("ORCID iD, as 0000-0002-1825-0097", form=_orcid, schema=pattern(rf"\s*{_ORCID_URL}\s*"))
    ] = None
    affiliation: Annotated[str | None, Text("Institution")] = None
    email: Annotated[str | None, Text("Address for questions")] = None


class Funding(Block):
    """Who paid for the work."""

    funder: Annotated[str, Text("Who paid")]
    award: Annotated[str | None, Text("Number or title of the grant")] = None


class Related(Block):
    """A publication, data set or program that the data set has to do with."""

    identifier: Annotated[str, Text("DOI or address", form=_identifier, schema=pattern(rf"({_DOI}|{_URL})"))]
    relation: Annotated[str, Choice("What the data set is to it", RELATIONS, sweep=False)] = "references"


class Dataset(Block):
    """Authors, licence and keywords of the result as a publication; not part of the study's identity."""

    creators: Annotated[tuple[Creator, ...], Field(description="Who made it, in the order of citation")] = ()
    license: Annotated[
        str | None,
        Text(
            "Licence of the data: an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME",
            form=lambda raw: licence(free_text(raw)),
            schema={"anyOf": [{"enum": list(LICENCES)}, pattern(_OWN)]},
        ),
    ] = None
    doi: Annotated[
        str | None,
        Text(
            "DOI of the published data set, as 10.5281/zenodo.1234567", form=_bare_doi, schema=pattern(rf"\s*{_DOI}\s*")
        ),
    ] = None
    keywords: Annotated[
        tuple[Annotated[str, Text("Keyword")], ...], Field(description="Keywords besides those of the family")
    ] = ()
    version: Annotated[str | None, Text("Version of the data set, as '1.0'")] = None
    publisher: Annotated[str | None, Text("Repository or institution that publishes it, as Zenodo")] = None
    contact: Annotated[
        Creator | None, Field(description="Whom to ask; the first creator with an address where left out")
    ] = None
    funding: Annotated[tuple[Funding, ...], Field(description="Who paid for the work")] = ()
    related: Annotated[
        tuple[Related, ...], Field(description="Publications, data sets and programs that it has to do with")
    ] = ()
    naming_authority: Annotated[
        str | None,
        Text("Domain of who gives out the result's 'id'; none where left out", form=_domain, schema=pattern(_DOMAIN)),
    ] = None

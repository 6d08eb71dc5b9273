"""The dataset block: who made a data set, and how others may use and cite it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.citable import Doi, LicenceName
from heliosweep.config.names import Text


class Creator(Block):
    """A person, or a group, that made the data set."""

    name: Annotated[str, Text("Name, as 'Family, Given' or as the group calls itself")]
    orcid: Annotated[str | None, Text("ORCID iD, as 0000-0002-1825-0097")] = None
    affiliation: Annotated[str | None, Text("Institution")] = None
    email: Annotated[str | None, Text("Address for questions")] = None


class Dataset(Block):
    """What is said of the result when it is published; not part of the study's identity."""

    creators: Annotated[tuple[Creator, ...], Field(description="Who made it, in the order of citation")] = ()
    license: Annotated[
        str | None,
        LicenceName("Licence of the data: an SPDX identifier such as CC-BY-4.0 or CC0-1.0, or LicenseRef-NAME"),
    ] = None
    doi: Annotated[str | None, Doi("DOI of the published data set, as 10.5281/zenodo.1234567")] = None
    keywords: Annotated[
        tuple[Annotated[str, Text("Keyword")], ...], Field(description="Keywords besides those of the family")
    ] = ()

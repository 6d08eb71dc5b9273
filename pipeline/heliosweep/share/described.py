"""A data set as its README, citation and crate describe it, and its licence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from heliosweep.config.blocks import OWN, Creator
from heliosweep.config.study import Study

#: Stands for the creators of a study that names none.
NOBODY = "The authors of this data set"
#: Of a data set whose study and user name none.
DEFAULT = "CC-BY-4.0"

_CC = "https://creativecommons.org"
_KNOWN = {
    "CC-BY-4.0": ("Creative Commons Attribution 4.0 International", f"{_CC}/licenses/by/4.0/"),
    "CC-BY-SA-4.0": ("Creative Commons Attribution-ShareAlike 4.0 International", f"{_CC}/licenses/by-sa/4.0/"),
    "CC-BY-NC-4.0": ("Creative Commons Attribution-NonCommercial 4.0 International", f"{_CC}/licenses/by-nc/4.0/"),
    "CC0-1.0": ("Creative Commons CC0 1.0 Universal (public domain dedication)", f"{_CC}/publicdomain/zero/1.0/"),
    "ODbL-1.0": ("Open Database License 1.0", "https://opendatacommons.org/licenses/odbl/1-0/"),
    "ODC-By-1.0": ("Open Data Commons Attribution License 1.0", "https://opendatacommons.org/licenses/by/1-0/"),
    "PDDL-1.0": ("Open Data Commons Public Domain Dedication 1.0", "https://opendatacommons.org/licenses/pddl/1-0/"),
}
_MEANS = {
    "CC-BY-4.0": (
        "You may share and adapt the data for any purpose, also commercially, if you give appropriate credit, link to "
        "the licence and say what you changed."
    ),
    "CC0-1.0": "To the extent possible under law, the creators have waived all rights to the data.",
}


@dataclass(frozen=True)
class Licence:
    """The licence of a data set.

    Parameters
    ----------
    text : str
        An SPDX identifier, or ``LicenseRef-NAME``.
    """

    text: str

    @property
    def spdx(self) -> str | None:
        """SPDX identifier; None for a licence of one's own."""
        return None if self.text.startswith(OWN) else self.text

    @property
    def name(self) -> str:
        """Name, for readers."""
        return _KNOWN[self.text][0] if self.text in _KNOWN else self.text

    @property
    def url(self) -> str | None:
        """Address of its full text; None for a licence of one's own."""
        if self.text in _KNOWN:
            return _KNOWN[self.text][1]
        return f"https://spdx.org/licenses/{self.spdx}.html" if self.spdx else None

    def notice(self, title: str, people: str) -> str:
        """The file that goes with the data."""
        if self.url is None:
            return f"{title}\n{people}\n\nThe creators name the terms.\n\nSPDX-License-Identifier: {self.text}\n"
        legal = f"{self.url}legalcode" if self.text.startswith("CC") and self.text in _KNOWN else self.url
        parts = [
            f"{title}\n{people}",
            f"This data set is licensed under: {self.name} ({self.spdx}).",
            _MEANS.get(self.text, ""),
            f"Full text of the licence: {legal}",
            f"SPDX-License-Identifier: {self.spdx}",
        ]
        return "\n\n".join(part for part in parts if part) + "\n"


@dataclass(frozen=True)
class Column:
    """A variable of the result.

    Parameters
    ----------
    name, units, meaning : str
        Name, units and long name.
    dims : tuple of str
        Dimensions.
    """

    name: str
    units: str
    meaning: str
    dims: tuple[str, ...]


@dataclass(frozen=True)
class Described:
    """A data set.

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
    coordinates, data : list of Column
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
    coordinates: list[Column]
    data: list[Column]
    inputs: Mapping[str, str]
    licence: Licence

    @property
    def title(self) -> str:
        """Title."""
        return str(self.attributes["title"])

    @property
    def summary(self) -> str:
        """Summary."""
        return str(self.attributes["summary"])

    @property
    def keywords(self) -> list[str]:
        """Keywords."""
        return str(self.attributes["keywords"]).split(", ")

    @property
    def result(self) -> str:
        """Name of the result: ``result.nc`` or ``result.zarr``."""
        return str(self.manifest["result"]["file"])

    @property
    def study_id(self) -> str:
        """Its identifier."""
        return str(self.manifest["study_id"])

    @property
    def finished(self) -> str:
        """When it was computed, ISO 8601."""
        return str(self.manifest["finished"])

    @property
    def software(self) -> str:
        """Version of heliosweep that computed it."""
        return str(self.attributes["source"]).removeprefix("heliosweep ").partition(",")[0]

    @property
    def creators(self) -> tuple[Creator, ...]:
        """Who made it; none where the study does not say."""
        return self.study.dataset.creators if self.study.dataset else ()

    @property
    def people(self) -> str:
        """Names of the creators in one line."""
        return "; ".join(creator.name for creator in self.creators) or NOBODY

    @property
    def doi(self) -> str | None:
        """DOI without the address of its resolver."""
        return self.study.dataset.doi if self.study.dataset else None

    @property
    def citation(self) -> str:
        """The data set as a reference list has it."""
        where = f" https://doi.org/{self.doi}" if self.doi else f" Study {self.study_id}."
        return f"{self.people} ({self.finished[:4]}). {self.title} [Data set].{where}"

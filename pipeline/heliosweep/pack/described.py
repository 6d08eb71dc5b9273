"""What a data set is, as its README, citation and crate say it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from heliosweep.config.dataset import Creator
from heliosweep.config.study import Study
from heliosweep.pack.licences import Licence

#: Stands for the creators of a study that names none.
NOBODY = "The authors of this data set"


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
        """What it shows."""
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

"""What a study family is, and where families are found."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Workload


StudyT = TypeVar("StudyT", bound="Study", contravariant=True)


class Family(Protocol[StudyT]):
    """A kind of study: one folder beside this file, or an entry point of another package.

    Each method imports what it needs when it is called, so that validating a study stays quick.
    """

    name: str
    title: str
    references: tuple[str, ...]

    def study_class(self) -> type[Study]:
        """Pydantic model of the study file."""
        ...

    def example(self) -> str:
        """Commented study file to start from."""
        ...

    def workload(self, study: StudyT) -> Workload:
        """Sizes and cost, for the plan."""
        ...

    def prepare(self) -> tuple[float, bool]:
        """Load or compile the kernels; seconds it took, and whether something was compiled."""
        ...

    def build(self, study: StudyT, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid."""
        ...

    def coordinates(self, study: StudyT) -> xr.Dataset:
        """Coordinates of the whole result, in memory; its attributes go to those of the file."""
        ...

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Figures of a finished result, drawn one at a time."""
        ...


@dataclass(frozen=True)
class NamedFigure:
    """A figure, the file name it gets and the sentence below it."""

    name: str
    caption: str
    figure: Figure


@cache
def families() -> dict[str, Family[Any]]:
    """All families by name: the folders beside this file, then entry points in the group ``heliosweep.families``."""
    import heliosweep.families as package

    found: dict[str, Family[Any]] = {}
    for module in pkgutil.iter_modules(package.__path__):
        if module.ispkg:
            family = import_module(f"{package.__name__}.{module.name}").FAMILY
            found[family.name] = family
    for entry in metadata.entry_points(group="heliosweep.families"):
        family = entry.load()
        found.setdefault(family.name, family)
    return found


def study_classes() -> dict[str, type[Study]]:
    """Study model of every family, for loading study files."""
    return {name: family.study_class() for name, family in families().items()}

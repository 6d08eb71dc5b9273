"""What a study family is, and where families are found."""

from __future__ import annotations

import logging
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Workload


log = logging.getLogger("heliosweep")

#: Group of the entry points by which other packages add families; the name of each is that of its family.
GROUP = "heliosweep.families"

T = TypeVar("T")
StudyT = TypeVar("StudyT", bound="Study", contravariant=True)


class Family(Protocol[StudyT]):
    """A kind of study: one folder beside this file, or an entry point of another package.

    Each method imports what it needs when it is called, so that validating a study stays quick.

    A family may also have ``keywords``, by which its results are found; ``tables(result)``, see `Table`;
    ``views(result)``, which yields the interactive plots of the page, see `heliosweep.report.views.View`; and
    ``headlines``, names of variables of which the first that a result has is told in the list of all studies.
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

    def prepare(self, study: StudyT) -> tuple[float, bool]:
        """Load or compile the kernels that a study calls; seconds it took, and whether something was compiled."""
        ...

    def build(self, study: StudyT, chunks: Mapping[str, int], select: Mapping[str, slice]) -> xr.Dataset:
        """Lazy result over a part of the parameter grid; time series perhaps over a part of their other dimensions."""
        ...

    def coordinates(self, study: StudyT) -> xr.Dataset:
        """Coordinates of the whole result, in memory; its attributes go to those of the file."""
        ...

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """What the user should be told of a finished result."""
        ...

    def figures(self, result: xr.Dataset) -> Iterable[NamedFigure]:
        """Figures of a finished result, drawn one at a time."""
        ...


@dataclass(frozen=True)
class Table:
    """A table of headline numbers.

    A family that makes such has a method ``tables(result)``, which returns several; without it, the page shows the
    variables over the dimensions that all have.

    Parameters
    ----------
    label : str
        What the table holds, in few words.
    header : sequence of str
        Names of the columns, with the unit in brackets.
    rows : sequence of sequences of str
        Cells.
    words : frozenset of int
        Columns of text; the others are numbers.
    notes : sequence of str
        Sentences below it.
    """

    label: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: frozenset[int] = frozenset()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class NamedFigure:
    """A figure, the file name it gets and the sentence below it."""

    name: str
    caption: str
    figure: Figure


class Found(Mapping[str, T]):
    """Something of every family by name, imported when it is first asked for.

    What cannot be imported is left out, with a warning.

    Parameters
    ----------
    entries : mapping of str to EntryPoint
        Where each family is.
    part : callable
        What is wanted of a family.
    """

    def __init__(self, entries: Mapping[str, metadata.EntryPoint], part: Callable[[Family[Any]], T]) -> None:
        self._entries = entries
        self._part = part
        self._loaded: dict[str, T] = {}
        self._broken: set[str] = set()

    def __getitem__(self, name: str) -> T:
        """Return that of one family. Raises KeyError."""
        if name not in self._loaded:
            if name in self._broken:
                raise KeyError(name)
            entry = self._entries[name]
            try:
                self._loaded[name] = self._part(entry.load())
            except Exception as error:  # whatever another package does must not stop the other families
                self._broken.add(name)
                log.warning("the family %r cannot be loaded from %s: %r", name, entry.value, error)
                raise KeyError(name) from error
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the families that can be loaded; loads them all."""
        return (name for name in self._entries if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def families() -> Mapping[str, Family[Any]]:
    """All families by name: the folders beside this file, then entry points in the group ``heliosweep.families``."""
    return Found(_entries(), lambda family: family)


@cache
def study_classes() -> Mapping[str, type[Study]]:
    """Study model of every family, for loading study files."""
    return Found(_entries(), lambda family: family.study_class())


@cache
def _entries() -> dict[str, metadata.EntryPoint]:
    """Where each family is; nothing of it is imported."""
    import heliosweep.families as package

    ours = (
        metadata.EntryPoint(module.name, f"{package.__name__}.{module.name}:FAMILY", GROUP)
        for module in pkgutil.iter_modules(package.__path__)
        if module.ispkg
    )
    found: dict[str, metadata.EntryPoint] = {}
    for entry in (*ours, *metadata.entry_points(group=GROUP)):
        first = found.setdefault(entry.name, entry)
        if first != entry:
            log.warning("two families are named %r: %s is used, %s is not", entry.name, first.value, entry.value)
    return found

"""What a study family is, and where families are found."""

from __future__ import annotations

import json
import logging
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module, metadata, resources
from importlib.util import find_spec
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region, Variable
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table


log = logging.getLogger("heliosweep")

#: Group of the entry points by which other packages add families; the name of each is that of its family.
GROUP = "heliosweep.families"

T = TypeVar("T")


class Family:
    """A kind of study: one folder beside this file, or an entry point of another package.

    A family says what its result holds, computes any region of it with NumPy, and finishes whole points. Who hands out
    regions, where they run and how they are stored is no concern of a family.

    A family is a package. Its parts are found by name, and imported when they are asked for, so that validating a
    study stays quick: ``study`` with the model `STUDY` of the study file, ``variables``, ``compute``, ``figures``
    and ``tables`` with the functions that are described here, and ``default.yaml``, a commented study
    to start from.
    A family with modes has ``variables`` and ``compute`` in a package for each mode, see `room`.

    Attributes
    ----------
    name, title : str
        Name in study files; what it computes, in one line.
    references, keywords : tuple of str
        Sources of the models; words by which results are found.
    headlines : tuple of str
        Variables of which the first that a result has is told in the list of all studies.
    optional : mapping of str to str
        Variables that only some studies have, and the key that adds each, for messages.
    """

    name: str
    title: str
    references: tuple[str, ...] = ()
    keywords: tuple[str, ...] = ()
    headlines: tuple[str, ...] = ()
    optional: Mapping[str, str] = MappingProxyType({})

    def room(self, mode: str) -> str:
        """Package with ``variables`` and ``compute`` of a mode; that of the family where it has no modes."""
        return type(self).__module__

    def mode(self, study: Any) -> str:
        """Mode of a study, empty where the family has none; the attribute ``mode`` of its result."""
        return ""

    def module(self, name: str, mode: str = "") -> Any:
        """One of the modules of a mode."""
        return import_module(f"{self.room(mode)}.{name}")

    def study_class(self) -> type[Study]:
        """Pydantic model of the study file."""
        model: type[Study] = import_module(f"{type(self).__module__}.study").STUDY
        return model

    def example(self) -> str:
        """Commented study file to start from."""
        return resources.files(type(self).__module__).joinpath("default.yaml").read_text(encoding="utf-8")

    def workload(self, study: Any) -> Workload:
        """Sizes and cost, for the plan."""
        return self.module("compute", self.mode(study)).workload(study)

    def variables(self, study: Any) -> dict[str, Variable]:
        """Variables of the result, in the order of the file: dimensions, attributes, types, and who makes them."""
        return self.module("variables", self.mode(study)).variables(study)

    def coordinates(self, study: Any) -> xr.Dataset:
        """Coordinates of the whole result, in memory; its attributes go to those of the file."""
        mode = self.mode(study)
        labels: xr.Dataset = self.module("compute", mode).coordinates(study)
        return labels.assign_attrs(mode=mode) if mode else labels

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels that a study calls, if any; seconds it took, and whether some were compiled."""
        return getattr(self.module("compute", self.mode(study)), "prepare", lambda _: (0.0, False))(study)

    def inputs(self, study: Any) -> Any:
        """Everything that `compute` takes from files: layouts, tables, images; None where the module does not say.

        Read once, and sent to every worker.
        """
        return getattr(self.module("compute", self.mode(study)), "inputs", lambda _: None)(study)

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        """Values over a region of the result.

        Parameters
        ----------
        study : Study
            Checked study.
        inputs : object
            From `inputs`; no file is read here.
        region : Region
            Part of the swept dimensions and of those that the workload lets be cut; dimensions that are not named are
            whole.

        Returns
        -------
        xarray.Dataset
            The variables that are not `finished`: those along ``time`` where the region has it, else all others. No
            value depends on the region that it is computed in.
        """
        return self.module("compute", self.mode(study)).compute(study, inputs, region)

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Variables that follow from whole points: means over a field, statistics over dates.

        Parameters
        ----------
        study, inputs
            As for `compute`.
        region : Region
            Part of the swept dimensions; all others are whole, and those of `Workload.whole` too.
        computed : xarray.Dataset
            What `compute` made there.

        Returns
        -------
        xarray.Dataset
            The variables that are `finished`.
        """
        return self.module("compute", self.mode(study)).finish(study, inputs, region, computed)

    def of_draws(self, drawn: bool) -> Family:
        """Return this family, for studies whose keys are drawn with statistics over the draws."""
        found: Family = import_module("heliosweep.families.sampled").Sampled(self) if drawn else self
        return found

    def of_result(self, result: xr.Dataset) -> Family:
        """Return this family for a result, perhaps with other headlines."""
        return self

    def answers(self, result: xr.Dataset) -> Iterable[str]:
        """Return lines that answer the question of the study, for the end of a run."""
        return ()

    def search_of(self, result: xr.Dataset) -> Family:
        """Who draws the figures and makes the tables of a result of a search."""
        found: Family = import_module("heliosweep.families.searched").shown(self, result)
        return found

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """What the user should be told of a finished result."""
        return _call(f"{self.room(str(result.attrs.get('mode', '')))}.compute", "remarks", result)

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the declared figures of a result; default figures if the family declares none."""
        from heliosweep.report.figures import default_figures

        return _call(f"{type(self).__module__}.figures", "figures", result, default_figures)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Tables of headline numbers; without any, the page shows variables over the dimensions that all have."""
        return _call(f"{type(self).__module__}.tables", "tables", result)


def family_of_result(result: xr.Dataset) -> Family | None:
    """Family that tells of a result, its draws or its search; None where there is no such family."""
    said = json.loads(result.attrs.get("study", "{}"))
    family = families().get(said.get("family"))
    if family is None:
        return None
    family = family.of_result(result).of_draws("sample" in said)
    return family.search_of(result) if said.get("search") else family


def _call(
    module: str,
    function: str,
    result: xr.Dataset,
    otherwise: Callable[[xr.Dataset], Iterable[Any]] = lambda result: (),
) -> Iterable[Any]:
    """What a function of a family says of a result; `otherwise` where there is no such module or function."""
    there = None
    with suppress(ModuleNotFoundError):  # a family in a single module has none beside it
        there = find_spec(module)
    found = there and getattr(import_module(module), function, None)
    return (found or otherwise)(result)


class Found(Mapping[str, T]):
    """Something of every family by name, imported when it is first asked for.

    `entries` say where each family is, `part` what is wanted of it. What cannot be imported is left out, with a
    warning.
    """

    def __init__(self, entries: Mapping[str, metadata.EntryPoint], part: Callable[[Family], T]) -> None:
        self._entries, self._part = entries, part
        self._loaded: dict[str, T | None] = {}

    def __getitem__(self, name: str) -> T:
        """Return that of one family. Raises KeyError."""
        if name not in self._loaded:
            entry = self._entries[name]
            try:
                self._loaded[name] = self._part(entry.load())
            except Exception as error:  # whatever another package does must not stop the other families
                self._loaded[name] = None
                log.warning("the family %r cannot be loaded from %s: %r", name, entry.value, error)
        found = self._loaded[name]
        if found is None:
            raise KeyError(name)
        return found

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the families that can be loaded; loads them all."""
        return (name for name in self._entries if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def families() -> Mapping[str, Family]:
    """All families by name: the folders beside this file, then entry points in the group ``heliosweep.families``."""
    return Found(_entries(), lambda family: family)


@cache
def study_classes() -> Mapping[str, type[Study]]:
    """Study model of every family, for loading study files."""

    def built(family: Family) -> type[Study]:
        model = family.study_class()
        model.model_rebuild()  # blocks are built when they are used: what is wrong with one must show here
        return model

    return Found(_entries(), built)


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

"""Declaration of study families, and the list of all families."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from heliosweep.errors import log
from heliosweep.lazy import xr

if TYPE_CHECKING:
    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region, Variable
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table


#: Entry point group for families in other packages. The name of an entry point is the name of a family.
GROUP = "heliosweep.families"

T = TypeVar("T")


@dataclass(frozen=True)
class Computation:
    """Variables of a result and the function that computes them.

    The framework allocates the arrays, calls the function for each point of a region, and adds the coordinates.
    The required memory and disk space are derived from the variables.

    Parameters
    ----------
    function : callable
        Function that takes a `heliosweep.families.points.Point` and returns a mapping of variable names to values. Each
        value has the inner dimensions of its variable. Variables that the function omits have missing values. Values
        must not depend on the region in which they are computed.
    variables : mapping of str to Variable
        Variables with their inner dimensions. The framework prepends the swept dimensions.
    labels : tuple of str
        Keys that label the result even if they are not swept.
    dims : mapping of str to int or (array, mapping)
        Length of each inner dimension, or a pair of its labels and their CF attributes. A function may also compute
        the length or the pair from the result of `inputs`. The dimensions ``time`` and ``heliostat`` are determined by
        the study's ``time`` and ``layout`` blocks.
    coordinates : callable, optional
        Function without arguments that returns a mapping of names to additional coordinates, in a form that xarray
        accepts.
    attrs : mapping or callable
        Additional attributes of the result, or a function without arguments that returns them.
    inputs : callable, optional
        Function without arguments that reads files. The return value is available as `Point.inputs`.
    layouts : callable, optional
        Function that takes the study and returns its layouts (default: `LayoutAxis`).
    finish : callable, optional
        Function that takes the points of a region and the data set of their values, and returns the `finished`
        variables.
    arrays : tuple of str, optional
        Keys that have a single value in each call of the function. If given, each call computes many points, and the
        values of other swept keys are arrays with one axis for each swept dimension. All points of a call share one
        site and one layout.
    split : str
        Inner dimension along which the computation of one point may be split, such as ``heliostat``.
    whole : tuple of str
        Swept dimensions over which `finish` computes statistics.
    uncut : tuple of str
        Inner dimensions that are not divided into chunks.
    evaluations : int or callable, optional
        Number of kernel evaluations for one point, or a function without arguments that returns this number (default:
        number of instants times number of heliostats).
    unit : str
        Name of the unit in which the plan counts evaluations.
    memory : int or callable
        Memory needed for one point in addition to the variables, or a function without arguments that returns this
        memory. [bytes]
    fixed_memory : callable, optional
        Function without arguments that returns the memory needed even for the smallest part of a point. [bytes]
    prepare : callable, optional
        Function without arguments that compiles the kernels (default: compute a small region).
    mode : str
        Value of the result's ``mode`` attribute.
    """

    function: Callable[[Any], Mapping[str, Any]]
    variables: Mapping[str, Variable]
    labels: tuple[str, ...] = ()
    dims: Mapping[str, Any] = field(default_factory=dict)
    coordinates: Callable[[], Mapping[str, Any]] | None = None
    attrs: Mapping[str, Any] | Callable[[], Mapping[str, Any]] = field(default_factory=dict)
    inputs: Callable[[], Any] | None = None
    layouts: Callable[[Any], Any] | None = None
    finish: Callable[[Any, xr.Dataset], Mapping[str, Any]] | None = None
    arrays: tuple[str, ...] | None = None
    split: str = ""
    whole: tuple[str, ...] = ()
    uncut: tuple[str, ...] = ()
    evaluations: int | Callable[[], int] | None = None
    unit: str = "evaluations"
    memory: int | Callable[[], int] = 0
    fixed_memory: Callable[[], int] | None = None
    prepare: Callable[[], object] | None = None
    mode: str = ""


class Family:
    """Kind of study, declared by a folder in this package or by an entry point of another package.

    A declaration may use the string ``"package.module:name"`` instead of an object. The module is then imported only
    when it is needed, so that listing families and validating studies is quick.

    Parameters
    ----------
    name, title : str
        Name used in study files, and one line that names the computed quantity.
    study : class or str
        Pydantic model of the study file.
    computation : Computation, callable or str
        Declared computation of a result, or a function that takes the study and returns the computation.
    example : str or path
        Commented example study file, as a string or a path.
    references, keywords : tuple of str
        Publications that describe the models, and keywords for the results.
    headlines : tuple of str
        Variables that represent a study in a list of studies, in order of preference. The list shows the first
        variable that the result contains.
    optional : mapping of str to str
        Mapping of optional variables to the keys that enable them, used in messages.
    figures, tables : sequence, callable or str, optional
        Declared figures and tables, or functions that take the result and return them. By default the report draws and
        tabulates the variables along their common dimensions.
    remarks : callable or str, optional
        Function that takes a finished result and returns warnings.
    answers : callable or str, optional
        Function that takes a finished result and returns the lines to print at the end of a run.
    """

    def __init__(
        self,
        name: str,
        title: str,
        study: type[Study] | str,
        computation: Any,
        *,
        example: str | Path,
        references: tuple[str, ...] = (),
        keywords: tuple[str, ...] = (),
        headlines: tuple[str, ...] = (),
        optional: Mapping[str, str] | None = None,
        figures: Any = None,
        tables: Any = None,
        remarks: Any = None,
        answers: Any = None,
    ) -> None:
        self.name, self.title = name, title
        self.references, self.keywords, self.headlines = references, keywords, headlines
        self.optional = dict(optional or {})
        self._study, self._computation, self._example = study, computation, example
        self._figures, self._tables, self._remarks, self._answers = figures, tables, remarks, answers

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle a registered family by name, because its declaration may contain functions that cannot be pickled."""
        return (_named, (self.name,)) if families().get(self.name) is self else super().__reduce_ex__(protocol)

    def study_class(self) -> type[Study]:
        """Return the pydantic model of the study file."""
        return cast("type[Study]", _resolved(self._study))

    def example(self) -> str:
        """Return a commented example study file."""
        return self._example if isinstance(self._example, str) else self._example.read_text(encoding="utf-8")

    def computation(self, study: Any) -> Computation:
        """Return the variables of a study and the function that computes them."""
        return cast(Computation, _declared(self._computation, study))

    def workload(self, study: Any) -> Workload:
        """Return the dimension sizes and the computational cost of a study."""
        return _computed().workload(study, self.computation(study))

    def variables(self, study: Any) -> dict[str, Variable]:
        """Return the variables of the result, in the order of the file."""
        return _computed().variables(study, self.computation(study))

    def coordinates(self, study: Any) -> xr.Dataset:
        """Return the coordinates of the whole result as a data set in memory.

        The attributes of this data set become global attributes of the result file.
        """
        return _computed().coordinates(study, self.computation(study))

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels of a study by computing a small region of its result.

        Returns
        -------
        seconds : float
            Elapsed time. [s]
        fresh : bool
            True if a kernel was compiled.
        """
        return _computed().prepare(study, self.computation(study))

    def inputs(self, study: Any) -> Any:
        """Return the contents of the input files. Each file is read once, and its contents are sent to all workers."""
        return _computed().inputs(study, self.computation(study))

    def compute(self, study: Any, inputs: Any, region: Region) -> xr.Dataset:
        """Compute the values in a region of the result.

        Parameters
        ----------
        study : Study
            Validated study.
        inputs : object
            Return value of `inputs`; this method reads no files.
        region : Region
            Slices of the swept dimensions and of the dimension that may be split. Other dimensions are complete.

        Returns
        -------
        xarray.Dataset
            Variables that are not `finished`. Regions with the dimension ``time`` give the variables with this
            dimension; other regions give the variables without ``time``. Values do not depend on the region in which
            they are computed.
        """
        return _computed().compute(study, self.computation(study), inputs, region)

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Compute the `finished` variables of a region with complete points from the `computed` variables."""
        return _computed().finish(study, self.computation(study), inputs, region, computed)

    def of_result(self, result: xr.Dataset) -> Family:
        """Return the family to use for a result. Subclasses may return a family with other headlines."""
        return self

    def answers(self, result: xr.Dataset) -> Iterable[str]:
        """Return lines with the main results of the study, printed at the end of a run."""
        return _declared(self._answers, result) or ()

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Return warnings about a finished result."""
        return _declared(self._remarks, result) or ()

    def figures_of_draws(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return this family's figures of a result with draws, in addition to the figures common to all families."""
        return ()

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the declared figures of a result, or default figures if the family declares none."""
        return _declared(self._figures or "heliosweep.report.figures:default_figures", result)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Return the declared tables of a result; empty if the family declares none."""
        return _declared(self._tables, result) or ()


def _named(name: str) -> Family:
    return families()[name]


def _resolved(declared: Any) -> Any:
    return pkgutil.resolve_name(declared) if isinstance(declared, str) else declared


def _declared(declared: Any, of: Any) -> Any:
    """Return a declared object. If a function is declared, return its value for the study or result `of`."""
    found = _resolved(declared)
    return found(of) if callable(found) else found


def _computed() -> Any:
    return import_module("heliosweep.families.points")


class Found(Mapping[str, T]):
    """Mapping of family names to one property of each family. Families are imported on first use.

    `entries` maps family names to entry points, and the function `part` returns the property of a family. A family
    that cannot be imported is omitted, and a warning is logged.
    """

    def __init__(self, entries: Mapping[str, metadata.EntryPoint], part: Callable[[Family], T]) -> None:
        self._entries, self._part = entries, part
        self._loaded: dict[str, T | None] = {}

    def __getitem__(self, name: str) -> T:
        """Return the property of one family. Raises KeyError if the family is unknown or cannot be imported."""
        if name not in self._loaded:
            entry = self._entries[name]
            try:
                self._loaded[name] = self._part(entry.load())
            except Exception as error:  # an error in another package must not affect other families
                self._loaded[name] = None
                log.warning("the family %r cannot be loaded from %s: %r", name, entry.value, error)
        found = self._loaded[name]
        if found is None:
            raise KeyError(name)
        return found

    def __iter__(self) -> Iterator[str]:
        """Load all families and yield the names of the families that load without errors."""
        return (name for name in self._entries if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def families() -> Mapping[str, Family]:
    """Return all families by name: the folders of this package, then the entry points in ``heliosweep.families``."""
    return Found(_entries(), lambda family: family)


@cache
def study_classes() -> Mapping[str, type[Study]]:
    """Return the pydantic model of each family's study file, by family name."""

    def built(family: Family) -> type[Study]:
        model = family.study_class()
        model.model_rebuild()  # blocks are built on first use; an error in a block must be raised here
        return model

    return Found(_entries(), built)


@cache
def _entries() -> dict[str, metadata.EntryPoint]:
    """Return the entry point of each family without importing it."""
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

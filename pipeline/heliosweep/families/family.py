"""Declaration of study families, and the list of all families."""

from __future__ import annotations

import math
import pkgutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from heliosweep.errors import log
from heliosweep.families.points import (
    HELIOSTAT,
    TIME,
    Inputs,
    Points,
    count_instants,
    inner_labels,
    inner_sizes,
    swept_variables,
)
from heliosweep.grid import Parameters, Workload, bytes_of, instants_of, of_kind, shape_of, sun_attributes
from heliosweep.kernels.compiled import compilations
from heliosweep.layouts.resolve import LayoutAxis
from heliosweep.lazy import xr

if TYPE_CHECKING:
    from heliosweep.config.study import Study
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
        return cast("type[Study]", _declared(self._study))

    def example(self) -> str:
        """Return a commented example study file."""
        return self._example if isinstance(self._example, str) else self._example.read_text(encoding="utf-8")

    def computation(self, study: Any) -> Computation:
        """Return the variables of a study and the function that computes them."""
        return cast(Computation, _declared(self._computation, study))

    def workload(self, study: Any) -> Workload:
        """Return the dimension sizes and the computational cost of a study."""
        work = self.computation(study)
        parameters, inner = Parameters(study).sizes, inner_sizes(study, work)
        instants, length = inner.get(TIME) or count_instants(study, False), inner.get(work.split, 1)
        values = bytes_of({name: one for name, one in work.variables.items() if TIME not in one.dims}, inner)
        memory = work.memory() if callable(work.memory) else work.memory

        def working_bytes(points: int, part: int) -> int:
            held = memory * (points if work.arrays is not None else 1)
            # A sun vector with its intermediate values needs 200 bytes.
            fixed = 200 * instants + (work.fixed_memory() if work.fixed_memory else 0)
            return fixed + math.ceil((2 * values * points + held) * part / length)

        heliostats = inner.get(HELIOSTAT, 0)
        return Workload(
            parameters=parameters,
            inner=inner,
            evaluations=(work.evaluations() if callable(work.evaluations) else work.evaluations)
            or instants * max(1, heliostats),
            unit=work.unit,
            working_bytes=working_bytes,
            splittable=work.split,
            whole=work.whole,
            uncut=work.uncut,
            coordinate_bytes=8 * (sum(inner.values()) + 6 * heliostats),  # memory for layout columns, with a margin
            axes={"instants": instants} if TIME not in inner and instants > 1 else {},
        )

    def variables(self, study: Any) -> dict[str, Variable]:
        """Return the variables of the result, in the order of the file."""
        return swept_variables(study, self.computation(study))

    def coordinates(self, study: Any) -> xr.Dataset:
        """Return the coordinates of the whole result as a data set in memory.

        The attributes of this data set become global attributes of the result file.
        """
        work, parameters = self.computation(study), Parameters(study)
        labels: dict[str, Any] = dict(parameters.coordinates(work.labels))
        inner = inner_sizes(study, work)
        if HELIOSTAT in inner:
            labels |= (work.layouts or LayoutAxis)(study).coordinates()
        labels |= {dim: (dim, *one) for dim, one in inner_labels(work).items() if not isinstance(one, int)}
        if TIME in inner:
            labels |= instants_of(parameters).coordinates()
        sun = sun_attributes(study.time) if getattr(study, "time", None) is not None else {}
        labels |= {} if work.coordinates is None else work.coordinates()
        mode, attrs = {"mode": work.mode} if work.mode else {}, work.attrs() if callable(work.attrs) else work.attrs
        return xr.Dataset(coords=labels, attrs={**sun, **attrs, **mode})

    def prepare(self, study: Any) -> tuple[float, bool]:
        """Load or compile the kernels of a study by computing a small region of its result.

        Returns
        -------
        seconds : float
            Elapsed time. [s]
        fresh : bool
            True if a kernel was compiled.
        """
        work, began, before = self.computation(study), time.perf_counter(), compilations()
        if work.prepare is not None:
            work.prepare()
        else:
            inputs, region = self.inputs(study), {dim: slice(0, 1) for dim in Parameters(study).sizes}
            region |= {work.split: slice(0, 2)} if work.split else {}
            for kind in dict.fromkeys(one.kind for one in work.variables.values()):
                self.compute(study, inputs, {**region, TIME: slice(0, 1)} if kind == "series" else region)
        return time.perf_counter() - began, compilations() > before

    def inputs(self, study: Any) -> Any:
        """Return the contents of the input files. Each file is read once, and its contents are sent to all workers."""
        work = self.computation(study)
        of_field = any(HELIOSTAT in one.dims for one in work.variables.values())
        return Inputs((work.layouts or LayoutAxis)(study) if of_field else None, work.inputs and work.inputs())

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
        work = self.computation(study)
        sizes = {**Parameters(study).sizes, **inner_sizes(study, work, inputs)}
        wanted = of_kind(swept_variables(study, work), "series" if TIME in region else "points")
        empty: Any = {"f": np.nan, "M": np.datetime64("NaT")}
        arrays = {
            name: np.full(
                shape_of(one, region, sizes),
                empty.get(one.dtype.kind, 0) if one.missing is None else one.missing,
                one.dtype,
            )
            for name, one in wanted.items()
        }
        for point in Points(study, work, inputs, region):
            for name, value in work.function(point).items():
                if name in arrays:
                    point.put(arrays[name], wanted[name], value)
        return xr.Dataset({name: (wanted[name].dims, array) for name, array in arrays.items()})

    def finish(self, study: Any, inputs: Any, region: Region, computed: xr.Dataset) -> xr.Dataset:
        """Compute the `finished` variables of a region with complete points from the `computed` variables."""
        work = self.computation(study)
        assert work.finish is not None
        later = {name: one for name, one in swept_variables(study, work).items() if one.finished}
        values = work.finish(Points(study, work, inputs, region), computed)
        return xr.Dataset({name: (later[name].dims, array) for name, array in values.items() if name in later})

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


def _declared(declared: Any, *of: Any) -> Any:
    """Return a declared object. If a function is declared, return its value for the study or result `of`."""
    found = pkgutil.resolve_name(declared) if isinstance(declared, str) else declared
    return found(*of) if of and callable(found) else found


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

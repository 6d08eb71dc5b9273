"""Declare study families, compute the points of their results, and list all families."""

from __future__ import annotations

import math
import pkgutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import declares
from heliosweep.errors import Problem, StudyError, log
from heliosweep.grid import (
    MAX_INSTANTS,
    PLACE,
    Instants,
    Parameters,
    Region,
    Suns,
    Variable,
    Workload,
    bytes_of,
    instant_count,
    instants_of,
    of_kind,
    shape_of,
    sun_attributes,
)
from heliosweep.kernels.compiled import compilations
from heliosweep.layouts.resolve import LayoutAxis, longest
from heliosweep.lazy import xr

if TYPE_CHECKING:
    from heliosweep.config.study import Study
    from heliosweep.report.figures import Figure
    from heliosweep.report.tables import Table


#: Entry point group for families in other packages. Each entry point has the name of its family.
GROUP = "heliosweep.families"

T = TypeVar("T")


HELIOSTAT, TIME = "heliostat", "time"


@dataclass(frozen=True)
class Computation:
    """Variables of a result and the function that computes them.

    The framework allocates the arrays, calls the function for each point of a region, and adds the coordinates.
    The required memory and disk space are derived from the variables.

    Parameters
    ----------
    function : callable
        Function that takes a `heliosweep.families.family.Point` and returns a mapping of variable names to values. Each
        value has the inner dimensions of its variable. Variables that the function omits have missing values. Values
        must not depend on the region in which they are computed.
    variables : mapping of str to Variable
        Variables with their inner dimensions. The framework prepends the swept dimensions.
    labels : tuple of str
        Keys that label the result even if they are not swept.
    dims : mapping of str to int or (array, mapping)
        Length of each inner dimension, or a pair of its labels and their CF attributes. An entry may also be a function
        that takes the return value of `inputs` and returns the length or the pair. The study's ``time`` and ``layout``
        blocks determine the dimensions ``time`` and ``heliostat``.
    coordinates : callable, optional
        Function without arguments that returns additional coordinates as a mapping that `xarray.Dataset` accepts.
    attrs : mapping or callable
        Additional attributes of the result, or a function without arguments that returns them.
    inputs : callable, optional
        Function without arguments that reads files. The return value is available as `Point.inputs`.
    layouts : callable, optional
        Function that takes the study and returns its layouts (default: `LayoutAxis`).
    finish : callable, optional
        Function that takes the points of a region and a data set of their values, and returns the `finished` variables.
    arrays : tuple of str, optional
        Keys that have a single value in each call of the function. If `arrays` is given, each call computes many
        points, and the values of other swept keys are arrays with one axis for each swept dimension. All points of a
        call share one site and one layout.
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
        Plural noun that the plan uses for evaluations, such as ``spots``.
    memory : int or callable
        Memory needed for one point in addition to the variables, or a function without arguments that returns it.
        [bytes]
    fixed_memory : callable, optional
        Function without arguments that returns the memory needed regardless of how a point is split. [bytes]
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


class Inputs(NamedTuple):
    """Layouts of a study and contents of its input files."""

    #: `LayoutAxis` of the study, or None if the study has no layout.
    layouts: Any
    #: Return value of `Computation.inputs`, or None.
    files: Any


class Points:
    """Points in a region of a result, with the key values at each point."""

    def __init__(self, study: Any, work: Computation, inputs: Inputs, region: Region) -> None:
        self.study, self.work, self.inputs, self.region = study, work, inputs, region
        self.parameters = Parameters(study, region)
        self.sizes = self.parameters.sizes
        self._once: dict[str, Any] = {}
        self._columns: dict[str, tuple[tuple[str, ...], np.ndarray | None]] = {}

    def once(self, name: str, make: Callable[[], T]) -> T:
        """Return an object that all points of the region share. The first call creates it with `make`."""
        if name not in self._once:
            self._once[name] = make()
        return cast("T", self._once[name])

    def column(self, key: str) -> tuple[tuple[str, ...], np.ndarray | None]:
        """Return the swept dimensions of a key, and its values over all swept dimensions (None if unset)."""
        if key not in self._columns:
            if not key.startswith(("site.", "time.")) and not declares(type(self.study), key):
                raise StudyError(Problem("is not a key of the study's model", key))
            dims = self.parameters.column(key)[0] if self.parameters.has(key) else ()
            self._columns[key] = dims, self.parameters.values(key)
        return self._columns[key]

    def __iter__(self) -> Iterator[Point]:
        """Yield each point, or each group of points that is computed in one call."""
        apart = set(self.sizes)
        if (keys := self.work.arrays) is not None:
            apart = {dim for key in keys for dim in self.column(key)[0]} | set(self.parameters.site_dims)
            apart |= set(self.inputs.layouts.dims) if self.inputs.layouts else set()
        for index in np.ndindex(*(size if dim in apart else 1 for dim, size in self.sizes.items())):
            yield Point(self, index, tuple(
                slice(at, at + 1) if dim in apart else slice(None) for dim, at in zip(self.sizes, index, strict=True)
            ))  # fmt: skip


class Point:
    """Point of the parameter grid, or group of points computed in one call.

    ``point[key]`` is the value of a dotted key of the study: a number or a string, or None if the key has no value. If
    a key varies within a group, its value is an array with one axis for each swept dimension.
    """

    def __init__(self, points: Points, index: tuple[int, ...], spans: tuple[slice, ...]) -> None:
        self.points, self.index, self.spans = points, index, spans
        self.study, self.inputs = points.study, points.inputs.files

    def __getitem__(self, key: str) -> Any:
        dims, values = self.points.column(key)
        if values is None:
            return None
        varies = any(
            dim in dims and span == slice(None) for dim, span in zip(self.points.sizes, self.spans, strict=True)
        )
        return values[self.spans] if varies else values[self.index]

    @property
    def group(self) -> tuple[int, ...]:
        """Number of points along each swept dimension; empty if the computation has no `arrays`."""
        if self.points.work.arrays is None:
            return ()
        return tuple(len(range(size)[span]) for size, span in zip(self.points.sizes.values(), self.spans, strict=True))

    @property
    def sun(self) -> np.ndarray:
        """Unit vectors to the sun at the instants, shape (time, 3): east, north, up. [1]"""
        suns = self.points.once("sun", lambda: Suns(self.points.parameters))
        columns = (self.points.column(key)[1] for key in PLACE)
        return suns.at(self.index, [None if one is None else one[self.index] for one in columns])

    @property
    def all_instants(self) -> Instants:
        """All instants at the site of the point, including instants outside the region."""
        instants, here = instants_of(self.points.parameters), dict(zip(self.points.sizes, self.index, strict=True))
        return instants.isel({instants.dim: here.get(instants.dim, 0)})

    @property
    def timezone(self) -> str:
        """Time zone of the site at this point."""
        return self.points.parameters.timezones()[dict(zip(self.points.sizes, self.index, strict=True)).get("site", 0)]

    @property
    def position(self) -> dict[str, int]:
        """Index of the point in the whole result along each swept dimension."""
        return self.points.parameters.position(self.index)

    @property
    def layout(self) -> Any:
        """Layout of the field at this point."""
        return self.points.inputs.layouts.at(self.position)

    def part(self, dim: str) -> slice:
        """Return the slice to compute along `dim`, which is ``time`` or the inner dimension that is split."""
        return self.points.region.get(dim, slice(None))

    def put(self, array: np.ndarray, variable: Variable, value: Any) -> None:
        """Write the values of a variable at the point or group to `array`."""
        kept = [dim in variable.dims for dim in self.points.sizes]
        spans: tuple[Any, ...] = tuple(span for span, keep in zip(self.spans, kept, strict=True) if keep)
        target = array[(*spans, ...)]  # the ellipsis makes the result an array even for a single value
        outer, inner = target.shape[: sum(kept)], target.shape[sum(kept) :]
        value = np.asarray(value)
        own = value.shape[value.ndim - len(inner) :]  # if a layout has fewer heliostats, the last values remain missing
        if self.group:
            value = np.broadcast_to(value, (*self.group, *own))[tuple(slice(None) if keep else 0 for keep in kept)]
        within: tuple[Any, ...] = (*(slice(None),) * len(outer), *(slice(length) for length in own), ...)
        target[within] = value


def swept_variables(study: Any, work: Computation) -> dict[str, Variable]:
    """Return the declared variables with the swept dimensions prepended."""
    swept = Parameters(study).sizes
    return {
        name: replace(one, dims=(*(dim for dim in swept if dim not in one.without), *one.dims))
        for name, one in work.variables.items()
    }


def count_instants(study: Any, stored: bool) -> int:
    """Return the number of instants in a study; 1 if the study has no `time` block.

    If `stored` is True and there are at most `MAX_INSTANTS` instants, return the length of the result's dimension
    ``time``.
    """
    if getattr(study, "time", None) is None:
        return 1
    count = instant_count(study.time)
    return instants_of(Parameters(study)).size if stored and count <= MAX_INSTANTS else count


def inner_labels(work: Computation, given: Inputs | None = None) -> Mapping[str, Any]:
    """Return the lengths or labels of the declared dimensions.

    If `given` is None and the dimensions depend on input files, the files are read.
    """
    if not any(callable(one) for one in work.dims.values()):
        return work.dims
    files = given.files if given else work.inputs and work.inputs()
    return {dim: one(files) if callable(one) else one for dim, one in work.dims.items()}


def inner_sizes(study: Any, work: Computation, given: Inputs | None = None) -> dict[str, int]:
    """Return the lengths of the inner dimensions. If `given` is None, the study's layouts and files are read."""
    used = {dim for one in work.variables.values() for dim in one.dims}
    inner = {TIME: count_instants(study, True)} if TIME in used else {}
    if HELIOSTAT in used:
        layouts = (given and given.layouts) or (work.layouts and work.layouts(study))
        inner[HELIOSTAT] = layouts.size if layouts else longest(study)
    return inner | {dim: one if isinstance(one, int) else len(one[0]) for dim, one in inner_labels(work, given).items()}


def by_axis(name: str, values: NDArray[Any], axis: int = 2, ends: Iterable[str] = "xy") -> dict[str, NDArray[Any]]:
    """Split an array along an axis into one variable for each entry of `ends`. Entries replace ``%`` in `name`."""
    return {name.replace("%", end): one for end, one in zip(ends, np.moveaxis(values, axis, 0), strict=True)}


class Family:
    """Kind of study, declared by a folder in this package or by an entry point of another package.

    A declaration may use the string ``"package.module:name"`` instead of an object. The module is then imported only
    when it is needed, which keeps listing families and validating studies fast.

    Parameters
    ----------
    name, title : str
        Name used in study files, and a one-line title that names the computed quantity.
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
    first_headlines : callable or str, optional
        Function that takes a result and returns variables that precede the headlines in the report.
    optional : mapping of str to str
        Mapping of optional variables to the keys that enable them. Messages suggest these keys.
    figures, tables : sequence, callable or str, optional
        Declared figures and tables, or functions that take the result and return them. If they are omitted, the report
        draws and tabulates the variables along their common dimensions.
    figures_of_draws : sequence, callable or str, optional
        Declared figures of a result with draws, in addition to the figures common to all families.
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
        first_headlines: Any = None,
        optional: Mapping[str, str] | None = None,
        figures: Any = None,
        tables: Any = None,
        figures_of_draws: Any = None,
        remarks: Any = None,
        answers: Any = None,
    ) -> None:
        self.name, self.title = name, title
        self.references, self.keywords, self.headlines = references, keywords, headlines
        self.optional = dict(optional or {})
        self._study, self._computation, self._example = study, computation, example
        self._figures, self._tables, self._remarks, self._answers = figures, tables, remarks, answers
        self._first_headlines, self._figures_of_draws = first_headlines, figures_of_draws

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
            coordinate_bytes=8 * (sum(inner.values()) + 6 * heliostats),  # includes the layout columns, with a margin
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
            Return value of `inputs`. This method does not read files.
        region : Region
            Slices of the swept dimensions and of the dimension that may be split. Other dimensions are complete.

        Returns
        -------
        xarray.Dataset
            Variables that are not `finished`. If the region contains the ``time`` dimension, the data set contains
            the variables with this dimension; otherwise, it contains the variables without ``time``. Values do not
            depend on the region in which they are computed.
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
        """Compute the `finished` variables of a region with complete points from its `computed` variables."""
        work = self.computation(study)
        assert work.finish is not None
        later = {name: one for name, one in swept_variables(study, work).items() if one.finished}
        values = work.finish(Points(study, work, inputs, region), computed)
        return xr.Dataset({name: (later[name].dims, array) for name, array in values.items() if name in later})

    def of_result(self, result: xr.Dataset) -> Family:
        """Return a copy of the family with the headlines for a result."""
        made = object.__new__(type(self))  # copy.copy would return the registered family itself
        first = _declared(self._first_headlines, result) or ()
        vars(made).update(vars(self), headlines=(*first, *self.headlines))
        return made

    def answers(self, result: xr.Dataset) -> Iterable[str]:
        """Return the lines with the main results that are printed at the end of a run."""
        return _declared(self._answers, result) or ()

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """Return warnings about a finished result."""
        return _declared(self._remarks, result) or ()

    def figures_of_draws(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the declared figures of a result with draws."""
        return _declared(self._figures_of_draws, result) or ()

    def figures(self, result: xr.Dataset) -> Iterable[Figure]:
        """Return the declared figures of a result, or default figures if the family declares none."""
        return _declared(self._figures or "heliosweep.report.figures:default_figures", result)

    def tables(self, result: xr.Dataset) -> Iterable[Table]:
        """Return the declared tables of a result; empty if the family declares none."""
        return _declared(self._tables, result) or ()


def _named(name: str) -> Family:
    return families()[name]


def _declared(declared: Any, *of: Any) -> Any:
    """Return a declared object. If a function is declared, call it with the study or result `of`."""
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
        """Yield the names of all families that load without errors."""
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
        model.model_rebuild()  # pydantic builds blocks on first use; errors in blocks must be raised here
        return model

    return Found(_entries(), built)


@cache
def _entries() -> dict[str, metadata.EntryPoint]:
    """Return the entry point of each family without importing the family."""
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

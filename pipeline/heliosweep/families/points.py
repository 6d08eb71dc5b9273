"""Compute the results of a family from its declarations: allocate arrays, loop over points, and add coordinates."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from heliosweep.config import declares
from heliosweep.errors import Problem, StudyError
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
    from heliosweep.families.family import Computation, T

HELIOSTAT, TIME = "heliostat", "time"


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
        """Return an object that all points of the region share. The first call creates the object with `make`."""
        if name not in self._once:
            self._once[name] = make()
        return cast("T", self._once[name])

    def column(self, key: str) -> tuple[tuple[str, ...], np.ndarray | None]:
        """Return the dimensions along which a key varies, and its values over all swept dimensions (None if unset)."""
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
        return instants.at_sites(here[instants.dim]) if instants.dim in here else instants

    @property
    def instants(self) -> Instants:
        """Instants in the region, at the site of the point."""
        return self.all_instants.part(self.points.parameters.part(TIME))

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


def variables(study: Any, work: Computation) -> dict[str, Variable]:
    """Return the declared variables with the swept dimensions prepended."""
    swept = Parameters(study).sizes
    return {
        name: replace(one, dims=(*(dim for dim in swept if dim not in one.without), *one.dims))
        for name, one in work.variables.items()
    }


def _instants(study: Any, stored: bool) -> int:
    """Return the number of instants in a study; 1 if the study has no `time` block."""
    if getattr(study, "time", None) is None:
        return 1
    count = instant_count(study.time)
    return instants_of(Parameters(study)).size if stored and count <= MAX_INSTANTS else count


def _dims(work: Computation, given: Inputs | None = None) -> Mapping[str, Any]:
    """Return the lengths or labels of the declared dimensions.

    If `given` is None and the dimensions depend on input files, the files are read.
    """
    if not any(callable(one) for one in work.dims.values()):
        return work.dims
    files = given.files if given else work.inputs and work.inputs()
    return {dim: one(files) if callable(one) else one for dim, one in work.dims.items()}


def _inner(study: Any, work: Computation, given: Inputs | None = None) -> dict[str, int]:
    """Return the lengths of the inner dimensions. If `given` is None, the study's layouts and files are read."""
    used = {dim for one in work.variables.values() for dim in one.dims}
    inner = {TIME: _instants(study, True)} if TIME in used else {}
    if HELIOSTAT in used:
        layouts = (given and given.layouts) or (work.layouts and work.layouts(study))
        inner[HELIOSTAT] = layouts.size if layouts else longest(study)
    return inner | {dim: one if isinstance(one, int) else len(one[0]) for dim, one in _dims(work, given).items()}


def workload(study: Any, work: Computation) -> Workload:
    """Return the dimension sizes, the number of evaluations and the memory use of a study."""
    parameters, inner = Parameters(study).sizes, _inner(study, work)
    instants, length = inner.get(TIME) or _instants(study, False), inner.get(work.split, 1)
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


def coordinates(study: Any, work: Computation) -> xr.Dataset:
    """Return the coordinates: swept keys, keys in `Computation.labels`, and labels of the inner dimensions."""
    parameters, inner = Parameters(study), _inner(study, work)
    labels: dict[str, Any] = dict(parameters.coordinates(work.labels))
    if HELIOSTAT in inner:
        labels |= (work.layouts or LayoutAxis)(study).coordinates()
    labels |= {dim: (dim, *one) for dim, one in _dims(work).items() if not isinstance(one, int)}
    if TIME in inner:
        labels |= instants_of(parameters).coordinates()
    sun = sun_attributes(study.time) if getattr(study, "time", None) is not None else {}
    labels |= {} if work.coordinates is None else work.coordinates()
    mode, attrs = {"mode": work.mode} if work.mode else {}, work.attrs() if callable(work.attrs) else work.attrs
    return xr.Dataset(coords=labels, attrs={**sun, **attrs, **mode})


def inputs(study: Any, work: Computation) -> Inputs:
    """Read the layouts and the input files of a study."""
    of_field = any(HELIOSTAT in one.dims for one in work.variables.values())
    return Inputs((work.layouts or LayoutAxis)(study) if of_field else None, work.inputs and work.inputs())


def compute(study: Any, work: Computation, given: Inputs, region: Region) -> xr.Dataset:
    """Compute the points of a region and return their values as labelled arrays."""
    points, sizes = Points(study, work, given, region), {**Parameters(study).sizes, **_inner(study, work, given)}
    wanted = of_kind(variables(study, work), "series" if TIME in region else "points")
    empty: Any = {"f": np.nan, "M": np.datetime64("NaT")}
    arrays = {
        name: np.full(
            shape_of(one, region, sizes),
            empty.get(one.dtype.kind, 0) if one.missing is None else one.missing,
            one.dtype,
        )
        for name, one in wanted.items()
    }
    for point in points:
        for name, value in work.function(point).items():
            if name in arrays:
                _put(arrays[name], wanted[name], value, point)
    return xr.Dataset({name: (wanted[name].dims, array) for name, array in arrays.items()})


def _put(array: np.ndarray, variable: Variable, value: Any, point: Point) -> None:
    """Write the values of a variable at a point, or at the points of a group, to `array`."""
    kept = [dim in variable.dims for dim in point.points.sizes]
    spans: tuple[Any, ...] = tuple(span for span, keep in zip(point.spans, kept, strict=True) if keep)
    target = array[(*spans, ...)]  # with the ellipsis, a single value is also an array
    outer, inner = target.shape[: sum(kept)], target.shape[sum(kept) :]
    value = np.asarray(value)
    own = value.shape[value.ndim - len(inner) :]  # if a layout has fewer heliostats, the last values remain missing
    if point.group:
        value = np.broadcast_to(value, (*point.group, *own))[tuple(slice(None) if keep else 0 for keep in kept)]
    within: tuple[Any, ...] = (*(slice(None),) * len(outer), *(slice(length) for length in own), ...)
    target[within] = value


def finish(study: Any, work: Computation, given: Inputs, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Return the `finished` variables of a region."""
    assert work.finish is not None
    later = {name: one for name, one in variables(study, work).items() if one.finished}
    values = work.finish(Points(study, work, given, region), computed)
    return xr.Dataset({name: (later[name].dims, array) for name, array in values.items() if name in later})


def prepare(study: Any, work: Computation) -> tuple[float, bool]:
    """Compute a small region. Return the elapsed time [s], and True if a kernel was compiled."""
    began, before = time.perf_counter(), compilations()
    if work.prepare is not None:
        work.prepare()
    else:
        given, region = inputs(study, work), {dim: slice(0, 1) for dim in Parameters(study).sizes}
        region |= {work.split: slice(0, 2)} if work.split else {}
        for kind in dict.fromkeys(one.kind for one in work.variables.values()):
            compute(study, work, given, {**region, TIME: slice(0, 1)} if kind == "series" else region)
    return time.perf_counter() - began, compilations() > before

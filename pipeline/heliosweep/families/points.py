"""Compute the results of a family from its declarations: allocate arrays, loop over points, and add coordinates."""

from __future__ import annotations

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
    instant_count,
    instants_of,
)
from heliosweep.layouts.resolve import longest

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
        return instants.isel({instants.dim: here.get(instants.dim, 0)})

    @property
    def instants(self) -> Instants:
        """Instants in the region, at the site of the point."""
        return self.all_instants.isel({TIME: self.points.parameters.part(TIME)})

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
        """Write the values of a variable at the point, or at the points of the group, to `array`."""
        kept = [dim in variable.dims for dim in self.points.sizes]
        spans: tuple[Any, ...] = tuple(span for span, keep in zip(self.spans, kept, strict=True) if keep)
        target = array[(*spans, ...)]  # with the ellipsis, a single value is also an array
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
    """Return the number of instants in a study; 1 if the study has no `time` block."""
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

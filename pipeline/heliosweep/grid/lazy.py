"""The lazy face of a study: one dask task for each part, one for each slab that is finished from its parts."""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.sites import with_sites
from heliosweep.config.weather_files import with_weather
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import (
    PASS_BYTES,
    Part,
    Region,
    Variable,
    bytes_of,
    checked,
    in_result,
    index_of,
    of_kind,
    parts_by_slab,
    shape_of,
)

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study


class Work:
    """All that computing a region of a study takes; small enough to be sent to other processes once.

    Made from the family of the study, and the variables and dimensions of its result. `inputs` is what is read from
    files, `module` the one that the numbers come from.
    """

    def __init__(self, family: Any, study: Study, variables: Mapping[str, Variable], sizes: Mapping[str, int]) -> None:
        self.family, self.variables, self.sizes = family, dict(variables), dict(sizes)
        self.study = with_weather(with_sites(study))
        self.inputs = family.inputs(study)
        self.module = family.numbers_from(study)

    def compute(self, part: Part) -> dict[str, np.ndarray]:
        """Values of the variables of a part, by name."""
        made = self.family.compute(self.study, self.inputs, part.region)
        return checked(made, of_kind(self.variables, part.kind), part.region, self.sizes)

    def finish(self, slab: Part, parts: Callable[[], Iterable[tuple[Part, Mapping[str, np.ndarray]]]]) -> xr.Dataset:
        """All variables of a slab in the order of the file, from those of its parts, as often as `parts` is called."""
        import xarray as xr

        named = {name: one for name, one in in_result(self.variables).items() if one.kind == slab.kind}
        later = {name: one for name, one in named.items() if one.finished}
        whole = of_kind(self.variables, slab.kind)
        kept = {name: slab.region for name, one in whole.items() if not one.passing}
        computed = xr.Dataset(self._joined(parts(), kept))
        if not later:
            return computed[list(named)]
        made = dict(self.family.finish(self.study, self.inputs, slab.region, computed).data_vars)
        for regions in self._passes(slab, whole):
            for name, given in self._joined(parts(), regions).items():
                some = self.family.finish(self.study, self.inputs, slab.region, xr.Dataset({name: given}))
                for key, array in some.data_vars.items():
                    one = later[str(key)]
                    if key not in made:
                        made[key] = xr.DataArray(
                            np.empty(shape_of(one, slab.region, self.sizes), one.dtype), dims=one.dims
                        )
                    made[key].values[index_of(one.dims, regions[name], slab.region)] = array.to_numpy()
        arrays = checked(xr.Dataset(made), later, slab.region, self.sizes)
        return computed.assign({name: (later[name].dims, array) for name, array in arrays.items()})[list(named)]

    def _passes(self, slab: Part, whole: Mapping[str, Variable]) -> Iterator[dict[str, Region]]:
        """Regions of the passing variables that are held at a time, each cut along its longest inner dimension."""
        together: dict[str, Region] = {}
        held = 0
        for name, variable in whole.items():
            if not variable.passing:
                continue
            inner = [dim for dim in variable.dims if dim not in slab.region]
            dim = max(inner, key=self.sizes.__getitem__, default="")
            shape = dict(zip(variable.dims, shape_of(variable, slab.region, self.sizes), strict=True))
            each = bytes_of({name: variable}, {**shape, dim: 1})
            length = max(1, min(PASS_BYTES // each, shape.get(dim, 1)))
            for start in range(0, shape.get(dim, 1), length):
                stop = min(start + length, shape.get(dim, 1))
                if name in together or (held and held + each * (stop - start) > PASS_BYTES):
                    yield together
                    together, held = {}, 0
                together[name] = {**slab.region, **({dim: slice(start, stop)} if dim else {})}
                held += each * (stop - start)
        if together:
            yield together

    def _joined(
        self, parts: Iterable[tuple[Part, Mapping[str, np.ndarray]]], regions: Mapping[str, Region]
    ) -> dict[str, xr.Variable]:
        """Values of variables over regions of them, put together from parts of a slab."""
        import xarray as xr

        named = {name: self.variables[name] for name in regions}
        whole = {name: np.empty(shape_of(one, regions[name], self.sizes), one.dtype) for name, one in named.items()}
        for part, values in parts:
            for name, variable in named.items():
                extra = {dim: span for dim, span in regions[name].items() if dim not in part.region}
                within = index_of(variable.dims, part.region, regions[name])
                whole[name][within] = values[name][index_of(variable.dims, extra)]
        return {name: xr.Variable(variable.dims, whole[name]) for name, variable in named.items()}


def build(work: Work, plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """Lazy result of a study: each variable a dask array, a chunk for each slab of the plan.

    `coordinates` are those of the whole result; their attributes become those of the result.
    """
    import dask.array as da
    import xarray as xr
    from dask.core import literal
    from dask.highlevelgraph import HighLevelGraph

    token = uuid.uuid4().hex
    shared, computed, finished = (f"{name}-{token}" for name in ("study", "part", "slab"))
    graph: dict[Any, Any] = {shared: (literal(work),)}
    keys: dict[str, dict[tuple[int, ...], str]] = {}
    for slab, parts in parts_by_slab(plan.cuts):
        known = list(parts)
        for part in known:
            graph[f"{computed}-{part.name}"] = (Work.compute, shared, part)
        key = f"{finished}-{slab.name}"
        graph[key] = (_finish, shared, slab, known, [f"{computed}-{part.name}" for part in known])
        place = tuple(slab.region[dim].start // plan.cuts[slab.kind].slab[dim] for dim in slab.region)
        keys.setdefault(slab.kind, {})[place] = key
    layer = HighLevelGraph.from_collections(finished, graph)
    arrays = {}
    for name, variable in in_result(work.variables).items():
        cut = plan.cuts[variable.kind]
        lengths = [_lengths(work.sizes[dim], cut.slab.get(dim, work.sizes[dim])) for dim in variable.dims]
        label = f"{name}-{token}"
        takes: dict[Any, Any] = {}
        for place in itertools.product(*(range(len(each)) for each in lengths)):
            at = dict(zip(variable.dims, place, strict=True))
            key = keys[variable.kind][tuple(at.get(dim, 0) for dim in cut.sizes)]
            takes[(label, *place)] = (_take, key, name)
        layers = HighLevelGraph({**layer.layers, label: takes}, {**layer.dependencies, label: {finished}})
        data = da.Array(layers, label, tuple(lengths), dtype=variable.dtype)
        arrays[name] = xr.DataArray(data, dims=variable.dims, attrs=dict(variable.attrs))
    return xr.Dataset(arrays).assign_coords(coordinates.coords).assign_attrs(coordinates.attrs)


def without_values(plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """All of a result but its values, each of which is a zero: what is known before anything is computed."""
    import xarray as xr

    sizes = plan.workload.sizes
    zeros = {
        name: (one.dims, np.broadcast_to(np.zeros((), one.dtype), shape_of(one, {}, sizes)), dict(one.attrs))
        for name, one in plan.variables.items()
    }
    return xr.Dataset(zeros).assign_coords(coordinates.coords)


def _lengths(size: int, length: int) -> tuple[int, ...]:
    whole, rest = divmod(size, max(1, length))
    return (length,) * whole + ((rest,) if rest else ())


def _finish(work: Work, slab: Part, parts: list[Part], values: list[dict[str, np.ndarray]]) -> xr.Dataset:
    return work.finish(slab, lambda: zip(parts, values, strict=True))


def _take(slab: xr.Dataset, name: str) -> np.ndarray:
    return slab[name].to_numpy()

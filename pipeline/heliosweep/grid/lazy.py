"""Computation of a study: regions of its result, and the whole result as a lazy data set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.sites import with_sites
from heliosweep.config.weather_files import with_weather
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import (
    PASS_BYTES,
    Cut,
    Part,
    Region,
    Variable,
    bytes_of,
    checked,
    in_result,
    index_of,
    of_kind,
    shape_of,
)

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study


class Work:
    """Study with everything that is needed to compute a region of its result; it is sent to each worker once.

    Parameters
    ----------
    family : Family
        Family of the study.
    study : Study
        The study.
    variables : mapping of str to Variable
        Variables of the result.
    sizes : mapping of str to int
        Dimensions of the result.
    """

    def __init__(self, family: Any, study: Study, variables: Mapping[str, Variable], sizes: Mapping[str, int]) -> None:
        self.family, self.variables, self.sizes = family, dict(variables), dict(sizes)
        self.study = with_weather(with_sites(study))
        self.inputs = family.inputs(study)

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


#: Maximum number of blocks of a lazy result that hold a single parameter point each.
MOST_BLOCKS = 1000


def build(work: Work, plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """Return the result of a study as a lazy data set; each block holds one parameter point, or several small ones.

    `coordinates` are those of the whole result.
    """
    import xarray as xr

    lazy = [_mapped(work, kind, cut, plan) for kind, cut in plan.cuts.items()]
    return xr.merge(lazy)[list(in_result(work.variables))].assign_coords(coordinates.coords)


def _mapped(work: Work, kind: str, cut: Cut, plan: Plan) -> xr.Dataset:
    """Variables of one kind, by `xarray.map_blocks` over the positions in the swept dimensions."""
    import dask.array as da
    import xarray as xr

    sizes = plan.workload.sizes
    inner = cut.sizes.keys() - plan.workload.parameters.keys() if kind == "series" else set()
    free = [dim for dim in plan.workload.parameters if dim not in plan.workload.whole]
    single = math.prod(sizes[dim] for dim in free) <= MOST_BLOCKS
    chunks = {dim: 1 if single else cut.part[dim] for dim in free} | {dim: sizes[dim] for dim in plan.workload.whole}
    chunks = {dim: chunks.get(dim, cut.slab[dim]) for dim in cut.sizes if dim in chunks or dim in inner} or {_POINT: 1}
    positions = {dim: np.arange(sizes.get(dim, 1)) for dim in chunks}
    index = xr.Dataset({f"position in {dim}": (dim, array) for dim, array in positions.items()}).chunk(chunks)
    template = {}
    for name, one in in_result(work.variables).items():
        if one.kind == kind:
            shape, lengths = shape_of(one, {}, sizes), [chunks.get(dim, sizes[dim]) for dim in one.dims]
            dims, zeros = one.dims, da.zeros(shape, dtype=one.dtype, chunks=lengths)
            if _POINT in chunks:
                dims, zeros = (_POINT, *dims), zeros[np.newaxis]
            template[name] = (dims, zeros, dict(one.attrs))
    mapped = xr.map_blocks(_block, index, kwargs={"work": work, "kind": kind}, template=xr.Dataset(template))
    return mapped.isel({_POINT: 0}) if _POINT in chunks else mapped


#: Dimension of the only block of a study without swept dimensions.
_POINT = "point"


def _block(index: xr.Dataset, work: Work, kind: str) -> xr.Dataset:
    """Variables of the block at some positions."""
    spans = {str(array.dims[0]): array.to_numpy() for array in index.data_vars.values()}
    region = {dim: slice(int(at[0]), int(at[-1]) + 1) for dim, at in spans.items() if dim != _POINT}
    part = Part("block", kind, region)
    values = [(part, work.compute(part))]
    block = work.finish(part, lambda: values)
    return block.expand_dims(_POINT) if _POINT in spans else block


def without_values(plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """Return the result with zeros in place of its values."""
    import xarray as xr

    sizes = plan.workload.sizes
    zeros = {
        name: (one.dims, np.broadcast_to(np.zeros((), one.dtype), shape_of(one, {}, sizes)), dict(one.attrs))
        for name, one in plan.variables.items()
    }
    return xr.Dataset(zeros).assign_coords(coordinates.coords)

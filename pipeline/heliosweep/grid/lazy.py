"""Computation of a study: regions of its result, and the whole result as a lazy data set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from heliosweep.config.sites import with_sites
from heliosweep.config.weather_files import with_weather
from heliosweep.grid.plan import PASS_BYTES, Plan
from heliosweep.grid.regions import (
    Cut,
    Piece,
    Region,
    Variable,
    bytes_of,
    checked,
    in_result,
    index_of,
    of_kind,
    regions,
    shape_of,
)

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study

Chunks: TypeAlias = Iterable[tuple[Piece, Mapping[str, np.ndarray]]]
"""Chunks with the values of their variables."""


class Work:
    """Study with everything that is needed to compute a region of its result; sent to each worker once.

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

    def compute(self, chunk: Piece) -> dict[str, np.ndarray]:
        """Return the values of the variables of a chunk, by name."""
        made = self.family.compute(self.study, self.inputs, chunk.region)
        return checked(made, of_kind(self.variables, chunk.kind), chunk.region, self.sizes)

    def finish(self, block: Piece, chunks: Callable[[list[str]], Chunks]) -> xr.Dataset:
        """Return all variables of a block in the order of the file.

        Parameters
        ----------
        block : Piece
            The block.
        chunks : callable
            Function of names of variables that returns the chunks with their values; called once for the variables of
            the result, and once for each group of passing variables.
        """
        import xarray as xr

        own = {name: one for name, one in self.variables.items() if one.kind == block.kind}
        later = {name: one for name, one in own.items() if one.finished}
        computed = of_kind(self.variables, block.kind)
        made: dict[str, np.ndarray] = {}
        for names, region in self._groups(computed, block):
            joined = self._joined(chunks(names), {name: computed[name] for name in names}, region)
            made |= {name: array for name, array in joined.items() if not computed[name].passing}
            if not later:
                break
            some = xr.Dataset({name: (computed[name].dims, array) for name, array in joined.items()})
            finished = self.family.finish(self.study, self.inputs, block.region, some)
            for name, one in later.items():
                if name in finished:
                    if name not in made:
                        made[name] = np.empty(shape_of(one, block.region, self.sizes), one.dtype)
                    array = finished[name].transpose(*one.dims).values
                    made[name][index_of(one.dims, region, block.region)] = array
        if missing := later.keys() - made.keys():
            raise ValueError(f"the family did not compute {', '.join(sorted(missing))}")
        return xr.Dataset({name: (one.dims, made[name]) for name, one in in_result(own).items()})

    def _groups(self, computed: Mapping[str, Variable], block: Piece) -> Iterator[tuple[list[str], Region]]:
        """Yield variables that are finished together and their region.

        Passing variables are finished in groups of bounded size, large ones in pieces along their longest inner
        dimension.
        """
        yield [name for name, one in computed.items() if not one.passing], block.region
        group, held = list[str](), 0
        for name, one in computed.items():
            if one.passing:
                shape = dict(zip(one.dims, shape_of(one, block.region, self.sizes), strict=True))
                if (size := bytes_of({name: one}, shape)) <= PASS_BYTES:
                    if held + size > PASS_BYTES:
                        yield group, block.region
                        group, held = [], 0
                    group, held = [*group, name], held + size
                    continue
                inner = {dim: size for dim, size in shape.items() if dim not in block.region} or {"": 1}
                dim = max(inner, key=inner.__getitem__)
                length = max(1, PASS_BYTES * inner[dim] // size)
                for piece in regions({dim: slice(0, inner[dim])}, {dim: length}):
                    yield [name], {**block.region, **piece}
        if group:
            yield group, block.region

    def _joined(self, chunks: Chunks, variables: Mapping[str, Variable], region: Region) -> dict[str, np.ndarray]:
        """Return values of variables over a region of a block, joined from its chunks."""
        whole = {name: np.empty(shape_of(one, region, self.sizes), one.dtype) for name, one in variables.items()}
        for chunk, values in chunks:
            inner = {dim: span for dim, span in region.items() if dim not in chunk.region}
            for name, one in variables.items():
                within = index_of(one.dims, chunk.region, region)
                whole[name][within] = values[name][index_of(one.dims, inner)]
        return whole


#: Maximum number of chunks of a lazy result with one parameter point each.
SINGLE_CHUNKS = 1000


def build(work: Work, plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """Return the result of a study as a lazy data set; each chunk has one parameter point, or several small ones."""
    import xarray as xr

    lazy = [_mapped(work, kind, cut, plan) for kind, cut in plan.cuts.items()]
    return xr.merge(lazy)[list(in_result(work.variables))].assign_coords(coordinates.coords)


def _mapped(work: Work, kind: str, cut: Cut, plan: Plan) -> xr.Dataset:
    """Return the variables of one kind, by `xarray.map_blocks` over the positions in the swept dimensions."""
    import dask.array as da
    import xarray as xr

    load, sizes = plan.workload, plan.workload.sizes
    free = [dim for dim in load.parameters if dim not in load.whole]
    single = math.prod(sizes[dim] for dim in free) <= SINGLE_CHUNKS
    chunks = {dim: 1 if single else cut.chunk[dim] for dim in free} | {dim: sizes[dim] for dim in load.whole}
    chunks |= {dim: cut.block[dim] for dim in cut.sizes if kind == "series" and dim not in load.parameters}
    chunks = {_POINT: 1} | {dim: chunks[dim] for dim in cut.sizes if dim in chunks}
    index = {f"position in {dim}": (dim, np.arange(sizes.get(dim, 1))) for dim in chunks}
    template = {}
    for name, one in in_result(work.variables).items():
        if one.kind == kind:
            lengths = [1, *(chunks.get(dim, sizes[dim]) for dim in one.dims)]
            zeros = da.zeros((1, *shape_of(one, {}, sizes)), dtype=one.dtype, chunks=lengths)
            template[name] = ((_POINT, *one.dims), zeros, dict(one.attrs))
    arguments = {"work": work, "kind": kind}
    mapped = xr.map_blocks(_block, xr.Dataset(index).chunk(chunks), kwargs=arguments, template=xr.Dataset(template))
    return mapped.isel({_POINT: 0})


#: Dimension of length 1 of the chunks: a study may have no swept dimensions.
_POINT = "point"


def _block(index: xr.Dataset, work: Work, kind: str) -> xr.Dataset:
    """Return the variables of a chunk at some positions."""
    spans = {str(array.dims[0]): array.values for array in index.data_vars.values()}
    region = {dim: slice(int(at[0]), int(at[-1]) + 1) for dim, at in spans.items() if dim != _POINT}
    piece = Piece("lazy", kind, region)
    values = [(piece, work.compute(piece))]
    return work.finish(piece, lambda _: values).expand_dims(_POINT)

"""Raw results are read in the order of their values, and cut as the run that made them was."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heliosweep.errors import HeliosweepError
from heliosweep.store import raw as raw_results
from heliosweep.store.raw import Raw, RawVariable, locate, open_raw, stored_parts
from tests.store.samples import CUT, SIZES, VARIABLES, parts, write_folder, write_netcdf, write_zarr

ROOM = 40


@given(
    st.lists(st.tuples(st.integers(1, 25), st.integers(1, 25)), min_size=0, max_size=4).filter(
        lambda axes: math.prod(size for size, _ in axes) < 20_000
    )
)
def test_pieces_follow_the_order_of_values_and_are_small(axes):
    shape, storage = tuple(size for size, _ in axes), tuple(min(axis) for axis in axes)
    values = np.arange(math.prod(shape)).reshape(shape)
    dims = tuple("abcd"[: len(shape)])
    variable = RawVariable(dims, shape, values.dtype, {}, storage)
    raw = Raw(Path(), dict(zip(dims, shape, strict=True)), {}, {"x": variable}, lambda _, index: values[index])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(raw_results, "PIECE", 8 * ROOM)
        pieces = [raw.read("x", index) for index in raw.pieces("x")]
    assert np.array_equal(np.concatenate([piece.ravel() for piece in pieces]), values.ravel())
    assert max(piece.size for piece in pieces) <= 4 * ROOM * max([1, *storage])


def test_parts_are_those_of_the_run_whatever_the_order_of_keys():
    backwards = {kind: dict(reversed(lengths.items())) for kind, lengths in reversed(CUT.items())}
    assert list(stored_parts(backwards, SIZES)) == list(parts())


@pytest.mark.parametrize("cut", [{"points": {"u": 1}}, {"points": 3}, {"points": {"latitude": 0}}, {"series": None}])
def test_a_cut_that_does_not_fit(cut):
    with pytest.raises(HeliosweepError, match="does not fit the result"):
        list(stored_parts(cut, SIZES))


@pytest.mark.parametrize("write", [write_netcdf, write_zarr])
def test_data_and_coordinates_are_told_apart(tmp_path, write):
    write(tmp_path / ("result.nc" if write is write_netcdf else "result.zarr"))
    with open_raw(tmp_path) as raw:
        assert raw.path == locate(tmp_path)
        assert raw.sizes == SIZES
        assert raw.data == list(VARIABLES)
        assert raw.of_kind("series") == ["power"]
        assert sorted([*raw.coordinates, *raw.data]) == sorted(raw.variables)


def test_of_two_results_the_one_of_the_manifest(tmp_path, small):
    folder = write_folder(tmp_path / "out", small(), "result.zarr")
    write_netcdf(folder / "result.nc")
    assert locate(folder) == folder / "result.zarr"
    for text in ("", "[" * 10**5, "{}"):
        (folder / "manifest.json").write_text(text)
        assert locate(folder) == folder / "result.nc"

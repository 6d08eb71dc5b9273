"""Two results told apart by meaning: each kind of difference is named, with its place and size."""

from __future__ import annotations

import json
from collections.abc import Callable

import netCDF4
import numpy as np
import pytest

from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.store import checks
from heliosweep.store.compare import compare
from tests.store.samples import write_netcdf, write_zarr

Edit = Callable[[Callable[[netCDF4.Dataset], object]], str]


@pytest.fixture(autouse=True)
def _readable(monkeypatch):
    """Files of these tests are whole, and are not read beforehand by processes of their own."""
    monkeypatch.setattr(checks, "check_apart", lambda *_: [])


@pytest.fixture
def edited(tmp_path) -> Edit:
    """Compare a file with itself after an edit."""

    def make(edit: Callable[[netCDF4.Dataset], object]) -> str:
        a, b = write_netcdf(tmp_path / "a.nc"), write_netcdf(tmp_path / "b.nc")
        with netCDF4.Dataset(b, "r+") as file:
            file.set_auto_maskandscale(False)
            edit(file)
        comparison = compare(a, b)
        assert not comparison.same
        assert comparison.lines[-1] == f"{len(comparison.differences)} difference" + "s" * (
            len(comparison.differences) > 1
        )
        assert not compare(b, a).same
        return "\n".join(comparison.differences)

    return make


def test_the_same_in_bytes_in_meaning_and_in_any_format(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    folders = write_netcdf(tmp_path / "one" / "result.nc"), write_zarr(tmp_path / "two" / "result.zarr")
    assert compare(tmp_path / "one", tmp_path / "one").lines[-1] == "same bytes"
    assert compare(tmp_path / "two", tmp_path / "two").lines[-1] == "same bytes"
    assert compare(folders[0], write_netcdf(tmp_path / "c.nc")).same_bytes
    assert compare(folders[1], write_zarr(tmp_path / "c.zarr")).same_bytes
    for a, b in ((tmp_path / "one", tmp_path / "two"), (folders[1], folders[0])):
        comparison = compare(a, b)
        assert comparison.same, comparison.text
        assert comparison.lines[-1] == "same content, in other bytes"
    assert compare(folders[0], write_netcdf(tmp_path / "zlib.nc", 4)).same


def test_values_with_largest_difference_and_place(edited):
    def edit(file: netCDF4.Dataset) -> None:
        file["power"][1, 4, 3] += 0.5
        file["power"][2, 0, 0] *= 1.01
        file["power"][0, 1, 1] = 1.0

    said = edited(edit)
    assert "power: 3 of 210 values differ; largest difference 0.961722 W: " in said
    assert "in A, 1 W in B at latitude 0 degrees_north, time 2021-06-21T01:00, heliostat [1]" in said
    assert "largest relative difference 0.962" in said


def test_nan_on_one_side_only(edited):
    said = edited(lambda file: file["mean"].__setitem__((slice(0, 2), 2), [np.nan, 0.25]))
    assert "mean: 1 of 21 values are NaN in A alone, first at latitude 30 degrees_north, heliostat [2]" in said
    assert "mean: 1 of 21 values are NaN in B alone, first at latitude 0 degrees_north, heliostat [2]" in said


def test_coordinates_texts_times_and_scalars(edited):
    def edit(file: netCDF4.Dataset) -> None:
        file["label"][4] = "E"
        file["time"][3] += 60
        file["noon"][2] += 1
        file["height"][...] = 96.0
        file["flag"][0] = 1

    said = edited(edit)
    assert "label: 1 of 7 values differ, first 'é' in A, 'E' in B at heliostat [4]" in said
    assert "time: 1 of 10 values differ; largest difference 60 s: 2021-06-21T03:00 in A, 2021-06-21T03:01 in B" in said
    assert "noon: 1 of 3 values differ; largest difference 1 s: 2020-09-13T12:26:40 in A" in said
    assert "height: 1 of 1 values differ; largest difference 1: 95 in A, 96 in B" in said
    assert "flag: 1 of 3 values differ; largest difference 1: 0 in A, 1 in B at latitude 0 degrees_north" in said


def test_attributes_and_the_study_key_by_key(edited):
    def edit(file: netCDF4.Dataset) -> None:
        file.title = "x" * 200
        file.comment = "new"
        file.delncattr("version")
        file.study = json.dumps({"a": 2, "b": {"c": 2, "d": [1]}})
        file["power"].units = "kW"

    said = edited(edit).splitlines()
    assert f"attribute title: 'test' in A, '{'x' * 55}...' in B" in said
    assert "attribute comment: only in B: 'new'" in said
    assert "attribute version: only in A: 1" in said
    assert "power: attribute units: 'W' in A, 'kW' in B" in said
    assert "study: a: 1 -> 2" in said
    assert any(line.startswith("study: b.d: ") for line in said)
    assert not any(line.startswith("attribute study:") for line in said)


def test_dimensions_variables_and_types(tmp_path):
    paths = tmp_path / "a.nc", tmp_path / "b.nc"
    for path, size, dtype, other in zip(paths, (2, 3), ("f8", "f4"), ("x", "y"), strict=True):
        with netCDF4.Dataset(path, "w") as file:
            file.createDimension("u", size)
            file.createDimension("v", 2)
            file.createVariable("long", "f8", ("u",))[:] = 1
            file.createVariable("typed", dtype, ("v",))[:] = 0.5
            file.createVariable("turned", "f8", ("u", "v") if size == 2 else ("v", "u"))[:] = 0
            file.createVariable("mixed", str if size == 2 else "f8", ("v",))[0] = "1" if size == 2 else 1
            file.createVariable(other, "f8", ())[...] = 0
    said = compare(*paths).differences
    assert "dimension u: 2 in A, 3 in B" in said
    assert "long: values not compared, for the lengths differ" in said
    assert "typed: float64 in A, float32 in B" in said
    assert "turned: over (u, v) in A, over (v, u) in B; values not compared" in said
    assert "mixed: str in A, float64 in B" in said
    assert {"x: only in A", "y: only in B"} <= {*said}
    assert not any(line.startswith("typed: 2 of") for line in said)


def test_tolerances(tmp_path):
    a, b = write_netcdf(tmp_path / "a.nc"), write_netcdf(tmp_path / "b.nc")
    with netCDF4.Dataset(b, "r+") as file:
        file["power"][2] *= 1 + 1e-9
        file["power"][0, 0, 1] += 1e-3
    assert not compare(a, b).same
    assert not compare(a, b, rtol=1e-8).same
    near = compare(a, b, rtol=1e-8, atol=2e-3)
    assert near.same
    assert near.lines[-1] == "same content within the tolerances"
    assert "differ within the tolerances; largest difference 0.001 W" in near.text
    for wrong in (-1.0, float("nan")):
        with pytest.raises(StudyError, match="tolerances"):
            compare(a, b, rtol=wrong)


def test_infinities_and_long_integers(tmp_path):
    paths = tmp_path / "a.nc", tmp_path / "b.nc"
    for path, numbers, count in zip(paths, ([np.inf, np.inf], [np.inf, 1.0]), (2**60, 2**60 + 1), strict=True):
        with netCDF4.Dataset(path, "w") as file:
            file.createDimension("u", 2)
            file.createVariable("x", "f8", ("u",))[:] = numbers
            file.createVariable("n", "i8", ())[...] = count
    said = compare(*paths, atol=0).differences
    assert any(line.startswith("x: 1 of 2 values differ; largest difference inf") for line in said)
    assert any(line.startswith("n: 1 of 1 values differ") for line in said)


def test_what_is_no_result(tmp_path):
    good = write_netcdf(tmp_path / "a.nc")
    (tmp_path / "text.nc").write_text("text")
    (tmp_path / "empty").mkdir()
    with pytest.raises(StudyError, match="no such file"):
        compare(good, tmp_path / "missing.nc")
    with pytest.raises(StudyError, match="holds no result"):
        compare(tmp_path / "empty", good)
    with pytest.raises(HeliosweepError, match=r"text\.nc: is no result"):
        compare(good, tmp_path / "text.nc")

"""Result files: whole or absent, the same bytes in any cut, and readable with xarray alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.store import netcdf
from heliosweep.store.digest import content_digest, file_digest
from heliosweep.store.netcdf import ResultWriter, Variable

SIZES = {"latitude": 2, "time": 10, "heliostat": 7}
COORDINATES = xr.Dataset(
    coords={
        "latitude": ("latitude", [0.0, 30.0], {"units": "degrees_north"}),
        "time": ("time", np.datetime64("2021-06-21T00:00", "ns") + np.arange(10) * np.timedelta64(1, "h")),
        "ring": ("heliostat", np.arange(7)),
        "label": ("heliostat", np.array([*"abcdef", ""], dtype=object)),
        "height": 95.0,
    }
)
MEAN = Variable(("latitude", "heliostat"), {"units": "1"})
SERIES = Variable(("latitude", "time", "heliostat"), {"units": "1"}, storage={"time": 2, "heliostat": 4})
VALUES = {
    "mean": np.linspace(0, 1, 14).reshape(2, 7),
    "a": np.linspace(0, 1, 140).reshape(2, 10, 7),
    "b": np.linspace(2, 3, 140).reshape(2, 10, 7),
}


def write(path: Path, time_parts: list[slice], points: list[slice]) -> Path:
    attributes = {"title": "test", "version": 1}
    with ResultWriter(path, SIZES, COORDINATES, {"mean": MEAN, "a": SERIES, "b": SERIES}, attributes) as writer:
        for point in points:
            writer.write({"mean": VALUES["mean"][point]}, {"latitude": point})
        for point in points:
            for part in time_parts:
                values = {name: VALUES[name][point, part] for name in ("a", "b")}
                writer.write(values, {"latitude": point, "time": part})
    return path


WHOLE = [slice(0, 2)]
EACH = [slice(0, 1), slice(1, 2)]


def test_reads_back_with_xarray(tmp_path):
    path = write(tmp_path / "result.nc", [slice(0, 10)], WHOLE)
    with xr.open_dataset(path) as result:
        for name, values in VALUES.items():
            np.testing.assert_array_equal(result[name], values)
        assert set(result.coords) == set(COORDINATES.coords)
        np.testing.assert_array_equal(result["time"], COORDINATES["time"])
        assert result["label"].values.tolist() == [*"abcdef", ""]
        assert result.attrs["title"] == "test"
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


def test_same_bytes_for_any_cut(tmp_path):
    cuts = [
        ([slice(0, 10)], WHOLE),
        ([slice(0, 10)], EACH),
        ([slice(0, 4), slice(4, 10)], EACH),
        ([slice(i, i + 2) for i in range(0, 10, 2)], EACH),
    ]
    digests = {file_digest(write(tmp_path / f"{i}.nc", *cut)) for i, cut in enumerate(cuts)}
    assert len(digests) == 1


def test_failure_leaves_nothing_and_keeps_what_was_there(tmp_path):
    path = tmp_path / "result.nc"
    path.write_text("older result")

    class Stop(BaseException):
        pass

    def interrupted() -> None:
        with ResultWriter(path, SIZES, COORDINATES, {"mean": MEAN}, {}) as writer:
            writer.write({"mean": VALUES["mean"]}, {})
            raise Stop

    with pytest.raises(Stop):
        interrupted()
    assert path.read_text() == "older result"
    assert list(tmp_path.iterdir()) == [path]


def test_bad_definition_leaves_nothing(tmp_path):
    with pytest.raises(TypeError):
        ResultWriter(tmp_path / "result.nc", SIZES, COORDINATES, {"mean": MEAN}, {"bad": object()})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("free", "cause"), [(4096, r"disk full \(4\.1 kB free\)"), (2**30, r"NetCDF: HDF error \(1\.1 GB free\)")]
)
def test_a_write_that_fails_says_why_and_leaves_nothing(tmp_path, monkeypatch, free, cause):
    def fail(*_: object) -> None:
        raise RuntimeError("NetCDF: HDF error")

    path = tmp_path / "result.nc"
    monkeypatch.setattr(netcdf.ResultWriter, "_write", fail)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": free}))
    with (
        pytest.raises(HeliosweepError, match=f"result.nc: cannot be written: {cause}"),
        ResultWriter(path, SIZES, COORDINATES, {"mean": MEAN}, {}) as writer,
    ):
        writer.write({"mean": VALUES["mean"]}, {})
    assert list(tmp_path.iterdir()) == []


def test_what_described_the_file_before_goes_with_it(tmp_path):
    (tmp_path / "manifest.json").touch()
    (tmp_path / "notes.txt").touch()
    with ResultWriter(
        tmp_path / "result.nc", SIZES, COORDINATES, {"mean": MEAN}, {}, replaces=("manifest.json",)
    ) as file:
        assert (tmp_path / "manifest.json").exists()
        file.write({"mean": VALUES["mean"]}, {})
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "notes.txt"}


def test_content_digest_sees_values_names_and_attributes_but_not_compression(tmp_path):
    def digest(name: str, level: int = 1, **changes: object) -> str:
        path = tmp_path / f"{name}.nc"
        variable = changes.get("variable", SERIES)
        with ResultWriter(path, SIZES, COORDINATES, {"a": variable}, {"title": "t"}, level) as writer:  # type: ignore[dict-item]
            writer.write({"a": changes.get("values", VALUES["a"])}, {})  # type: ignore[dict-item]
        return content_digest(path)

    plain = digest("plain")
    assert digest("level", level=0) == plain
    assert digest("storage", variable=Variable(SERIES.dims, SERIES.attrs)) == plain
    nudged = VALUES["a"].copy()
    nudged[1, 3, 4] = np.nextafter(nudged[1, 3, 4], 1)
    assert digest("values", values=nudged) != plain
    assert digest("attrs", variable=Variable(SERIES.dims, {"units": "m"}, storage=SERIES.storage)) != plain

"""Results on the disk: parts, both formats, opening and saving again, comparison, verification, protected files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.config.blocks import Output
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.grid.regions import Cut, Variable, chunks_by_block
from heliosweep.store.compare import compare
from heliosweep.store.folder import ChunkStore, check_contents, open_result, target_file, unfinished, verify
from heliosweep.store.writer import write_result

SIZES = {"latitude": 3, "time": 10, "heliostat": 7}
COORDINATES = xr.Dataset(
    coords={
        "latitude": ("latitude", [0.0, 30.0, 45.0], {"units": "degrees_north"}),
        "time": ("time", np.datetime64("2021-06-21T00:00", "ns") + np.arange(10) * np.timedelta64(1, "h")),
        "utc": (("latitude", "time"), np.full((3, 10), np.datetime64("NaT", "ns"))),
        "label": ("heliostat", np.array([*"abcdé", "", "none"], dtype=object), {"long_name": "name"}),
        "model": "rotary",
        "height": 95.0,
    }
)
VARIABLES = {
    "mean": Variable(("latitude", "heliostat"), {"units": "1", "valid_range": np.array([0.0, 1.0])}),
    "power": Variable(("latitude", "time", "heliostat"), {"units": "W"}),
    "flag": Variable(("latitude",), {"flag_values": np.array([0, 1], dtype=np.int8)}, np.dtype(np.int8)),
    "noon": Variable(("latitude",), {"long_name": "noon"}, np.dtype("datetime64[ns]"), finished=True),
    "total": Variable((), {"units": "W"}),
}
VALUES: dict[str, np.ndarray] = {
    "mean": np.where(np.arange(21) < 7, np.nan, np.linspace(0, 1, 21)).reshape(3, 7),
    "power": np.linspace(0, 1, 210).reshape(3, 10, 7),
    "flag": np.array([0, 1, 1], dtype=np.int8),
    "noon": np.array(["2017-07-14T02:40", "NaT", "2020-09-13T12:26:40"], dtype="datetime64[ns]"),
    "total": np.array(3.5),
}
CUTS = {
    "points": Cut({"latitude": 3}, {"latitude": 3}, {"latitude": 1}),
    "series": Cut(SIZES, {"latitude": 1, "time": 4, "heliostat": 4}, {"latitude": 1, "time": 4, "heliostat": 2}),
}
ATTRIBUTES = {"title": "test", "study": '{"a": 1, "b": {"c": 2}}', "version": np.int32(1)}
TEMPLATE = (COORDINATES.assign_attrs(ATTRIBUTES), VARIABLES, SIZES, CUTS)


def write(folder: Path, compression: str = "none", **values: Any) -> Path:
    folder.mkdir(exist_ok=True)
    known = {**VALUES, **values}
    cells = (
        (block, {name: known[name][tuple(block.region.get(dim, slice(None)) for dim in one.dims)]
                for name, one in VARIABLES.items() if one.kind == block.kind})
        for block, _ in chunks_by_block(CUTS)
    )  # fmt: skip
    return write_result(cells, *TEMPLATE, Output(compression=compression), folder)


@pytest.mark.parametrize("compression", ["none", "zlib"])
def test_values_come_back_and_bytes_are_the_same_twice(tmp_path, compression):
    first, second = (write(tmp_path / name, compression) for name in ("a", "b"))
    with open_result(first) as result, xr.open_dataset(first) as plain:
        for name, values in VALUES.items():
            np.testing.assert_array_equal(result[name], values)
            np.testing.assert_array_equal(plain[name], values)
        assert result["label"].to_numpy().tolist() == [*"abcdé", "", "none"]
        assert result["model"].item() == plain["model"].item() == "rotary"
        assert np.isnat(result["utc"]).all()
        assert result["flag"].attrs["flag_values"].tolist() == [0, 1]
        assert set(result.coords) == set(plain.coords) == set(COORDINATES.coords)
    assert compare(first, second).same_bytes
    assert [path.name for path in (tmp_path / "a").iterdir()] == [first.name]


def test_parts_come_back_and_damage_is_noticed(tmp_path):
    store = ChunkStore(tmp_path / "chunks-0-1")
    assert store.create(CUTS, study_id="0") == CUTS
    store.save("points-00000", VALUES)
    loaded = store.load("points-00000")
    assert loaded is not None
    for name, values in VALUES.items():
        np.testing.assert_array_equal(loaded[name], values)
    assert (store.done(), store.load("points-00001")) == ({"points-00000"}, None)
    other = {"points": Cut({"latitude": 3}, {"latitude": 3}, {"latitude": 3})}
    assert store.create(other) == CUTS  # of the run that made it
    left = unfinished(tmp_path)
    assert left is not None
    assert left.folder == store.folder
    path = store.folder / "points-00000.npz"
    whole = path.read_bytes()
    names = np.frombuffer(whole, np.uint8)
    start = whole.index(VALUES["power"].tobytes())
    for place in range(start, start + VALUES["power"].nbytes, 97):
        damaged = names.copy()
        damaged[place] ^= 4
        path.write_bytes(damaged.tobytes())
        assert store.load("points-00000") is None
    for length in range(0, len(whole), 397):
        path.write_bytes(whole[:length])
        assert store.load("points-00000") is None


def test_differences_are_named_with_their_place(tmp_path):
    a = write(tmp_path / "a")
    other = VALUES["power"].copy()
    other[1, 2, 3] += 0.25
    other[2, 0, 0] = np.nan
    b = write(tmp_path / "b", "zlib", power=other, flag=np.array([0, 1, 0], np.int8))
    lines = compare(a, b).differences
    assert len(lines) == 2
    assert lines[1].startswith("flag: 1 of 3 values differ; largest difference 1: 1 in A, 0 in B at latitude 45.0")
    assert "power: 2 of 210 values differ, 1 of them NaN in only one result" in lines[0]
    del other
    near = write(tmp_path / "c", power=VALUES["power"] * (1 + 1e-12))
    assert not compare(a, near).same
    close = compare(a, near, rtol=1e-9)
    assert close.same
    assert str(close).splitlines()[-1] == "same content within the tolerances"
    assert compare(a, write(tmp_path / "d", "zlib")).same
    with pytest.raises(StudyError, match="negative"):
        compare(a, b, rtol=-1)
    (tmp_path / "b" / "result.nc").write_bytes(b"\x89HDF")
    with pytest.raises(HeliosweepError, match="is damaged"):
        compare(a, b)


def test_damage_of_a_result_is_found_by_its_digest(small, tmp_path):
    file = api.run(small(), tmp_path / "out", report=False).path
    assert verify(tmp_path / "out").ok
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert "differs from the manifest (SHA-256)" in str(verify(tmp_path / "out"))
    assert not verify(tmp_path / "nothing").ok
    manifest = tmp_path / "out" / "manifest.json"
    manifest.write_text(manifest.read_text(encoding="utf-8").replace('"workers": ', '"workers": 1'), encoding="utf-8")
    assert "manifest.json: was changed after it was written" in str(verify(tmp_path / "out"))
    manifest.write_text("[[", encoding="utf-8")
    assert "manifest.json: is damaged" in str(verify(tmp_path / "out"))


def test_files_of_others_are_not_replaced(small, tmp_path):
    study = small()
    (tmp_path / "result.nc").write_bytes(b"mine")
    with pytest.raises(StudyError, match=r"contains result\.nc without a manifest"):
        check_contents(tmp_path, study, force=False)
    check_contents(tmp_path, study, force=True)
    (tmp_path / "result.nc").unlink()
    (tmp_path / "study.resolved.yaml").write_text(study.to_yaml(tmp_path), encoding="utf-8")
    with pytest.raises(StudyError, match="is an input of the study"):
        check_contents(tmp_path, api.load(tmp_path / "study.resolved.yaml"), force=True)
    (tmp_path / "result.nc").mkdir()
    with pytest.raises(StudyError, match="is a folder, not a result file"):
        check_contents(tmp_path, study, force=True)


def test_targets_never_replace_results_or_sources(tmp_path):
    write(tmp_path / "a")
    mine = tmp_path / "mine.csv"
    mine.write_text("a\n", encoding="utf-8")
    options: Any
    for name, options, message in (
        ("a/comparison.csv", {}, "belongs to a result"),
        ("mine.csv", {}, "exists already"),
        ("mine.csv", {"sources": [mine], "force": True}, "is an input"),
        ("mine.txt", {}, "must end in"),
        ("none/mine.csv", {}, "folder does not exist"),
    ):
        with pytest.raises(StudyError, match=message):
            target_file(tmp_path / name, **{"force": False, **options})
    assert target_file(mine, force=True) == mine


def test_renamed_variables_of_version_0_1_have_their_new_names(tmp_path):
    xr.Dataset({"least_tolerance": ("heliostat", [3.5]), "hour_of_least_tolerance": ("heliostat", [8.0])}).to_netcdf(
        tmp_path / "result.nc"
    )
    with open_result(tmp_path) as opened:
        assert opened.minimum_tolerance.values == [3.5]
        assert opened.hour_of_minimum_tolerance.values == [8.0]

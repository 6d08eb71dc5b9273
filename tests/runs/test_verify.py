"""Damage of every kind is found, told with the part that it hit, and never a traceback."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from heliosweep.runs.verify import verify
from heliosweep.store import checks
from heliosweep.store.parts import PartStore
from tests.store.samples import CUTS, PARTS, SIZES, VALUES, VARIABLES, digests, flip, values, write_folder

KINDS = [("result.nc", "none"), ("result.nc", "zlib"), ("result.zarr", "none"), ("result.zarr", "zstd")]


@pytest.fixture(params=KINDS, ids=lambda kind: "-".join(kind))
def folder(request, tmp_path, small) -> Path:
    result, compression = request.param
    return write_folder(tmp_path / "folder", small(), result, compression)


@pytest.fixture
def plain(tmp_path, small) -> Path:
    """With an uncompressed NetCDF file."""
    return write_folder(tmp_path / "folder", small())


@pytest.fixture
def zarr(tmp_path, small) -> Path:
    return write_folder(tmp_path / "folder", small(), "result.zarr", "zstd")


@pytest.fixture
def _readable(monkeypatch) -> None:
    """What these tests do to values and attributes keeps no library from reading: no process of its own is needed."""
    monkeypatch.setattr("heliosweep.runs.verify.check_apart", checks.check)


def offset_of(path: Path, values: np.ndarray) -> int:
    return path.read_bytes().index(np.ascontiguousarray(values).tobytes())


def test_a_whole_folder_is_all_right(folder):
    done = verify(folder)
    assert done.ok, done.text
    assert done.finished
    assert f"{len(digests())} slabs as computed" in done.text
    assert "study.resolved.yaml: study" in done.text
    assert [note for note in done.notes if "report.html" in note]


def test_so_is_a_copy_elsewhere_that_nobody_may_write_to(folder, tmp_path):
    copy = tmp_path / "elsewhere" / "copy"
    shutil.copytree(folder, copy)
    shutil.rmtree(folder)
    places = [copy, *copy.rglob("*")]
    try:
        for path in places:
            path.chmod(0o555 if path.is_dir() else 0o444)
        before = {path: path.stat().st_mtime_ns for path in places}
        assert verify(copy).ok
        assert {path: path.stat().st_mtime_ns for path in [copy, *copy.rglob("*")]} == before
    finally:
        for path in places:
            path.chmod(0o755)


def test_a_study_whose_files_are_gone_is_only_noted(plain):
    study = plain / "study.resolved.yaml"
    text = study.read_text()
    start = text.index("layout:")
    study.write_text(text[:start] + "layout: {file: gone.csv}\n" + text[text.index("heliostat:") :])
    done = verify(plain)
    assert done.ok, done.text
    assert "cannot run here" in done.text
    study.write_text(text.replace("height: 60", "height: 61"))
    assert any("the result is of" in problem for problem in verify(plain).problems)
    study.write_text("][")
    assert any("cannot be loaded" in problem for problem in verify(plain).problems)
    study.unlink()
    assert any("study.resolved.yaml: is missing" in problem for problem in verify(plain).problems)


@pytest.mark.usefixtures("_readable")
@pytest.mark.parametrize("latitude", [0, 1, 2])
def test_a_flipped_bit_in_a_series_names_its_slab(plain, latitude):
    path = plain / "result.nc"
    start = offset_of(path, VALUES["power"])
    flip(path, start + 8 * (70 * latitude + 5 * 7 + 6))  # the sixth instant, the last heliostat
    done = verify(plain)
    labels = ["0", "30", "45"]
    assert not done.ok
    (damaged,) = (problem for problem in done.problems if "slab " in problem)
    assert f"slab series-{6 * latitude + 3:05} (latitude {labels[latitude]} degrees_north, time " in damaged
    assert "time 2021-06-21T04:00 to 2021-06-21T07:00, heliostat [4] to [6])" in damaged
    assert any("SHA-256" in problem for problem in done.problems)


def test_a_missing_or_swapped_chunk_names_its_slabs(zarr):
    power = zarr / "result.zarr" / "power"
    one, two = power / "0.0.0", power / "1.1.0"
    one.rename(power / "spare")
    two.rename(one)
    (power / "spare").rename(two)
    text = verify(zarr).text
    assert "slab series-00000" in text
    assert "slab series-00008" in text
    assert text.count("slab ") == 2
    two.unlink()
    assert "slab series-00008" in verify(zarr).text


@pytest.mark.usefixtures("_readable")
def test_two_slabs_that_changed_places_are_found(plain):
    with netCDF4.Dataset(plain / "result.nc", "r+") as file:
        file.set_auto_maskandscale(False)
        file["power"][0], file["power"][1] = VALUES["power"][1], VALUES["power"][0]
    damaged = [problem for problem in verify(plain).problems if "slab " in problem]
    assert len(damaged) == 12


@pytest.mark.usefixtures("_readable")
def test_a_changed_attribute_is_found_though_the_values_are_right(plain):
    with netCDF4.Dataset(plain / "result.nc", "r+") as file:
        file["power"].units = "k"
    problems = verify(plain).problems
    assert any("attributes or coordinates are not those that were written" in problem for problem in problems)
    assert not any("slab " in problem for problem in problems)


def test_a_file_without_its_manifest(plain, monkeypatch):
    (plain / "manifest.json").unlink()
    with monkeypatch.context() as patch:
        patch.setattr("heliosweep.runs.verify.check_apart", checks.check)
        assert verify(plain).problems == ["manifest.json: is missing; run the study again to write it"]
    os.truncate(plain / "result.nc", 9000)
    assert "is no NetCDF file, or damaged" in verify(plain).text


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["study_id"], "abcdef012345"),
        (["result", "sha256"], "0" * 64),
        (["result", "bytes"], "many"),
        (["result", "content_digest"], "0" * 64),
        (["result", "file"], "../../etc/passwd"),
        (["result", "file"], ["result.nc"]),
        (["slabs", "cut", "points"], [["longitude", 3, 1]]),
        (["slabs", "cut", "points"], [["latitude", 3, 0]]),
        (["slabs", "cut", "series", 1], "x"),
        (["slabs", "digests", "points-00001"], "0" * 64),
        (["slabs", "digests", "points-00007"], "0" * 64),
        (["slabs", "digests"], 3),
        (["slabs"], {}),
    ],
)
@pytest.mark.usefixtures("_readable")
def test_a_manifest_of_something_else(plain, keys, value):
    path = plain / "manifest.json"
    manifest = json.loads(path.read_text())
    place = manifest
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    path.write_text(json.dumps(manifest))
    assert not verify(plain).ok


def test_results_that_are_none(plain, tmp_path):
    path = plain / "result.nc"
    path.write_text("this is text")
    assert "is no NetCDF file, or damaged" in verify(plain).text
    path.unlink()
    assert "result.nc: is missing" in verify(plain).text
    path.mkdir()
    assert "is a folder" in verify(plain).text
    assert "there is no such folder" in verify(tmp_path / "nowhere").text
    assert "is no folder" in verify(plain / "manifest.json").text
    (tmp_path / "empty").mkdir()
    assert "result: is missing" in verify(tmp_path / "empty").text


@pytest.fixture
def unfinished(tmp_path) -> Path:
    """Three parts done, one failed, the others left."""
    first, second, third, fourth, *_ = PARTS
    with PartStore.create(tmp_path / "working", {}, CUTS, VARIABLES, SIZES) as store:
        for part in (third, first, second):
            store.commit(part, values(part))
        store.fail(fourth, "ValueError: no such thing")
    return tmp_path


def test_an_unfinished_run(unfinished):
    done, count = verify(unfinished), len(PARTS)
    assert not done.finished
    assert done.found == [f"3 of {count} parts are done, 1 failed, {count - 4} are left to compute"]
    assert done.problems == ["part series-00000: failed: ValueError: no such thing"]
    journal = unfinished / "working" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:3]) + lines[3][:7])
    done = verify(unfinished)
    assert done.ok
    assert done.lines[0].endswith("unfinished, all right so far")


def test_a_damaged_part_of_an_unfinished_run(unfinished):
    line = json.loads((unfinished / "working/journal.jsonl").read_text().splitlines()[2])
    flip(unfinished / "working/values.bin", line["offset"] + 9)
    done = verify(unfinished)
    assert done.problems[0] == "part points-00001 (latitude [1] to [1]): is not what was computed; it is computed anew"
    assert done.found[0].startswith("2 of ")


@pytest.mark.parametrize("key", ["study_file", "finished", "environment", "command", "seconds", "identity"])
def test_a_change_of_anything_in_the_manifest_is_found(plain, key):
    path = plain / "manifest.json"
    said = json.loads(path.read_text())
    for changed in ({**said, key: {"another": 1}}, {name: one for name, one in said.items() if name != key}):
        path.write_text(json.dumps(changed))
        assert verify(plain).ok == (changed == said)
    path.write_text(json.dumps(said, indent=7))  # other white space says the same
    assert verify(plain).ok
    del said["digest"]
    path.write_text(json.dumps(said))
    assert [note for note in verify(plain).notes if "manifest.json: has no digest" in note]

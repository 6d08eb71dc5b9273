"""Files that are damaged between two runs or within one: the right parts are computed anew, never a wrong result."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from random import Random
from typing import Any

import pytest

from heliosweep.errors import HeliosweepError, RunInterrupted, StudyError
from heliosweep.runtime import run as runtime
from heliosweep.runtime.verify import verify
from heliosweep.store import publish
from heliosweep.store.journal import Journal
from tests.faults.kills import content_of, leftovers
from tests.faults.stopped import DAMAGES, STUDY, Runs, flip, runs  # noqa: F401

PARTS = [f"points-{number:05}" for number in range(4)]
ZARR = {**STUDY, "output": {"format": "zarr", "compression": "zlib"}}


@pytest.fixture
def expected(runs: Runs, tmp_path) -> dict[str, bytes]:  # noqa: F811
    runs.run(STUDY, tmp_path / "peace")
    return content_of(tmp_path / "peace")


def chunk(folder: Path, part: int) -> Path:
    """A chunk of a part: of the first variable, by name."""
    place = min((folder / "working/values.zarr").glob("*efficiency*"))
    return place / f"{part // 2}.{part % 2}.0"


@pytest.mark.parametrize("damage", list(DAMAGES))
def test_a_damaged_part_is_computed_anew(runs, expected, tmp_path, caplog, damage):  # noqa: F811
    done = runs.stop(STUDY, tmp_path / "out", 3)
    DAMAGES[damage](chunk(tmp_path / "out", 1))
    assert sorted(runs.run(STUDY, tmp_path / "out")) == [PARTS[1], PARTS[3]]
    assert done == PARTS[:3]
    assert "damaged on the disk" in caplog.text
    assert "computed anew: points-00001" in caplog.text
    assert content_of(tmp_path / "out") == expected
    assert not leftovers(tmp_path / "out")


@pytest.mark.parametrize("damage", ["truncated", "flipped", "deleted"])
def test_parts_in_a_compressed_store(runs, tmp_path, damage):  # noqa: F811
    runs.run(ZARR, tmp_path / "peace")
    runs.stop(ZARR, tmp_path / "out", 3)
    DAMAGES[damage](chunk(tmp_path / "out", 0))
    assert sorted(runs.run(ZARR, tmp_path / "out")) == [PARTS[0], PARTS[3]]
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


@pytest.mark.parametrize(
    ("name", "edit", "again"),
    [
        ("torn last line", lambda text: text[:-20], PARTS[2:]),
        ("torn last line that lacks its end alone", lambda text: text[:-1], PARTS[2:]),
        (
            "garbage in the middle",
            lambda text: text.replace(b'{"part": "points-00001"', b"\xff\0\r\x85{{{{"),
            PARTS[1::2],
        ),
        ("lines twice", lambda text: text + text, PARTS[3:]),
        ("an unknown part", lambda text: text.replace(b"points-00001", b"points-00091"), PARTS[1::2]),
        ("another part", lambda text: text.replace(b"points-00001", b"points-00003"), PARTS[1::2]),
        ("another digest", lambda text: text.replace(b'"sha256": "', b'"sha256": "0', 1), [PARTS[0], PARTS[3]]),
        ("odd values", lambda text: text + b'[]\n1\n"part"\nnull\n{"part": []}\n' + b"[" * 10**5 + b"\n", PARTS[3:]),
        ("emptied", lambda _: b"", PARTS),
        ("nothing but zeros", lambda text: b"\0" * len(text), PARTS),
    ],
)
def test_a_damaged_journal(runs, expected, tmp_path, name, edit, again):  # noqa: F811
    runs.stop(STUDY, tmp_path / "out", 3)
    path = tmp_path / "out/working/journal.jsonl"
    path.write_bytes(edit(path.read_bytes()))
    assert runs.run(STUDY, tmp_path / "out") == again
    assert content_of(tmp_path / "out") == expected


def test_a_deleted_journal(runs, expected, tmp_path):  # noqa: F811
    runs.stop(STUDY, tmp_path / "out", 3)
    (tmp_path / "out/working/journal.jsonl").unlink()
    assert runs.run(STUDY, tmp_path / "out") == PARTS
    assert content_of(tmp_path / "out") == expected


def test_a_journal_that_names_another_part_when_all_are_done(runs, expected, tmp_path):  # noqa: F811
    runs.stop(STUDY, tmp_path / "out", 3)
    with (tmp_path / "out/working/journal.jsonl").open("a") as file:
        print(json.dumps({"part": "points-00009", "sha256": "0"}), file=file)
    assert runs.run(STUDY, tmp_path / "out") == PARTS[3:]
    assert content_of(tmp_path / "out") == expected


@pytest.mark.parametrize("damage", list(DAMAGES))
@pytest.mark.parametrize("name", ["study.json", "values.zarr/.zmetadata"])
def test_a_store_that_cannot_be_trusted_is_refused(runs, expected, tmp_path, name, damage):  # noqa: F811
    runs.stop(STUDY, tmp_path / "out", 3)
    path = tmp_path / "out/working" / name
    if damage == "flipped":
        flip(path, path.read_bytes().index(b'"format"' if name == "study.json" else b'"shape"') + 1, 4)
    else:
        DAMAGES[damage](path)
    with pytest.raises(HeliosweepError, match="--force"):
        runs.run(STUDY, tmp_path / "out")
    assert runs.run(STUDY, tmp_path / "out", force=True) == PARTS
    assert content_of(tmp_path / "out") == expected
    assert not leftovers(tmp_path / "out")


def test_metadata_beside_the_consolidated_ones_do_not_matter(runs, expected, tmp_path):  # noqa: F811
    runs.stop(STUDY, tmp_path / "out", 3)
    for path in (tmp_path / "out/working/values.zarr").rglob(".z*"):
        if path.name == ".zarray":
            path.write_bytes(b"\0")
    assert runs.run(STUDY, tmp_path / "out") == PARTS[3:]
    assert content_of(tmp_path / "out") == expected


@pytest.mark.parametrize("damage", list(DAMAGES))
@pytest.mark.parametrize("name", ["result.nc", "manifest.json"])
def test_a_damaged_result_is_computed_anew(runs, expected, tmp_path, name, damage):  # noqa: F811
    shutil.copytree(tmp_path / "peace", tmp_path / "out")
    path = tmp_path / "out" / name
    if name == "manifest.json" and damage == "flipped":
        flip(path, path.read_bytes().index(b'"sha256"') + 1)
    else:
        DAMAGES[damage](path)
    if damage == "folder":
        with pytest.raises(HeliosweepError, match=r"s a (directory|folder)"):  # somebody made it: nothing is removed
            runs.run(STUDY, tmp_path / "out")
        path.rmdir()
    if name == "manifest.json" and damage != "flipped":
        with pytest.raises(StudyError, match=r"holds .*result\.nc.* without a manifest of heliosweep; --force"):
            runs.run(STUDY, tmp_path / "out")
        assert runs.run(STUDY, tmp_path / "out", force=True) == PARTS
    else:
        assert runs.run(STUDY, tmp_path / "out") in ([], PARTS)
    assert content_of(tmp_path / "out") == expected
    assert verify(tmp_path / "out").ok
    assert not leftovers(tmp_path / "out")


def test_any_bit_of_a_manifest(runs, expected, tmp_path):  # noqa: F811
    random = Random(1)
    content = (tmp_path / "peace/manifest.json").read_bytes()
    for _ in range(8):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        shutil.copytree(tmp_path / "peace", tmp_path / "out")
        flip(tmp_path / "out/manifest.json", random.randrange(len(content)), random.randrange(7))
        try:
            runs.run(STUDY, tmp_path / "out")
        except StudyError:  # it is no manifest any more
            runs.run(STUDY, tmp_path / "out", force=True)
        assert content_of(tmp_path / "out") == expected


@pytest.mark.long
def test_any_bit_of_a_working_store(runs, expected, tmp_path):  # noqa: F811
    random = Random(2)
    runs.stop(STUDY, tmp_path / "stopped", 3)
    files = [path for path in (tmp_path / "stopped/working").rglob("*") if path.is_file()]
    refused = 0
    for _ in range(300):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        shutil.copytree(tmp_path / "stopped", tmp_path / "out")
        path = tmp_path / "out" / random.choice(files).relative_to(tmp_path / "stopped")
        size = path.stat().st_size
        if not size:
            continue
        flip(path, random.randrange(size), random.randrange(8))
        try:
            runs.run(STUDY, tmp_path / "out")
        except HeliosweepError as error:
            refused += "--force" in str(error)
            runs.run(STUDY, tmp_path / "out", force=True)
        assert content_of(tmp_path / "out") == expected
    assert refused < 60


def test_a_part_damaged_before_it_is_published(runs, expected, tmp_path, monkeypatch):  # noqa: F811
    """Found when it is read again, for the digest of every part is checked then too."""
    whole = publish.publish

    def damaging(store: Any, *rest: Any) -> Path:
        flip(chunk(tmp_path / "out", 2))
        return whole(store, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(runtime, "publish", damaging)
        with pytest.raises(HeliosweepError, match="points-00002 was damaged on the disk; run again"):
            runs.run(STUDY, tmp_path / "out")
    assert not list(tmp_path.glob("out/result*"))
    assert not list(tmp_path.glob("out/.*"))
    assert runs.run(STUDY, tmp_path / "out") == [PARTS[2]]
    assert content_of(tmp_path / "out") == expected


def test_a_part_damaged_before_it_goes_into_a_zarr_result(runs, tmp_path, monkeypatch):  # noqa: F811
    runs.run(ZARR, tmp_path / "peace")
    whole = publish.publish

    def damaging(store: Any, *rest: Any) -> Path:
        flip(chunk(tmp_path / "out", 2))
        return whole(store, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(runtime, "publish", damaging)
        with pytest.raises(HeliosweepError, match="points-00002 was damaged on the disk; run again"):
            runs.run(ZARR, tmp_path / "out")
    assert runs.run(ZARR, tmp_path / "out") == [PARTS[2]]
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_killed_between_the_manifest_and_the_end(runs, expected, tmp_path, monkeypatch):  # noqa: F811
    """The parts that are still there belong to a result that is complete; they go with the next run."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("heliosweep.store.working.WorkingStore.remove", stop)
        with pytest.raises(RunInterrupted):
            runs.run(STUDY, tmp_path / "out")
    assert len(Journal.read(tmp_path / "out/working/journal.jsonl").done) == 4
    assert runs.run(STUDY, tmp_path / "out") == []
    assert not leftovers(tmp_path / "out")
    assert content_of(tmp_path / "out") == expected

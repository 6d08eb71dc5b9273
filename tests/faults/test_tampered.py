"""What a run has written of itself, edited or damaged: right results or a message, and never anything else."""

from __future__ import annotations

import copy
import json
import re
import shutil
import time
from pathlib import Path
from random import Random
from typing import Any

import pytest

from heliosweep import api
from heliosweep.errors import HeliosweepError
from heliosweep.runs.status import result_folders, status_lines, status_of
from heliosweep.runs.verify import verify
from heliosweep.store.manifest import Finished
from tests.faults.kills import content_of, leftovers
from tests.faults.mutations import places_of
from tests.faults.stopped import STUDY, ZARR, Runs
from tests.store.samples import write_folder
from tests.store.test_parts import BAD_LINES

MANIFEST, STORE, JOURNAL = "manifest.json", "working/study.json", "working/journal.jsonl"
DEEP = "[" * 100_000
#: What stands in the place of something else.
VALUES: list[Any] = [
    None, True, False, 0, 1, -1, 5, 2**63, 10**400, -(10**30), 1.5, float("nan"), float("inf"), -1e308, "", "abc", "..",
    "../result.nc", "/etc/passwd", "result.nc", "result.zarr", "points-00000", "\x1b[2J", "\ud800", "0" * 64,
    "x" * 10**5, [], [[]], [None], ["a"], {}, {"": None}, {"points": 3}, {"points": {"latitude": 0}},
    {"a": {"b": {"c": [1, 2]}}},
]  # fmt: skip


@pytest.fixture
def stopped(runs: Runs, tmp_path) -> Path:
    """A folder in which two of four parts are done."""
    runs.stop(STUDY, tmp_path / "stopped")
    return tmp_path / "stopped"


@pytest.fixture
def finished(runs: Runs, tmp_path) -> Path:
    runs.run(ZARR, tmp_path / "finished")
    return tmp_path / "finished"


def change(path: Path, **keys: Any) -> None:
    """Change keys of a JSON file; ``...`` removes one."""
    content = {**json.loads(path.read_text()), **keys}
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not ...}))


@pytest.mark.parametrize("keys", [{"cuts": {}}, {"variables": []}, {"identity": 5}, {"format": "1"}], ids=str)
def test_a_store_that_is_described_wrongly(runs, stopped, keys):
    change(stopped / STORE, **keys)
    assert status_of(stopped).state == "damaged"
    assert not verify(stopped).ok
    with pytest.raises(HeliosweepError, match="--force"):
        runs.run(STUDY, stopped)
    assert len(runs.run(STUDY, stopped, force=True)) == 4
    assert verify(stopped).ok


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("bytes", size) for size in ("abc", None, -1, 1.5, 10**30)),
        *(("file", str(name)) for name in ("..", ".", "", "manifest.json", "/", "../finished/result.zarr")),
        ("file", None),
        ("file", []),
    ],
)
def test_a_manifest_of_another_file(finished, key, value):
    result = json.loads((finished / MANIFEST).read_text())["result"]
    change(finished / MANIFEST, result={**result, key: value})
    assert Finished.find(finished) is None
    assert status_of(finished).state == "damaged"
    assert f"result.{key}" in status_of(finished).detail
    assert any(f"manifest.json: is damaged: result.{key}" in problem for problem in verify(finished).problems)


def test_a_journal_of_other_parts(runs, stopped, caplog):
    before = status_of(stopped)
    with (stopped / JOURNAL).open("ab") as file:
        file.write(b"\n".join([*BAD_LINES, b""]).replace(b"points-00001", b"points-00009"))
        for seconds in ("NaN", "-1e9", "Infinity", "1e300", "1" + "0" * 400, "-Infinity", "1" * 5000):
            file.write(b'{"part": "points-00002", "failed": "no", "seconds": %s}\n' % seconds.encode())
    status = status_of(stopped)
    assert (status.done, status.total) == (2, 4)
    assert {*status.failed} <= {"points-00002", "points-00003"}
    assert 0 <= (status.seconds_left or 0) <= (before.seconds_left or 0)
    assert verify(stopped).found[0].startswith("2 of 4 parts are done")
    assert len(runs.run(STUDY, stopped)) == 2
    assert "goes on: 2 of 4 parts are done" in caplog.text


def test_one_bad_folder_does_not_hide_the_others(stopped, finished, tmp_path, monkeypatch):
    outputs = tmp_path / "outputs"
    for number, text in enumerate([DEEP, "[", "\0", "", "{}", "null", '"x"', "1" * 5000, "\udc80"]):
        for source, name in ((finished, MANIFEST), (stopped, STORE), (stopped, JOURNAL)):
            folder = outputs / f"{name.replace('/', '-')}-{number}"
            shutil.copytree(source, folder)
            (folder / name).write_text(text, errors="surrogateescape")
            if name == STORE:
                (folder / name).with_name("journal.jsonl").unlink()
    for name in (MANIFEST, STORE, JOURNAL):
        shutil.copytree(finished, outputs / f"folder-{name.replace('/', '-')}")
        (outputs / f"folder-{name.replace('/', '-')}" / name).unlink(missing_ok=True)
        (outputs / f"folder-{name.replace('/', '-')}" / name).mkdir(parents=True)
    (outputs / "link").symlink_to("link")
    shutil.copytree(finished, outputs / "good")
    statuses = [status_of(folder) for folder in result_folders(outputs)]
    assert len(statuses) == 9 * 3 + 3 + 1
    assert {status.folder.name: status.state for status in statuses}["good"] == "complete"
    assert {status.state for status in statuses} == {"complete", "damaged", "interrupted"}
    assert len(list(status_lines(statuses))) == len(statuses)
    for folder in result_folders(outputs):
        well = folder.name == "good" or folder.name.startswith(("working-journal", "folder-working"))
        assert verify(folder).ok == well, folder
    monkeypatch.setattr("heliosweep.runs.status.holder", Random)  # whatever it is that goes wrong
    assert status_of(finished).state


def test_files_in_a_group_that_are_none_of_it(runs, finished):
    for name in (".DS_Store", "mean/.nfs0001", "desktop.ini", "spring/Thumbs.db", "0 (copy)"):
        (finished / "result.zarr" / name).parent.mkdir(exist_ok=True)
        (finished / "result.zarr" / name).touch()
    done = verify(finished)
    assert done.ok, done.text
    assert "result.zarr: holds files that are none of Zarr's, and no harm: .DS_Store and 4 more" in done.notes
    assert runs.run(ZARR, finished) == []  # complete as it is
    chunk = next((finished / "result.zarr").glob("*efficiency*/0.0*"))
    chunk.with_name("9.9.9").touch()
    assert not verify(finished).ok


def mutated(text: str, random: Random) -> str:
    """Change a text, or the JSON in it or in one of its lines."""
    kind = random.randrange(9)
    if kind == 0:
        return text[: random.randrange(len(text))]
    if kind == 1:
        at = random.randrange(len(text))
        return text[:at] + random.choice(["", "\0", "[", "{", '"', "9", "-", "\n", DEEP]) + text[at + 1 :]
    if kind == 8:
        at = random.randrange(len(text))
        return text[:at] + chr(ord(text[at]) ^ 1 << random.randrange(7)) + text[at + 1 :]
    lines = text.splitlines() if text.count("\n{") else [text]
    at = random.randrange(len(lines))
    content = json.loads(lines[at])
    for _ in range(random.choice((1, 1, 2, 4))):
        found = list(places_of(content))
        if not found:
            break
        where, key = random.choice(found)
        if kind == 2:
            del where[key]
        elif kind == 3 and isinstance(where, dict):
            where[random.choice(["points-00009", "x", "\x1b", "time"])] = where.pop(key)
        else:
            where[key] = copy.deepcopy(random.choice(VALUES))
    lines[at] = json.dumps(content)
    return "\n".join(lines) + "\n"


def look(folder: Path) -> None:
    """Look at a folder in every way that changes nothing."""
    status = status_of(folder)
    assert status.state in ("complete", "interrupted", "damaged", "not run")
    assert not status.detail.startswith("cannot be read: "), status.detail  # nobody foresaw it
    assert 0 <= status.done <= status.total
    assert status.seconds_left is None or 0 <= status.seconds_left < 1e15
    assert len("\n".join(status_lines([status]))) < 10_000
    assert verify(folder).text


def run_again(runs: Runs, study: dict[str, Any], expected: dict[str, bytes], folder: Path) -> None:
    """Run a study in a folder that is damaged, as the messages advise, to the right result."""
    refused = ""
    try:
        runs.run(study, folder)
    except HeliosweepError as error:
        refused = str(error)
    if refused:
        if re.search(r"is a (folder|directory)", refused):
            move_away(folder)
        else:
            assert "--force" in refused
        runs.run(study, folder, force=True)
    assert content_of(folder) == expected
    if not verify(folder).ok:  # the bytes are right, and what else the manifest says of them is not
        move_away(folder)
        runs.run(study, folder, force=True)
        assert verify(folder).ok
    assert not leftovers(folder)


def move_away(folder: Path) -> None:
    """Remove empty folders where files should stand; somebody made them, so no run removes them."""
    for place in [path for path in folder.rglob("*") if path.is_dir() and not any(path.iterdir())]:
        place.rmdir()


def damage(path: Path, random: Random) -> str:
    """Damage a file in one of many ways; returns how."""
    content = path.read_bytes()
    at, bit, size = random.randrange(len(content)), random.randrange(8), random.choice((1, 100, 10**6))
    text = path.suffix in (".json", ".jsonl")
    how = random.choice([*["bit"] * 4, "cut", "zeros", "more", "twice", "deleted", "folder", *["text"] * 10 * text])
    new = {
        "bit": content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :],
        "cut": content[:at],
        "zeros": content[:at] + bytes(len(content[at : at + size])) + content[at + size :],
        "more": content + random.randbytes(size),
        "twice": content + content,
    }
    if how == "text":
        path.write_text(mutated(content.decode(), random), encoding="utf-8", errors="surrogatepass")
    elif how in new:
        path.write_bytes(new[how])
    else:
        path.unlink()
        if how == "folder":
            path.mkdir()
    return f"{how} at {at}"


@pytest.mark.parametrize("form", ["netcdf", "zarr"])
@pytest.mark.parametrize("state", ["stopped", "finished"])
@pytest.mark.attempts("corruptions", 130)
def test_any_damage_is_told_or_mended(runs: Runs, attempts, tmp_path, state, form):
    """Whatever is done to a file of a folder, looking at it tells, and the next run leaves the right result."""
    study = STUDY if form == "netcdf" else ZARR
    runs.run(study, tmp_path / "finished")
    expected = content_of(tmp_path / "finished")
    if state == "stopped":
        runs.stop(study, tmp_path / "stopped")
    source, folder = tmp_path / state, tmp_path / "copy"
    texts = {"finished": [MANIFEST, "study.resolved.yaml"], "stopped": [STORE, JOURNAL]}[state]
    every = [str(file.relative_to(source)) for file in sorted(source.rglob("*")) if file.is_file()]
    for number in attempts.numbers:
        random = Random(number)
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(source, folder)
        name = random.choice(random.choice((texts, every)))
        before = (folder / name).read_bytes()
        how = damage(folder / name, random)
        with attempts.at(f"{name}: {how}"):
            same = (folder / name).is_file() and (folder / name).read_bytes() == before
            of_result = name.startswith("result.")
            if not same and of_result:
                found = Finished.find(folder)
                assert found is None or not found.is_whole()
            if not of_result or form == "zarr" or number % 50 == 0:  # a process of its own reads damaged NetCDF files
                look(folder)
                assert same or not of_result or not verify(folder).ok
            run_again(runs, study, expected, folder)


def test_a_manifest_of_many_slabs_is_looked_at_quickly(small, tmp_path):
    folder = write_folder(tmp_path / "folder", small(), "result.zarr")
    manifest = json.loads((folder / MANIFEST).read_text())
    digests = {f"points-{number:05}": "0" * 64 for number in range(10**5)}
    change(folder / MANIFEST, slabs={**manifest["slabs"], "digests": digests})
    start = time.process_time()
    assert not verify(folder).ok
    assert api.status(folder)[0].state == "complete"
    assert time.process_time() - start < 4, "slower than 1 s on a machine that does nothing else"

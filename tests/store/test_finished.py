"""Results that are there already."""

from __future__ import annotations

import json
import os
from typing import Any

import pytest

from heliosweep import workflow
from heliosweep.store.finished import Finished, latest_identity, result_digest
from heliosweep.store.identity import identity_of


@pytest.fixture
def finished(small, tmp_path) -> Finished:
    workflow.run(small(), tmp_path / "out", report=False)
    found = Finished.find(tmp_path / "out")
    assert found
    return found


def test_found(small, finished):
    assert finished.path == finished.folder / "result.nc"
    assert finished.identity["study_id"] == small().study_id
    assert list(finished.digests) == ["points-00000"]
    assert finished.is_whole()
    identity = identity_of(small(receiver={"height": 61}), {})
    assert finished.changes(identity, "study") == "receiver.height: 60.0 -> 61.0"
    assert finished.changes(identity, "code") == ""


def test_not_whole(finished):
    with finished.path.open("r+b") as file:
        file.seek(-1, os.SEEK_END)
        file.write(b"\1")
    assert not finished.is_whole()
    finished.path.unlink()
    assert not finished.is_whole()
    assert Finished.find(finished.folder) is None


@pytest.mark.parametrize(
    "change",
    [
        {"result": None},
        {"result": {"file": "result.nc"}},
        {"result": {"file": 1, "sha256": "0"}},
        {"result": {"file": "other.nc", "sha256": "0"}},
        {"result": {"file": "result.nc", "sha256": None}},
        {"identity": None},
        {"identity": {"study": []}},
        {"parts": None},
        {"parts": {"digests": []}},
        {"parts": {"digests": {"points-00000": 1}}},
        {"result": {"file": "..", "sha256": "0"}},
        {"result": {"file": "result.nc", "sha256": "0", "bytes": "abc"}},
        {"result": {"file": "result.nc", "sha256": "0", "bytes": None}},
        {"result": {"file": "result.nc", "sha256": "0", "bytes": -1}},
    ],
)
def test_a_manifest_that_is_none(finished, change: dict[str, Any]):
    path = finished.folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    assert Finished.find(finished.folder) is None


@pytest.mark.parametrize("content", ["", "[]", "null", "\0", "{", "[" * 10**5])
def test_no_manifest(finished, content):
    (finished.folder / "manifest.json").write_text(content)
    assert Finished.find(finished.folder) is None


def test_a_manifest_never_leads_out_of_its_folder(finished, tmp_path):
    (tmp_path / "result.nc").touch()
    path = finished.folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["result"]["file"] = "../result.nc"
    path.write_text(json.dumps(manifest))
    assert Finished.find(finished.folder) is None


def test_the_latest_identity(small, finished, tmp_path):
    workflow.run(small(receiver={"height": 61}), tmp_path / "later", report=False)
    (tmp_path / "empty").mkdir()
    os.utime(finished.folder, (1e9, 1e9))
    found = latest_identity(tmp_path.iterdir())
    assert found
    assert found[0] == tmp_path / "later"
    assert latest_identity([tmp_path / "empty", tmp_path / "none"]) is None


def test_the_digest_of_a_folder_sees_names_and_contents(tmp_path):
    (tmp_path / "0.1").write_text("1")
    digests = {result_digest(tmp_path)}
    (tmp_path / "0.1").rename(tmp_path / "1.0")
    digests.add(result_digest(tmp_path))
    (tmp_path / "1.0").write_text("2")
    digests.add(result_digest(tmp_path))
    assert len(digests) == 3

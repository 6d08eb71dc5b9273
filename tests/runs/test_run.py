"""Runs: workers, failing parts, resuming, the code digest, progress and status, and keys of earlier versions."""

import logging
import sys
from typing import Any

import numpy as np
import pytest
from distributed import LocalCluster

from heliosweep import api, sources
from heliosweep.cli import main
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.families.family import Family
from heliosweep.store import folder as chunks
from heliosweep.store import writer
from tests.conftest import STUDIES

#: Eight chunks.
CHUNKS = {"latitude": 1, "tracking": 1, "heliostat": 30}


@pytest.fixture(scope="module")
def expected(small, tmp_path_factory) -> bytes:
    """Bytes of the result of one thread."""
    study = small(execution={"scheduler": "synchronous"})
    return api.run(study, tmp_path_factory.mktemp("expected"), report=False).path.read_bytes()


@pytest.mark.parametrize("scheduler", ["threads", "processes", "distributed"])
def test_all_workers_give_the_same_bytes(small, tmp_path, expected, scheduler):
    study = small(execution={"scheduler": scheduler, "workers": 2, "chunks": CHUNKS})
    assert api.plan(study).chunk_count == 8
    assert api.run(study, tmp_path / "out", report=False).path.read_bytes() == expected
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        ".heliosweep.lock", "manifest.json", "result.nc", "study.resolved.yaml"
    }  # fmt: skip


def test_a_cluster_at_an_address_and_one_by_its_class(small, tmp_path, expected):
    with LocalCluster(
        n_workers=1, threads_per_worker=2, protocol="tcp://", processes=False, dashboard_address=None
    ) as cluster:
        study = small(execution={"scheduler": cluster.scheduler_address, "chunks": CHUNKS})
        assert api.run(study, tmp_path / "a", report=False).path.read_bytes() == expected
    keywords = {"class": "distributed.LocalCluster", "processes": False, "dashboard_address": ":0"}
    study = small(execution={"scheduler": "distributed", "cluster": keywords, "workers": 1})
    assert api.run(study, tmp_path / "b", report=False).path.read_bytes() == expected
    study = small(execution={"scheduler": "distributed", "cluster": {"class": "distributed.Nothing"}})
    with pytest.raises(StudyError, match=r"execution\.cluster: cannot start"):
        api.run(study, tmp_path / "c", report=False)
    with pytest.raises(StudyError, match=r"no dask scheduler answers at tcp://127\.0\.0\.1:9"):
        api.run(small(execution={"scheduler": "tcp://127.0.0.1:9"}), tmp_path / "d", report=False)
    assert not (tmp_path / "d").exists()


def test_workers_with_other_versions_are_refused(small, tmp_path, monkeypatch):
    with LocalCluster(n_workers=1, dashboard_address=None) as cluster:
        study = small(execution={"scheduler": cluster.scheduler_address})
        monkeypatch.setattr(sources, "version_of", lambda _: "1.0")
        sources.code_versions.cache_clear()
        with pytest.raises(HeliosweepError, match=r"has other versions: numpy .* instead of 1\.0"):
            api.run(study, tmp_path / "out", report=False)
    sources.code_versions.cache_clear()


def test_a_part_is_tried_twice(small, tmp_path, expected, monkeypatch):
    known, calls = Family.compute, []

    def failing(self: Family, study: Any, inputs: Any, region: Any) -> Any:
        calls.append(region)
        if len(calls) == 3:
            raise MemoryError
        return known(self, study, inputs, region)

    monkeypatch.setattr(Family, "compute", failing)
    study = small(execution={"scheduler": "threads", "workers": 1, "chunks": CHUNKS})
    assert api.run(study, tmp_path / "out", report=False).path.read_bytes() == expected
    assert len(calls) == 9


def test_parts_that_fail_are_named_and_the_others_are_stored(small, tmp_path, expected, monkeypatch, caplog):
    known = Family.compute

    def failing(self: Family, study: Any, inputs: Any, region: Any) -> Any:
        if region["latitude"].start == 1 and region["heliostat"].start == 0:
            raise ZeroDivisionError("no sun")
        return known(self, study, inputs, region)

    study = small(execution={"workers": 1, "chunks": CHUNKS})
    monkeypatch.setattr(Family, "compute", failing)
    with pytest.raises(HeliosweepError) as error:
        api.run(study, tmp_path / "out", report=False)
    assert str(error.value).startswith("2 of 8 chunks failed, each 2 times (6 stored): correct the cause")
    assert "latitude 40.0, tracking spinning_elevation, heliostat 0 to 29: ZeroDivisionError: no sun" in str(
        error.value
    )
    found = api.status(tmp_path / "out")[0]
    assert (found.state, found.done, found.total) == ("interrupted", 6, 8)
    assert "6 of 8 chunks done" in found.detail
    calls: list[Any] = []

    def counted(self: Family, study: Any, inputs: Any, region: Any) -> Any:
        calls.append(region)
        return known(self, study, inputs, region)

    monkeypatch.setattr(Family, "compute", counted)
    with caplog.at_level(logging.INFO, "heliosweep"):
        assert api.run(study, tmp_path / "out", report=False).path.read_bytes() == expected
    assert len(calls) == 2
    assert "resumes: 6 of 8 chunks are complete" in caplog.text


def test_damaged_parts_are_computed_again(small, tmp_path, expected, monkeypatch, caplog):
    study = small(execution={"chunks": CHUNKS})
    monkeypatch.setattr(writer, "write_result", _interrupted)
    with pytest.raises(HeliosweepError):
        api.run(study, tmp_path / "out", report=False)
    (folder,) = (tmp_path / "out").glob("chunks-*")
    for number, path in enumerate(sorted(folder.glob("*.npz"))[:4]):
        content = bytearray(path.read_bytes())
        content[len(content) // (number + 2)] ^= 1
        path.write_bytes(content[: len(content) // 2] if number == 3 else content)
    monkeypatch.undo()
    assert api.run(study, tmp_path / "out", report=False).path.read_bytes() == expected
    assert "is damaged and is computed again" in caplog.text


def _interrupted(*_: object) -> None:
    raise HeliosweepError("stopped here")


def test_parts_of_other_code_are_never_used(small, tmp_path, monkeypatch):
    study = small()
    monkeypatch.setattr(writer, "write_result", _interrupted)
    with pytest.raises(HeliosweepError):
        api.run(study, tmp_path / "out", report=False)
    (before,) = (tmp_path / "out").glob("chunks-*")
    known = sources.code_versions("heliosweep")
    monkeypatch.setattr("heliosweep.store.writer.code_versions", lambda *_: {**known, "numpy": "1.0"})
    with pytest.raises(HeliosweepError):
        api.run(study, tmp_path / "out", report=False)
    assert len([*(tmp_path / "out").glob("chunks-*")]) == 2
    assert before.exists()


def test_a_finished_result_is_found_and_a_forced_run_computes_it_again(small, tmp_path, caplog):
    path = api.run(small(), tmp_path / "out", report=False).path
    caplog.set_level(logging.INFO, "heliosweep")
    assert api.run(small(), tmp_path / "out", report=False).seconds == {}
    assert "is complete; --force" in caplog.text
    assert "compute" in api.run(small(), tmp_path / "out", report=False, force=True).seconds
    with pytest.raises(StudyError, match=r"the result of another study \(receiver\.height: 60"):
        api.run(small(receiver={"height": 70}), tmp_path / "out", report=False)
    path.write_bytes(path.read_bytes()[:-1])
    api.run(small(), tmp_path / "out", report=False)
    assert "is damaged and is computed again" in caplog.text


def test_one_latitude_of_a_lazy_result_computes_one_latitude(monkeypatch):
    study = api.load(STUDIES / "chong2012_table2.yaml")
    known, regions = Family.compute, []

    def counted(self: Family, study: Any, inputs: Any, region: Any) -> Any:
        regions.append(region)
        return known(self, study, inputs, region)

    monkeypatch.setattr(Family, "compute", counted)
    lazy = api.build(study)
    assert not regions
    one = lazy["field_optical_efficiency"].isel(latitude=0).compute(scheduler="synchronous")
    assert all(region["latitude"] == slice(0, 1) for region in regions)
    assert len(regions) == lazy.sizes["tracking"]
    whole = lazy.compute()
    np.testing.assert_array_equal(whole["field_optical_efficiency"].isel(latitude=0), one)
    assert whole.attrs["study_id"] == study.study_id
    assert api.build(study)["field_optical_efficiency"].data.name == lazy["field_optical_efficiency"].data.name


def test_keys_of_earlier_versions_are_read_with_a_note(small, caplog):
    job = {"queue": "long", "cores": 4, "directives": ["--x"]}
    study = small(execution={"profile": "far", "profiles": {"far": {"scheduler": "slurm", "job": job, "workers": 3}}})
    assert study.execution.cluster == {
        "class": "dask_jobqueue.SLURMCluster", "queue": "long", "cores": 4, "job_extra_directives": ["--x"]
    }  # fmt: skip
    assert (study.execution.scheduler, study.execution.workers) == ("distributed", 3)
    assert "profile and profiles are deprecated" in caplog.text
    with pytest.raises(StudyError, match=r"write 'scheduler: distributed' and 'cluster: \{class: dask_jobqueue"):
        small(execution={"scheduler": "slurm"})


def test_two_runs_in_one_folder_wait_for_each_other(small, tmp_path, caplog, expected):
    from threading import Thread

    found: list[bytes] = []
    study = small()

    def one() -> None:
        found.append(api.run(study, tmp_path / "out", report=False).path.read_bytes())

    threads = [Thread(target=one) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 3
    assert not [*(tmp_path / "out").glob(f"{chunks.CHUNKS}*")]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_termination_ends_like_ctrl_c(small, tmp_path, monkeypatch):
    import os
    import signal

    def terminated(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    (tmp_path / "study.yaml").write_text(small().to_yaml(tmp_path), encoding="utf-8")
    monkeypatch.setattr(writer, "write_result", terminated)
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert main(["run", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--no-report", "-q"]) == 4
    finally:
        signal.signal(signal.SIGTERM, before)

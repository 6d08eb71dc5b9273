"""Clusters of dask.distributed: the same values as threads, a bounded window, and nothing left behind."""

from __future__ import annotations

import copy
import gc
import logging
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest
import yaml

from heliosweep import workflow
from heliosweep.config.blocks import Execution
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.families.registry import families
from heliosweep.runtime import cluster, connect, versions
from heliosweep.store import fingerprint
from tests.conftest import SMALL
from tests.runtime.clusters import (
    Count,
    check,
    engine,
    free_port,
    outcomes,
    scheduler_and_workers,
    study_works,
    work,
)


@pytest.fixture(scope="module")
def local() -> Iterator[Any]:
    with engine() as started:
        yield started


def example(name: str) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(families()[name].example())
    return content


STUDIES = {
    "field": {**SMALL, "site": {"latitude": [0, 20, 40]}, "output": {"time_series": True}},
    "misalignment": example("misalignment"),
    "dish": example("dish_tracking"),
}


@pytest.mark.parametrize("name", STUDIES)
def test_same_bits_as_threads_and_no_compiling(name, local, recwarn):
    study = workflow.load(copy.deepcopy(STUDIES[name]))
    workflow.family_of(study).prepare(study)
    works = study_works(study)
    done = outcomes(local, iter(works))
    assert len(done) == len(works)
    for number, one in enumerate(works):
        values = done[number].values
        reference = one.lazy.compute(scheduler="threads")
        assert values is not None
        assert set(values) == set(reference.data_vars)
        for variable, array in reference.data_vars.items():
            assert values[str(variable)].tobytes() == array.to_numpy().tobytes(), variable
    assert not [said for said in recwarn if "large graph" in str(said.message)]
    assert set(local._client.run(compiled_kernels).values()) == {0}


def compiled_kernels() -> int:
    """Kernels that this process compiled instead of finding them in the cache."""
    import numba

    modules = [module for name, module in sys.modules.items() if name.startswith("heliosweep.kernels.")]
    known = {id(value): value for module in modules for value in vars(module).values()}
    dispatchers = [value for value in known.values() if isinstance(value, numba.core.dispatcher.Dispatcher)]
    return sum(sum(one.stats.cache_misses.values()) for one in dispatchers)


def test_progress_counts_blocks(local, monkeypatch):
    count = Count()
    monkeypatch.setattr(local, "_progress", count)
    outcomes(local, (work(number, blocks=4) for number in range(3)))
    assert count.blocks == 12


def test_a_part_that_always_fails(local):
    def fail(block: np.ndarray) -> np.ndarray:
        if block[0] == 103:
            raise FloatingPointError("a task that fails")
        return block

    done = outcomes(local, (work(number, fail) for number in range(4)))
    assert done[1].values is None
    assert isinstance(done[1].error, FloatingPointError)
    assert str(done[1].error) == "a task that fails"
    for number in (0, 2, 3):
        check(done[number])


@pytest.mark.parametrize("kind", [OSError, TimeoutError, ValueError])
def test_failures_that_resemble_those_of_the_cluster(kind, local):
    def fail(block: np.ndarray) -> np.ndarray:
        raise kind("of the task")

    assert isinstance(outcomes(local, iter([work(0, fail)]))[0].error, kind)


def test_a_part_that_fails_twice_is_tried_again(local, tmp_path):
    def fail(block: np.ndarray) -> np.ndarray:
        if block[0] == 0 and len(tries := list(tmp_path.iterdir())) < 2:
            (tmp_path / str(len(tries))).touch()
            raise ValueError("not yet")
        return block

    check(outcomes(local, iter([work(0, fail)]))[0])
    assert len(list(tmp_path.iterdir())) == 2


def test_errors_of_the_study_come_through_as_they_are(local):
    def fail(block: np.ndarray) -> np.ndarray:
        raise StudyError(Problem("is wrong", "site.latitude"))

    with pytest.raises(StudyError) as error:
        outcomes(local, iter([work(0, fail)]))
    assert error.value.problems == (Problem("is wrong", "site.latitude"),)
    check(outcomes(local, iter([work(1)]))[1])


@pytest.mark.parametrize(("bound", "value"), [("TASKS_IN_FLIGHT", 24), ("BYTES_IN_FLIGHT", 3 * 5 * 24)])
def test_the_window_is_bounded(bound, value, local, monkeypatch):
    monkeypatch.setattr(cluster, "BLOCKS_PER_WORKER", 10**6)
    monkeypatch.setattr(cluster, bound, value)
    pulled, most = 0, [0]

    def works() -> Iterator[Any]:
        nonlocal pulled
        for number in range(40):
            pulled += 1
            yield work(number, blocks=5)

    def tasks(dask_scheduler: Any) -> int:
        return len(dask_scheduler.tasks)

    done, ahead, before = 0, [], local._client.run_on_scheduler(tasks)
    for _ in local.run(works()):
        done += 1
        ahead.append(pulled - done)
        most.append(local._client.run_on_scheduler(tasks))
    assert done == 40
    assert 1 <= max(ahead) <= 4
    assert max(most) - before <= 60


def test_enough_in_flight_for_all_workers(local):
    pulled = 0

    def works() -> Iterator[Any]:
        nonlocal pulled
        for number in range(30):
            pulled += 1
            yield work(number, blocks=2)

    next(flow := local.run(works()))
    assert 4 <= pulled <= 10
    flow.close()


def test_a_part_larger_than_the_window(local, monkeypatch):
    monkeypatch.setattr(cluster, "TASKS_IN_FLIGHT", 1)
    assert len(outcomes(local, (work(number) for number in range(3)))) == 3


def test_a_worker_of_another_version(local, monkeypatch):
    own = fingerprint.code_versions()
    monkeypatch.setattr(fingerprint, "code_versions", lambda: {**own, "numpy": "1.0"})
    said = f"of the local cluster would compute with other versions: numpy {own['numpy']} instead of 1.0;"
    with pytest.raises(HeliosweepError, match=said):
        versions.check_workers(local._client, local._client.nthreads(), "the local cluster")


def test_nothing_of_it_is_open_to_others(local):
    listening = [local._client.scheduler.address, *local._client.nthreads()]
    assert all("//127.0.0.1:" in address for address in listening)


def test_workers_share_what_was_imported_and_collect_the_rest(local):
    collectors = local._client.run(lambda: (gc.isenabled(), gc.get_threshold()[0], gc.get_freeze_count()))
    assert all(enabled and between < 10_000 and frozen > 100_000 for enabled, between, frozen in collectors.values())


def test_the_dashboard_is_imported_when_somebody_looks(local):
    pytest.importorskip("bokeh")

    def pages(dask_scheduler: Any) -> int:
        return sum(hasattr(application, "app_paths") for application in dask_scheduler.http_application.applications)

    assert local._client.run_on_scheduler(pages) == 0
    for path in ("status", "", "workers"):
        with urllib.request.urlopen(local._client.dashboard_link.replace("status", path)) as page:
            assert b"bokeh" in page.read().lower()
    assert local._client.run_on_scheduler(pages) == 1


def test_nothing_is_left(monkeypatch, tmp_path, caplog, capfd):
    monkeypatch.chdir(tmp_path)
    caplog.set_level(logging.INFO, "heliosweep")
    pytest.importorskip("distributed")  # brings levels and settings of its own
    levels = {name: logging.getLogger(name).level for name in ("distributed", "tornado", "distributed.client")}
    settings, path = dask.config.get("distributed"), list(sys.path)
    with engine(workers=1) as started:
        outcomes(started, iter([work(0)]))
        flow = started.run(work(number, slow) for number in range(5))
        next(flow)
        before = time.monotonic()
    assert time.monotonic() - before < 3
    assert not list(tmp_path.iterdir())
    assert {name: logging.getLogger(name).level for name in levels} == levels
    assert dask.config.get("distributed") == settings
    assert sys.path == path
    assert [said.message for said in caplog.records if said.message.startswith("dashboard: http://127.0.0.1:")]
    assert capfd.readouterr().err == ""
    names = [thread.name for thread in threading.enumerate()]
    assert sum("IO loop" in name for name in names) <= 1  # that of the other tests


def slow(block: np.ndarray) -> np.ndarray:
    time.sleep(0.5)
    return block


def test_an_address_where_nobody_listens(monkeypatch):
    monkeypatch.setattr(connect, "PATIENCE", 2)
    address = f"tcp://127.0.0.1:{free_port()}"
    before = time.monotonic()
    with pytest.raises(StudyError, match=f"no dask scheduler answers at {address}; start one there with: dask"):
        cluster.worker_count(Execution(scheduler=address))
    assert time.monotonic() - before < 6


def test_an_address_where_nobody_listens_is_told_where_it_stands(monkeypatch, tmp_path):
    monkeypatch.setattr(connect, "PATIENCE", 1)
    path, address = tmp_path / "study.yaml", f"tcp://127.0.0.1:{free_port()}"
    path.write_text(yaml.safe_dump(dict(SMALL)) + f"execution:\n  scheduler: {address}\n")
    with pytest.raises(StudyError) as caught:
        workflow.plan(path)
    (problem,) = caught.value.problems
    assert (problem.file, problem.line) == (str(path), len(path.read_text().splitlines()))


@pytest.mark.long
def test_an_address_where_somebody_else_listens(monkeypatch):
    monkeypatch.setattr(connect, "PATIENCE", 3)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(StudyError, match="no dask scheduler answers"), engine(address):
            pass


def test_certificates_that_are_missing(monkeypatch):
    monkeypatch.setattr(connect, "PATIENCE", 2)
    address = f"tls://127.0.0.1:{free_port()}"
    with pytest.raises(StudyError, match=r"needs certificates, .* distributed.comm.tls.ca-file"), engine(address):
        pass


def test_a_scheduler_of_somebody_else(tmp_path, local):
    with scheduler_and_workers(tmp_path) as (address, _):
        with engine(address) as started:
            works = study_works(workflow.load(copy.deepcopy(STUDIES["field"])))
            here = outcomes(local, iter(works))
            for number, outcome in outcomes(started, iter(works)).items():
                same = here[number].values
                assert outcome.values is not None
                assert same is not None
                assert all(outcome.values[name].tobytes() == same[name].tobytes() for name in same)
        assert cluster.worker_count(Execution(scheduler=address)) == 2
    assert cluster.worker_count(Execution(scheduler="distributed")) is None


@pytest.fixture
def certificates(tmp_path) -> Callable[[], tuple[str, str]]:
    def make() -> tuple[str, str]:
        names = str(tmp_path / "cert.pem"), str(tmp_path / "key.pem")
        command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1"]
        try:
            subprocess.run([*command, "-out", names[0], "-keyout", names[1]], check=True, capture_output=True)
        except FileNotFoundError:
            pytest.skip("no openssl")
        return names

    return make


@pytest.mark.long
def test_encrypted(tmp_path, certificates):
    pytest.importorskip("distributed")  # brings settings of its own
    cert, key = certificates()
    options = ("--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key)
    settings = {"ca-file": cert, "client.cert": cert, "client.key": key}
    with scheduler_and_workers(tmp_path, 1, options, "tls") as (address, _):
        named = dask.config.set({f"distributed.comm.tls.{name}": value for name, value in settings.items()})
        with named, engine(address) as started:
            check(outcomes(started, iter([work(1)]))[1])


FAKE = """#!/bin/bash
case "$(basename "$0")" in
  sbatch)
    cp "$1" "$FAKE_FOLDER/script"
    setsid bash "$FAKE_FOLDER/script" >/dev/null 2>&1 &
    echo "Submitted batch job $!" ;;
  scancel) echo "$@" >>"$FAKE_FOLDER/cancelled"; kill -9 -- "-$1" ;;
esac
"""


@pytest.mark.long
def test_slurm(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    for name in ("sbatch", "scancel"):
        command = tmp_path / name
        command.write_text(FAKE)
        command.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{Path('/bin')}:{Path('/usr/bin')}")
    monkeypatch.setenv("FAKE_FOLDER", str(tmp_path))
    job = {"queue": "long", "account": "a1", "walltime": "1:00:00", "cores": 2, "directives": ["--exclusive"]}
    with engine("slurm", 2, job={**job, "setup": ["export HELLO=1"]}) as started:
        for outcome in outcomes(started, (work(number) for number in range(4))).values():
            check(outcome)
    script = (tmp_path / "script").read_text()
    for line in ("#SBATCH -p long", "#SBATCH -A a1", "#SBATCH -t 1:00:00", "#SBATCH --exclusive", "export HELLO=1"):
        assert line in script.splitlines()
    assert (tmp_path / "cancelled").read_text().split()


def test_a_queue_that_is_not_there(monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", "/nowhere")
    said = "oar is not usable from this machine: there is no command oarsub"
    with pytest.raises(StudyError, match=said), engine("oar"):
        pass


@pytest.mark.long
def test_a_queue_that_refuses(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    (tmp_path / "sbatch").write_text("#!/bin/sh\necho 'invalid account' >&2; exit 1\n")
    (tmp_path / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with (
        pytest.raises(HeliosweepError, match=r"the job queue refused a job: .*invalid account"),
        engine("slurm") as one,
    ):
        outcomes(one, iter([work(0)]))


@pytest.mark.long
def test_jobs_of_this_machine(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.chdir(tmp_path)
    touched = tmp_path / "touched"
    with engine("local-jobs", 2, job={"setup": [f"touch '{touched}'"]}) as started:
        for outcome in outcomes(started, (work(number) for number in range(4))).values():
            check(outcome)
    assert list(tmp_path.iterdir()) == [touched]

"""Clusters of dask.distributed: the same values as threads, a bounded window, and nothing left behind."""

from __future__ import annotations

import asyncio
import copy
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
from urllib.error import HTTPError

import dask
import pytest
import yaml
from distributed import Security
from distributed.comm import connect

from heliosweep import api
from heliosweep.config.execution import Execution
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.families.family import families
from heliosweep.grid.lazy import Work
from heliosweep.runs import cluster
from heliosweep.runs.executors import compute_parts
from tests.conftest import SMALL
from tests.runs.clusters import FakeWork, Pool, check, free_port, outcomes, parts, pool, scheduler_and_workers


@pytest.fixture(scope="module")
def local() -> Iterator[Pool]:
    with pool() as started:
        yield started


def example(name: str) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(families()[name].example())
    return content


STUDIES = {
    "field": {**SMALL, "site": {"latitude": [0, 20, 40]}, "output": {"time_series": True}},
    "draws": {**SMALL, "receiver": {"height": {"normal": [60, 1]}}, "sample": {"size": 16, "sensitivity": "sobol"}},
    "misalignment": example("misalignment"),
    "dish": example("dish_tracking"),
}


def work_of(content: dict[str, Any]) -> tuple[Work, Any]:
    study = api.load(copy.deepcopy(content))
    family, plan = api.family_of(study), api.plan(study)
    family.prepare(study)
    return Work(family, study, plan.variables, plan.workload.sizes), plan


@pytest.mark.parametrize("name", STUDIES)
def test_same_bits_as_here_and_no_compiling(name, local, recwarn):
    work, plan = work_of(STUDIES[name])
    done = outcomes(local, plan.parts(), work)
    assert set(done) == {part.name for part in plan.parts()}
    for part in plan.parts():
        values = done[part.name].values
        assert values is not None
        for variable, array in work.compute(part).items():
            assert values[variable].tobytes() == array.tobytes(), variable
    assert not [said for said in recwarn if "large graph" in str(said.message)]
    assert set(local.client.run(compiled_kernels).values()) == {0}


def compiled_kernels() -> int:
    """Kernels that this process compiled instead of finding them in the cache."""
    from heliosweep.kernels.compiled import compilations

    return compilations()


def test_a_part_that_always_fails(local):
    def fail(number: int) -> None:
        if number == 1:
            raise FloatingPointError("a task that fails")

    done = outcomes(local, parts(4), FakeWork(fail))
    assert done["points-00001"].values is None
    assert repr(done.pop("points-00001").error) == "FloatingPointError('a task that fails')"
    check(done)


@pytest.mark.parametrize("kind", [OSError, TimeoutError, ValueError])
def test_failures_that_resemble_those_of_the_cluster(kind, local):
    def fail(number: int) -> None:
        raise kind("of the task")

    assert isinstance(outcomes(local, parts(1), FakeWork(fail))["points-00000"].error, kind)


def test_a_part_that_fails_twice_is_tried_again(local, tmp_path):
    def fail(number: int) -> None:
        if number == 0 and len(tries := list(tmp_path.iterdir())) < 2:
            (tmp_path / str(len(tries))).touch()
            raise ValueError("not yet")

    check(outcomes(local, parts(3), FakeWork(fail)))
    assert len(list(tmp_path.iterdir())) == 2


def test_errors_of_the_study_come_through_as_they_are(local):
    def fail(number: int) -> None:
        raise StudyError(Problem("is wrong", "site.latitude"))

    with pytest.raises(StudyError) as error:
        outcomes(local, parts(3), FakeWork(fail))
    assert error.value.problems == (Problem("is wrong", "site.latitude"),)
    check(outcomes(local, parts(2)))


def test_few_parts_are_in_flight_and_enough_for_all_workers(local):
    taken, ahead = 0, []

    def counted() -> Iterator[Any]:
        nonlocal taken
        for part in parts(60):
            taken += 1
            yield part

    with local.computing(FakeWork()) as started:
        for done, _ in enumerate(compute_parts(started, counted()), start=1):
            ahead.append(taken - done)
    assert 4 <= max(ahead) <= started.room + 1


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX systems")
def test_dead_workers_are_replaced_and_only_the_part_that_kills_fails(tmp_path):
    def kill(number: int) -> None:
        import os
        import signal

        mark = tmp_path / str(number)
        if number == 3 or (number == 5 and not mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    with pool() as started:
        done = outcomes(started, parts(12), FakeWork(kill))
    assert done["points-00003"].values is None
    assert "its worker died" in str(done.pop("points-00003").error)
    check(done)


def test_a_worker_of_another_version(local, monkeypatch):
    own = cluster.code_versions(FakeWork.module)
    said = f"of the local cluster would compute with other versions: numpy {own['numpy']} instead of 1.0;"
    cluster.versions.cache_clear()
    try:
        monkeypatch.setattr(cluster, "code_versions", lambda module: {**own, "numpy": "1.0"})
        with pytest.raises(HeliosweepError, match=said):
            cluster.check_workers(local.client, "the local cluster", FakeWork.module)
    finally:
        cluster.versions.cache_clear()


@pytest.mark.parametrize("protocol", ["tls", "tcp"])
def test_nothing_of_it_is_open_to_others(local, protocol):
    listening = [local.client.scheduler.address, *local.client.nthreads()]
    assert all(address.startswith("tls://127.0.0.1:") for address in listening)
    others = Security.temporary().get_connection_args("client") if protocol == "tls" else {}

    async def ask(address: str) -> Any:
        comm = await connect(address, timeout=1, **others)
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    for address in listening:
        with pytest.raises((OSError, TimeoutError)):
            asyncio.run(asyncio.wait_for(ask(address.replace("tls", protocol)), 3))


def test_the_dashboard_is_shown_to_those_who_know_its_secret_address(caplog):
    caplog.set_level(logging.INFO, "heliosweep")
    with pool(workers=1):
        link = next(said.message for said in caplog.records if "dashboard: " in said.message).split()[1]
        for path in ("status", "workers"):
            with urllib.request.urlopen(link.replace("status", path)) as page:
                assert b"bokeh" in page.read().lower()
        host, secret = link.removeprefix("http://").split("/")[:2]
        assert len(secret) > 20
        for path in ("", "sitemap.json", "status", "workers", "info/main/workers.html", "json/counts.json", "metrics"):
            with pytest.raises(HTTPError, match="404"):
                urllib.request.urlopen(f"http://{host}/{path}")


def test_nothing_is_left(monkeypatch, tmp_path, caplog, capfd):
    monkeypatch.chdir(tmp_path)
    caplog.set_level(logging.INFO, "heliosweep")
    pytest.importorskip("distributed")  # brings levels and settings of its own
    levels = {name: logging.getLogger(name).level for name in ("distributed", "tornado", "distributed.client")}
    settings, path = dask.config.get("distributed"), list(sys.path)

    with pool(workers=1) as started, started.computing(FakeWork(lambda number: time.sleep(0.5))) as one:
        next(compute_parts(one, parts(5)))
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


def test_an_address_where_nobody_listens(monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    path, address = tmp_path / "study.yaml", f"tcp://127.0.0.1:{free_port()}"
    path.write_text(yaml.safe_dump(dict(SMALL)) + f"execution:\n  scheduler: {address}\n")
    assert api.plan(path).workers == 1  # which asks nobody
    said = f"no dask scheduler answers at {address}; start one there with: dask"
    with pytest.raises(StudyError, match=said) as caught:
        api.run(path, tmp_path / "out")
    (problem,) = caught.value.problems
    assert (problem.file, problem.line) == (str(path), len(path.read_text().splitlines()))


@pytest.mark.long
def test_an_address_where_somebody_else_listens(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 3)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(StudyError, match="no dask scheduler answers"), pool(address):
            pass


def test_certificates_that_are_missing(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 2)
    address = f"tls://127.0.0.1:{free_port()}"
    with pytest.raises(StudyError, match=r"needs certificates, .* distributed.comm.tls.ca-file"), pool(address):
        pass


def test_a_scheduler_of_somebody_else(tmp_path):
    work, plan = work_of(STUDIES["field"])
    with scheduler_and_workers(tmp_path) as (address, _):
        with pool(address) as started:
            for name, outcome in outcomes(started, plan.parts(), work).items():
                here = work.compute(next(part for part in plan.parts() if part.name == name))
                assert outcome.values is not None
                assert all(outcome.values[v].tobytes() == here[v].tobytes() for v in here)
        assert cluster.worker_count(Execution(scheduler=address), connect=True) == 2
    assert cluster.worker_count(Execution(scheduler="distributed"), connect=True) is None


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
        with named, pool(address) as started:
            check(outcomes(started, parts(2)))


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
    with pool("slurm", 2, job={**job, "setup": ["export HELLO=1"]}) as started:
        check(outcomes(started, parts(4)))
    script = (tmp_path / "script").read_text()
    for line in ("#SBATCH -p long", "#SBATCH -A a1", "#SBATCH -t 1:00:00", "#SBATCH --exclusive", "export HELLO=1"):
        assert line in script.splitlines()
    assert (tmp_path / "cancelled").read_text().split()


def test_a_queue_that_is_not_there(monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", "/nowhere")
    said = "oar is not usable from this machine: there is no command oarsub"
    with pytest.raises(StudyError, match=said), pool("oar"):
        pass


@pytest.mark.long
def test_a_queue_that_refuses(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    (tmp_path / "sbatch").write_text("#!/bin/sh\necho 'invalid account' >&2; exit 1\n")
    (tmp_path / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with (
        pytest.raises(HeliosweepError, match=r"the job queue refused a job: .*invalid account"),
        pool("slurm") as one,
    ):
        outcomes(one, parts(1))


@pytest.mark.long
def test_jobs_of_this_machine(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.chdir(tmp_path)
    touched = tmp_path / "touched"
    with pool("local-jobs", 2, job={"setup": [f"touch '{touched}'"]}) as started:
        check(outcomes(started, parts(4)))
    assert list(tmp_path.iterdir()) == [touched]

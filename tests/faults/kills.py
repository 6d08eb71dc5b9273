"""Runs that are killed or starved, at random moments and at chosen ones.

A `Nursery` is a process with everything loaded that forks a child for each run, so that a run takes as long as its
work. A child runs the command line as users do, only that its parts are small. It may be told to end itself, or to
find the disk full, at the n-th time that it touches a file in its folder.

`python -m tests.faults.kills` is the nursery.
"""

from __future__ import annotations

import atexit
import errno
import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import psutil
import yaml

from heliosweep.errors import HeliosweepError
from heliosweep.families.family import families
from heliosweep.grid import plan, regions
from heliosweep.runs.verify import verify
from heliosweep.store.manifest import Finished
from heliosweep.store.parts import PartStore
from tests.conftest import ROOT, SMALL
from tests.faults.attempts import Attempts

#: What is sent to runs; so many times before one is brought to its end.
SIGNALS, CHAIN = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL], 3
#: Parts in the works when a run with two workers is killed: handed out, and one that is being stored.
IN_FLIGHT = {"threads": 4 + 1, "processes": 4 + 1, "distributed": 2 + 3 * 2 + 1}
#: What makes parts as small as can be.
_EVALUATIONS = ((plan, "MIN_EVALUATIONS", 0), (plan, "MAX_PARTS", 10**9))
SMALL_PARTS = ((plan, "WANTED_PARTS", 10**9), *_EVALUATIONS, (regions, "SERIES_SLAB_BYTES", 8 * 2**10))


def _study(base: Mapping[str, Any] | str, scheduler: str = "threads", **blocks: Any) -> dict[str, Any]:
    """A study, or the example of a family, with other blocks."""
    known = yaml.safe_load(families()[base].example()) if isinstance(base, str) else base
    return {**known, "execution": {"scheduler": scheduler, "workers": 2}, **blocks}


_FIELD = {**SMALL, "site": {"latitude": [0, 10, 20, 30, 40, 50]}}
_SERIES: dict[str, Any] = {"time_series": True, "compression": "zlib", "compression_level": 1}
#: Studies of 20 to 130 parts: by every kind of workers, in both formats, of every family.
STUDIES = {
    "field": _study(_FIELD, output=_SERIES),
    "zarr": _study(_FIELD, output={**_SERIES, "format": "zarr"}),
    "processes": _study(_FIELD, "processes", output=_SERIES),
    "processes-zarr": _study(_FIELD, "processes", output={**_SERIES, "format": "zarr"}),
    "cluster": _study(_FIELD, "distributed", output=_SERIES),
    "cluster-zarr": _study(_FIELD, "distributed", output={**_SERIES, "format": "zarr"}),
    "dish": _study("dish_tracking", site={"latitude": [0, 20, 40, 60], "longitude": 0}),
    "misalignment": _study("misalignment", "processes", site={"latitude": [30, 40]}),
    "gazing": _study("backward_gazing", sun={"azimuth": [0, 30], "elevation": [50, 70]}),
}
#: Few parts, one after the other, so that every run touches the same files in the same order.
TINY = {**SMALL, "site": {"latitude": 40}, "execution": {"scheduler": "synchronous"}}
TINY_SERIES = {"time_series": True, "compression": "none"}


@dataclass
class Outcome:
    """How a run ended: exit code (negative for signals), standard error, parts begun, what was done to files."""

    code: int
    errors: str
    begun: list[str]
    touched: list[str]


def _begun_or_ended(nursery: Nursery, place: Path) -> bool:
    """True once a part of a run is done, or the run has ended."""
    return bool(done_parts(place)) or nursery.ended_by(0.0)


class Nursery:
    """Forks a child for each run, which says in `folder` what it does; a context manager."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._scratch = tempfile.TemporaryDirectory()  # with a name that leaves room for that of a socket
        self.scratch = Path(self._scratch.name)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)])}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.kills"],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._pid, self._running = 0, False

    def start(self, arguments: list[str], **faults: Any) -> int:
        """Begin a run; `faults` as in `_child`. Returns its process, which leads a group of its own."""
        for path in (self._log, self._begun, Path(f"{self._begun}.touched")):
            path.unlink(missing_ok=True)
        places = {"log": str(self._log), "begun": str(self._begun), "scratch": str(self.scratch)}
        self._say({"arguments": arguments, **places, **faults})
        self._pid, self._running = int(self._hear()), True
        return self._pid

    def began(self) -> bool:
        """Return whether the run obeys signals by now."""
        return self._begun.exists() or self.ended_by(0.0)

    def end(self) -> Outcome:
        """Wait for the run."""
        code, self._running = int(self._hear()), False
        return Outcome(code, self.log(), _lines(self._begun), _lines(Path(f"{self._begun}.touched")))

    def clear(self) -> None:
        """End a run that a test has left, and remove what it left."""
        if self._running:
            self.signal()
            self.end()
        for path in self.scratch.iterdir():
            shutil.rmtree(path, ignore_errors=True)

    @property
    def _log(self) -> Path:
        return self.folder / "child.log"

    @property
    def _begun(self) -> Path:
        return self.folder / "begun.log"

    def run(self, arguments: list[str], **faults: Any) -> Outcome:
        """Run to the end."""
        self.start(arguments, **faults)
        return self.end()

    def signal(self, number: int = signal.SIGKILL, whom: str = "group") -> bool:
        """Send a signal to the ``process`` of the run, the ``group`` of all it started, or a ``worker``, if any."""
        with suppress(ProcessLookupError, psutil.NoSuchProcess):
            if whom == "group":
                os.killpg(self._pid, number)
            elif whom == "process":
                os.kill(self._pid, number)
            else:
                helpers = psutil.Process(self._pid).children()
                workers = [worker for one in helpers for worker in one.children()]
                for worker in workers[:1]:
                    worker.send_signal(number)
                return bool(workers)
            return True
        return False

    def ended_by(self, deadline: float) -> bool:
        """Wait for the end of the run, but not for longer."""
        assert self._process.stdout is not None
        left = max(0.0, deadline - time.monotonic())
        ready, _, _ = select.select([self._process.stdout.fileno()], [], [], left)
        return bool(ready)

    def left(self) -> list[str]:
        """Return what is left of a run: its group, files for the time being, processes that have that folder."""
        with suppress(ProcessLookupError):
            os.killpg(self._pid, 0)
            return ["processes of its group"]
        if found := [path.name for path in self.scratch.iterdir()]:
            return found
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                if process.environ().get("TMPDIR") == str(self.scratch):
                    found.append(" ".join(process.cmdline()))
        return found

    def log(self) -> str:
        """What the run has said so far."""
        return self._log.read_text(encoding="utf-8", errors="replace") if self._log.exists() else ""

    def _say(self, order: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def _hear(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the nursery ended"
        return line

    def __enter__(self) -> Nursery:
        return self

    def __exit__(self, *_: object) -> None:
        with self._process as process:
            if process.stdin:
                process.stdin.close()
            process.wait(60)
        self._scratch.cleanup()


def wait_for(sight: Callable[[], object], seconds: float = 60) -> None:
    """Wait until something is to be seen."""
    deadline = time.monotonic() + seconds
    while not sight():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def write_study(folder: Path, content: Mapping[str, Any], name: str = "study.yaml") -> Path:
    """Write a study file."""
    path = folder / name
    path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
    return path


def interrupt_and_resume(nursery: Nursery, name: str, attempts: Attempts, seed: int) -> None:
    """Send runs of one of the studies signals at random moments, and bring every one to its end.

    They go in turn to the process of the run, to it with all that it started, and to a worker process, where it has
    any: the run itself goes on then. Otherwise it is run again, and that run may be interrupted too. No part that was
    done may be lost, no more be redone than was in the works, no process and no temporary file be left, and the result
    must be that of a run in peace.
    """
    random, place, scheduler = Random(seed), nursery.folder / "out", STUDIES[name]["execution"]["scheduler"]
    command = ["run", str(write_study(nursery.folder, STUDIES[name])), "--quiet", "--no-report", "--output"]
    start = time.monotonic()
    peace = nursery.run([*command, str(nursery.folder / "peace")])
    whole = time.monotonic() - start
    assert peace.code == 0, peace.errors
    assert len(set(peace.begun)) == len(peace.begun) >= 20
    expected = content_of(nursery.folder / "peace")

    def check_result() -> None:
        assert content_of(place) == expected
        assert not leftovers(place), leftovers(place)
        assert verify(place).ok, verify(place).text
        shutil.rmtree(place)

    def interrupted(number: int, whom: str) -> None:
        """Send one signal to a run, of the study anew where the last one is done; one that comes too late is none."""
        code = 0
        while not code:
            before, finished = done_parts(place), Finished.find(place) is not None  # by a run that was killed after it
            nursery.start([*command, str(place)])
            wait_for(nursery.began)
            # As many of them early as late: what is left to do grows less from one to the next.
            delay = random.uniform(0.0, whole * random.choice((0.3, 0.6, 0.9)))
            if whom == "worker":  # workers that do not start are told of; those that have begun are replaced
                wait_for(partial(_begun_or_ended, nursery, place))
                delay /= 10
            sent = not nursery.ended_by(time.monotonic() + delay) and nursery.signal(number, whom)
            outcome = nursery.end()
            code = outcome.code
            with suppress(AssertionError):
                wait_for(lambda: not nursery.left(), 20)
            assert not (left := nursery.left()), left
            after, again = done_parts(place), {name for name, n in Counter(outcome.begun).items() if n > 1}
            if unfinished := (place / "working").exists():
                assert after.items() >= before.items(), "lost parts"
                again |= (set(outcome.begun) - after.keys()) if code else set()
            assert unfinished or Finished.find(place) or not before, "lost all parts"
            assert not before.keys() & set(outcome.begun), "computed what was done"
            assert len(again) <= IN_FLIGHT[scheduler]
            said = [
                line
                for line in outcome.errors.splitlines()
                if not line.startswith(("goes on: ", "dashboard: ", "compil"))
                and not (finished and " is complete already" in line)
            ]
            if not code:
                assert not said, outcome.errors
                check_result()
                if sent and whom == "worker":
                    return
            elif number == signal.SIGKILL:
                assert (code, said, sent, whom != "worker") == (-number, [], True, True)
                assert unfinished or not outcome.begun or Finished.find(place), "lost all parts"
            else:
                assert (code, sent, whom != "worker") == (4, True, True), f"exit code {code}: {outcome.errors}"
                assert [line.partition(": ")[0] for line in said] == ["interrupted"], outcome.errors

    targets = ["process", "group", *["worker"] * (scheduler != "threads")]
    sends = [(number, whom) for number in SIGNALS for whom in targets]
    random.shuffle(sends)
    count = len(attempts.numbers)
    for first in range(0, count, CHAIN):
        chain = [sends[at % len(sends)] for at in range(first, min(first + CHAIN, count))]
        with attempts.at(f"{name}: {chain}", len(chain)):
            for number, whom in chain:
                interrupted(number, whom)
            outcome = nursery.run([*command, str(place)])
            assert outcome.code == 0, outcome.errors
            check_result()
        nursery.clear()
        shutil.rmtree(place, ignore_errors=True)


def done_parts(folder: Path) -> dict[str, bytes]:
    """Digest of each part that is done, in an unfinished folder."""
    try:
        done = PartStore.open(folder / "working").done
    except HeliosweepError:
        return {}
    return {name: done[name][-1] for name in done}


def content_of(folder: Path) -> dict[str, bytes]:
    """Bytes of the result: of the file, or of all that is in the folder."""
    path = next(place for name in ("result.nc", "result.zarr") if (place := folder / name).exists())
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in sorted(files)}


def leftovers(folder: Path) -> list[str]:
    """What no finished folder should hold."""
    wanted = {"result.nc", "result.zarr", "report.html", "figures", "manifest.json", "study.resolved.yaml"}
    hidden = [path.name for path in folder.rglob(".*") if path.name.endswith((".part", ".partial", ".lock"))]
    return sorted({path.name for path in folder.iterdir()} - wanted) + hidden


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


# In the nursery.


def _nurse() -> None:
    """Fork a child for each order that comes."""
    from importlib import import_module

    from heliosweep import api

    late = (
        "matplotlib.pyplot",
        "zarr",
        "distributed",
        "distributed.dashboard.scheduler",
        "distributed.http.scheduler.api",
    )
    for name in (*late, "heliosweep.cli", "heliosweep.report.page", "heliosweep.runs.run", "heliosweep.runs.cluster"):
        import_module(name)
    ready: set[str] = set()
    for line in sys.stdin:
        order = json.loads(line)
        name = order["arguments"][1]
        if name not in ready:  # load all that is loaded late, but start no thread: none outlives a fork
            study = api.load(name)
            api.family_of(study).prepare(study)
            ready.add(name)
        pid = os.fork()
        if not pid:
            os.setsid()
            code = 70
            try:
                code = _child(**order)
            except SystemExit as end:
                code = int(end.code or 0)
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                for number in SIGNALS[:-1]:
                    signal.signal(number, signal.SIG_IGN)
                threading._shutdown()  # type: ignore[attr-defined]  # as a process ends, but for the interpreter
                atexit._run_exitfuncs()
                sys.stderr.flush()
                os._exit(code)
        print(pid, flush=True)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _child(
    arguments: list[str],
    log: str,
    begun: str,
    scratch: str,
    watch: str = "",
    kill_at: int = 0,
    full_at: int = 0,
    setup: str = "",
) -> int:
    """Run the command line after the Python of `setup`.

    Standard error goes to the file `log`, the names of the parts that are begun to `begun`, which is there as soon as
    signals are obeyed, temporary files to the folder `scratch`. In the folder `watch` the
    touching of files is noted; before number `kill_at` the process is killed, from `full_at` on the disk is full.
    """
    from heliosweep import cli
    from heliosweep.runs import cluster, executors
    from heliosweep.store import parts

    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(descriptor, 2)
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background may ignore it
    for owner, attribute, value in SMALL_PARTS:
        setattr(owner, attribute, value)

    def noted(submit: Any) -> Any:
        def submitting(pool: Any, part: Any) -> Any:
            with open(begun, "a", encoding="utf-8") as file:  # noqa: PTH123
                print(part.name, file=file)
            return submit(pool, part)

        return submitting

    for pool in (executors.Pool, executors._Processes, cluster._Cluster):
        setattr(pool, "submit", noted(pool.submit))  # noqa: B010  (a method)
    if setup:
        exec(setup, {"arguments": arguments})
    if watch:
        parts.SYNC_SECONDS = 1e6  # the disk is waited for at the same moments in every run
        _Watch(watch, f"{begun}.touched", kill_at, full_at).begin()
    os.environ["TMPDIR"], tempfile.tempdir = scratch, None
    sys.argv = ["heliosweep", *arguments]
    command = cli.COMMANDS["run"]

    def begin(options: Any) -> None:
        Path(begun).touch()
        command(options)

    cli.COMMANDS["run"] = begin
    return int(cli.main())  # as a process of its own: signals that come when it has been stopped are ignored


class _Watch:
    """Counts what is done to files below a folder, and lets one of these end the process or fail."""

    _EVENTS = ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.truncate")

    def __init__(self, folder: str, log: str, kill_at: int, full_at: int) -> None:
        self._folder = folder
        self._log = open(log, "a", encoding="utf-8")  # noqa: PTH123, SIM115
        self._kill_at, self._full_at = kill_at, full_at
        self._count = 0
        self._lock = threading.Lock()

    def begin(self) -> None:
        os.fsync, os.write = self._watched("fsync"), self._watched("write")
        sys.addaudithook(self._audit)

    def _watched(self, name: str) -> Any:
        call = getattr(os, name)

        def watched(descriptor: int, *said: Any) -> Any:
            path = Path(f"/proc/self/fd/{descriptor}").readlink()
            if path.is_relative_to(self._folder):
                self._touch(name, str(path))
            return call(descriptor, *said)

        return watched

    def _audit(self, event: str, said: tuple[Any, ...]) -> None:
        if event not in self._EVENTS:
            return
        if event == "open" and not (isinstance(said[2], int) and said[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)):
            return
        paths = [Path(os.fsdecode(one)) for one in said[:2] if isinstance(one, str | bytes | os.PathLike)]
        # What rmtree removes it names relative to a folder's descriptor.
        if any(path.is_relative_to(self._folder) or not path.is_absolute() for path in paths):
            self._touch(event.removeprefix("os."), str(paths[-1]))

    def _touch(self, what: str, path: str) -> None:
        with self._lock:  # zarr writes from several threads
            self._count += 1
            number = self._count
            self._log.write(f"{what} {kind_of(path)}\n")
            self._log.flush()
        if number == self._kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
        if self._full_at and number >= self._full_at and what not in ("remove", "rmdir", "rename"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)


def kind_of(path: str) -> str:
    """Name of a file without what is different from run to run and from chunk to chunk."""
    name = re.sub(r"[0-9a-f]{32}", "#", Path(path).name)
    return re.sub(r"\d+", "0", re.sub(r"^\.(.*?)\.[^.]*\.\d+-[^.]*\.part$", r"\1.part", name))


if __name__ == "__main__":
    _nurse()

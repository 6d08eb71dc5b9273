"""Runs that are killed or starved, at random moments and at chosen ones.

A `Nursery` is a process with everything loaded that forks a child for each run, so that a run takes as long as its
work. A child runs the command line as users do, only that its parts are small. It may be told to end itself, or to
find the disk full, at the n-th time that it touches a file in its folder.

`python -m tests.faults.kills` is the nursery.
"""

from __future__ import annotations

import errno
import json
import os
import re
import select
import signal
import subprocess
import sys
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

#: Parts in the works when a run with two workers is killed: handed out, and one that is being stored.
IN_FLIGHT = {"threads": 4 + 1, "processes": 4 + 1, "distributed": 2 + 3 * 2 + 1}
#: What makes parts as small as can be.
SMALL_PARTS = ((plan, "WANTED_PARTS", 10**9), (plan, "LEAST_SECONDS", 0.0), (regions, "SERIES_SLAB_BYTES", 8 * 2**10))


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
        self._say({"arguments": arguments, "log": str(self._log), "begun": str(self._begun), **faults})
        self._pid, self._running = int(self._hear()), True
        return self._pid

    def end(self) -> Outcome:
        """Wait for the run."""
        code, self._running = int(self._hear()), False
        return Outcome(code, self.log(), _lines(self._begun), _lines(Path(f"{self._begun}.touched")))

    def clear(self) -> None:
        """End a run that a test has left."""
        if self._running:
            self.signal()
            self.end()

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

    def alone(self) -> bool:
        """Wait until nothing that the run started is left; False where something stays."""
        with suppress(ProcessLookupError):
            for _ in range(1500):
                os.killpg(self._pid, 0)
                time.sleep(0.02)
            return False
        return True

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


@dataclass
class Tally:
    """Kills, runs (killed or not), studies brought to their end, and parts begun again after the worst kill."""

    kills: int = 0
    runs: int = 0
    finished: int = 0
    most_redone: int = 0


def wait_for(sight: Callable[[], object]) -> None:
    """Wait until something is to be seen."""
    deadline = time.monotonic() + 60
    while not sight():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def write_study(folder: Path, content: Mapping[str, Any], name: str = "study.yaml") -> Path:
    """Write a study file."""
    path = folder / name
    path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
    return path


def kill_and_resume(nursery: Nursery, name: str, arguments: list[str], kills: int, seed: int) -> Tally:
    """Kill runs of one of the studies at random moments, `kills` times, and bring every one to its end.

    Killed are in turn the process of the run, it with all that it started, and a worker process, where it has any: the
    run itself goes on then. No part that was done may be lost, no more be redone than was in the works, no process be
    left, and the result must be that of a run in peace.
    """
    random, tally, folder, scheduler = Random(seed), Tally(), nursery.folder, STUDIES[name]["execution"]["scheduler"]
    study = write_study(folder, STUDIES[name])
    command = ["run", str(study), "--quiet", *arguments, "--output"]
    whom = ["process", "group"] + ["worker"] * (scheduler != "threads")
    assert nursery.run([*command, str(folder / "warm")]).code == 0  # compiles, where nobody has
    start = time.monotonic()
    peace = nursery.run([*command, str(folder / "peace")])
    whole = time.monotonic() - start
    assert peace.code == 0, peace.errors
    assert len(peace.begun) >= 20
    assert len(set(peace.begun)) == len(peace.begun)
    expected = content_of(folder / "peace")
    while tally.kills < kills:
        place, code = folder / f"out{tally.finished}", -1
        before: dict[str, bytes] = {}
        while code:
            nursery.start([*command, str(place)])
            tally.runs += 1
            # As many of them early as late: what is left to do grows less from kill to kill.
            delay = random.uniform(0.0, whole * random.choice((0.3, 0.6, 1.1)))
            killed, one = False, whom[tally.kills % len(whom)]
            if one == "worker":  # workers that do not start are told of; those that have begun are replaced
                wait_for(partial(_begun_or_ended, nursery, place))
                delay /= 10
            deadline = time.monotonic() + delay
            if tally.kills < kills and not nursery.ended_by(deadline):
                killed = nursery.signal(whom=one)
            outcome = nursery.end()
            code = outcome.code
            tally.kills += killed and (code != 0 or one == "worker")
            assert code == 0 or (killed and code == -signal.SIGKILL), f"exit code {code}: {outcome.errors}"
            assert nursery.alone(), f"the kill of the {one} left processes"
            after = done_parts(place)
            if unfinished := (place / "working").exists():
                assert after.items() >= before.items(), f"kill {tally.kills} lost parts"
            assert unfinished or not outcome.begun or Finished.find(place), f"kill {tally.kills} lost all parts"
            assert not before.keys() & set(outcome.begun), "computed what was done"
            assert "damaged" not in outcome.errors
            assert "Traceback" not in outcome.errors
            again = {name for name, times in Counter(outcome.begun).items() if times > 1}
            if code and unfinished:
                again |= set(outcome.begun) - after.keys()
            tally.most_redone = max(tally.most_redone, len(again))
            before = after
        tally.finished += 1
        assert content_of(place) == expected
        assert not leftovers(place)
        assert verify(place).ok, verify(place).text
    assert tally.most_redone <= IN_FLIGHT[scheduler]
    return tally


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

    for name in ("matplotlib.pyplot", "zarr", "heliosweep.cli", "heliosweep.report.page", "heliosweep.runs.run"):
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
                sys.stderr.flush()
                os._exit(code)
        print(pid, flush=True)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _child(
    arguments: list[str],
    log: str,
    begun: str,
    watch: str = "",
    kill_at: int = 0,
    full_at: int = 0,
    setup: str = "",
) -> int:
    """Run the command line after the Python of `setup`.

    Standard error goes to the file `log`, the names of the parts that are begun to `begun`. In the folder `watch` the
    touching of files is noted; before number `kill_at` the process is killed, from `full_at` on the disk is full.
    """
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
    return int(_main(arguments))


def _main(arguments: list[str]) -> int:
    from heliosweep.cli import main

    sys.argv = ["heliosweep", *arguments]
    return main()  # as a process of its own: signals that come when it has been stopped are ignored


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

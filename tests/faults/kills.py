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
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import yaml

from heliosweep.runtime.verify import verify
from heliosweep.store.finished import Finished
from heliosweep.store.journal import Journal
from tests.conftest import ROOT, SMALL

#: Parts in the works when a run is killed: two computed, one handed over, one stored.
IN_FLIGHT = 4
#: What a finished folder holds.
WHOLE = {"manifest.json", "study.resolved.yaml"}

_GAZING: dict[str, Any] = {
    "family": "backward_gazing",
    "heliostat": {"distance": 120, "pixel": 0.3},
    "target": {"azimuth": 0, "elevation": 44},
    "sun": {"azimuth": [0, 15, 30, 45, 60], "elevation": [50, 60, 70, 80]},
    "defects": {"canting": {"2": [0, -1], "3": [0, 1]}},
    "method": ["A", "O1"],
    "erosion": 1,
    "output": {"maps": True},
}
_DISH: dict[str, Any] = {
    "family": "dish_tracking",
    "site": {"latitude": {"start": -60, "stop": 60, "step": 5}, "longitude": 0},
    "time": {
        "clock": "civil",
        "timezone": "+00:00",
        "dates": ["2021-03-20", "2021-06-21"],
        "window": {"start": "07:00", "stop": "17:00", "step": "30 min"},
        "sampling": "left",
    },
    "mount": {"model": "rigid"},
    "errors": {"axis_tilt": [0.05, 0.1, 0.2], "axis_tilt_direction": [0, 90, 180, 270]},
    "tolerance": "4 mrad",
}
_MISALIGNMENT: dict[str, Any] = {
    "family": "misalignment",
    "sun": {"azimuth": [101, 180, 260], "elevation": [30, 40, 50]},
    "receiver": {"height": 143, "azimuth": 0, "tilt": 0, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16, 150, 0], [-45, 150, 0], [20, 90, 0]]},
    "error": {"source": ["canting"], "axis": ["elevation", "azimuth"], "size": {"start": -30, "stop": 30, "step": 10}},
}
_FIELD = {**SMALL, "site": {"latitude": [0, 10, 20, 30, 40, 50]}}
_SERIES = {"time_series": True, "compression": "zlib", "compression_level": 1}

#: Studies of 20 to 130 parts.
STUDIES: dict[str, dict[str, Any]] = {
    "field": {**_FIELD, "output": _SERIES},
    "zarr": {**_FIELD, "output": {**_SERIES, "format": "zarr"}},
    "processes": {**_FIELD, "output": _SERIES, "execution": {"scheduler": "processes", "workers": 2}},
    "dish": _DISH,
    "misalignment": _MISALIGNMENT,
    "gazing": _GAZING,
}
#: Few parts, one after the other, so that every run touches the same files in the same order.
TINY = {**SMALL, "site": {"latitude": 40}, "execution": {"scheduler": "synchronous"}}
TINY_SERIES = {"time_series": True, "compression": "none"}


@dataclass
class Outcome:
    """How a run ended.

    Parameters
    ----------
    code : int
        Exit code, negative for signals.
    errors : str
        Its standard error.
    begun : list of str
        Parts that were begun, in order.
    touched : list of str
        What was done to files in its folder, where that was asked for.
    """

    code: int
    errors: str
    begun: list[str]
    touched: list[str]


class Nursery:
    """Forks a child for each run; a context manager."""

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
        self._log = folder / "child.log"
        self._begun = folder / "begun.log"
        self._pid = 0

    def start(self, arguments: list[str], **faults: Any) -> int:
        """Begin a run; `faults` as in `_child`. Returns its process, which leads a group of its own."""
        for path in (self._log, self._begun, Path(f"{self._begun}.touched")):
            path.unlink(missing_ok=True)
        self._say({"arguments": arguments, "log": str(self._log), "begun": str(self._begun), **faults})
        self._pid = int(self._hear())
        return self._pid

    def end(self) -> Outcome:
        """Wait for the run."""
        code = int(self._hear())
        return Outcome(
            code,
            self._log.read_text(encoding="utf-8", errors="replace") if self._log.exists() else "",
            _lines(self._begun),
            _lines(Path(f"{self._begun}.touched")),
        )

    def run(self, arguments: list[str], **faults: Any) -> Outcome:
        """Run to the end."""
        self.start(arguments, **faults)
        return self.end()

    def signal(self, number: int = signal.SIGKILL) -> None:
        """Send a signal to the run and, if it is to be killed, to the processes that it started."""
        with suppress(ProcessLookupError):
            if number == signal.SIGKILL:
                os.killpg(self._pid, number)
        with suppress(ProcessLookupError):
            os.kill(self._pid, number)

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
    """What killing came to.

    Parameters
    ----------
    kills : int
        Runs that were killed before they ended.
    runs : int
        Runs, killed or not.
    redone : int
        Parts that were begun again, all kills together.
    most_redone : int
        The same, for the worst kill.
    finished : int
        Studies that were brought to their end.
    """

    kills: int = 0
    runs: int = 0
    redone: int = 0
    most_redone: int = 0
    finished: int = 0


def write_study(folder: Path, content: Mapping[str, Any], name: str = "study.yaml") -> Path:
    """Write a study file."""
    path = folder / name
    path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
    return path


def kill_and_resume(
    nursery: Nursery, study: Path, arguments: list[str], kills: int, seed: int, least: float = 0.0
) -> Tally:
    """Kill runs of a study at random moments until there were `kills` kills, and bring every one to its end.

    Raises
    ------
    AssertionError
        Where a part that was done is lost, more is redone than was in the works, or the result is another one than
        that of a run in peace.
    """
    random, tally, folder = Random(seed), Tally(), nursery.folder
    command = ["run", str(study), "--quiet", *arguments, "--output"]
    assert nursery.run([*command, str(folder / "warm")]).code == 0  # compiles, where nobody has
    start = time.monotonic()
    peace = nursery.run([*command, str(folder / "peace")])
    whole = time.monotonic() - start
    assert peace.code == 0, peace.errors
    assert len(peace.begun) >= 20
    assert len(set(peace.begun)) == len(peace.begun)
    expected = content_of(folder / "peace")
    while tally.kills < kills:
        place = folder / f"out{tally.finished}"
        before: dict[str, str] = {}
        while True:
            nursery.start([*command, str(place)])
            tally.runs += 1
            # As many of them early as late: what is left to do grows less from kill to kill.
            delay = random.uniform(least, whole * random.choice((0.3, 0.6, 1.1)))
            deadline = time.monotonic() + delay if tally.kills < kills else float("inf")
            outcome = _killed_at(nursery, deadline)
            after = done_parts(place)
            lost = {name for name, digest in before.items() if after.get(name) != digest}
            assert not lost, f"lost {sorted(lost)} with kill {tally.kills}"
            assert not before.keys() & set(outcome.begun), "computed what was done"
            assert outcome.code in (0, -signal.SIGKILL), f"exit code {outcome.code}: {outcome.errors}"
            assert "damaged" not in outcome.errors
            assert "Traceback" not in outcome.errors
            before = after
            if outcome.code == 0:
                break
            tally.kills += 1
            again = len(set(outcome.begun) - after.keys())
            tally.redone += again
            tally.most_redone = max(tally.most_redone, again)
        tally.finished += 1
        assert content_of(place) == expected
        assert not leftovers(place)
        assert verify(place).ok, verify(place).text
    assert tally.most_redone <= IN_FLIGHT
    return tally


def _killed_at(nursery: Nursery, deadline: float) -> Outcome:
    """Wait for a run until a moment, then kill it."""
    marker = nursery._process.stdout
    assert marker is not None
    import select

    left = deadline - time.monotonic()
    ready, _, _ = select.select([marker], [], [], None if left == float("inf") else max(0.0, left))
    if not ready:
        nursery.signal()
    return nursery.end()


def done_parts(folder: Path) -> dict[str, str]:
    """Digest of each part that is done, in an unfinished folder or in a finished one."""
    journal = Journal.read(folder / "working" / "journal.jsonl").done
    finished = Finished.find(folder)
    if finished and not (folder / "working").exists():
        return dict(finished.digests)
    return dict(journal)


def content_of(folder: Path) -> dict[str, bytes]:
    """Bytes of the result: of the file, or of all that is in the folder."""
    path = next(place for name in ("result.nc", "result.zarr") if (place := folder / name).exists())
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in sorted(files)}


def leftovers(folder: Path) -> list[str]:
    """What no finished folder should hold."""
    wanted = {"result.nc", "result.zarr", "report.html", "figures", *WHOLE}
    hidden = [path.name for path in folder.rglob(".*") if path.name.endswith((".part", ".partial", ".lock"))]
    return sorted({path.name for path in folder.iterdir()} - wanted) + hidden


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


# In the nursery.


def _nurse() -> None:
    """Fork a child for each order that comes."""
    from importlib import import_module

    from heliosweep import workflow
    from heliosweep.store.fingerprint import code_versions

    for name in ("matplotlib.pyplot", "zarr", "heliosweep.cli", "heliosweep.report.page", "heliosweep.runtime.run"):
        import_module(name)
    code_versions()
    for content in STUDIES.values():  # load all that is loaded late, but start no thread: none outlives a fork
        study = workflow.load(content)
        workflow.family_of(study).prepare(study)
    for line in sys.stdin:
        order = json.loads(line)
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
    part_seconds: float = 0.0,
    watch: str = "",
    kill_at: int = 0,
    full_at: int = 0,
    setup: str = "",
) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : list of str
        Of the command line.
    log, begun : str
        Files for standard error and for the names of the parts that are begun.
    part_seconds : float
        Work of a part; 0: every part is as small as can be.
    watch : str
        Folder in which the touching of files is noted.
    kill_at : int
        Number of the touch before which the process is killed.
    full_at : int
        Number of the touch from which on the disk is full.
    setup : str
        Python to be run first.
    """
    from heliosweep.grid import plan, slabs
    from heliosweep.runtime import execute

    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(descriptor, 2)
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(null, 1)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background may ignore it
    plan.PART_SECONDS, slabs.SERIES_PART_BYTES = part_seconds, 8 * 2**10
    works = execute._works

    def noted(*said: Any) -> Iterator[Any]:
        with open(begun, "a", encoding="utf-8") as file:  # noqa: PTH123
            for work in works(*said):
                print(work.part.name, file=file, flush=True)
                yield work

    execute._works = noted  # type: ignore[assignment]
    if setup:
        exec(setup, {"arguments": arguments})
    if watch:
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
        fsync = os.fsync

        def watched_fsync(descriptor: int) -> None:
            self._touch("fsync", str(Path(f"/proc/self/fd/{descriptor}").readlink()))
            fsync(descriptor)

        os.fsync = watched_fsync  # type: ignore[assignment]
        sys.addaudithook(self._audit)

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

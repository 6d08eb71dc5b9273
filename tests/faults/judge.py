"""Judges study files, and files that these name, in worker processes: long-lived, watched and short of memory.

A file is right where it gives a plan, or is refused with problems that say where they are. Everything else is a
*defect*: any other exception, a warning on the side, a message that is not fit for a terminal, too much time or memory.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import re
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import psutil

from heliosweep import api
from heliosweep.errors import HeliosweepError, PlanError, Problem, StudyError
from heliosweep.grid import machine as limits
from tests.faults import tables
from tests.faults.mutations import corpus, hostile_folder, mutated

#: What no study file may take before it runs: processor time, for the machine may be busy, and memory.
SECONDS, BYTES = 2.0, 200 * 2**20
#: After which a worker that waits for something that never comes is stopped. [s]
PATIENCE = 20
#: A run that is short enough to be tried, by its plan. [1], [bytes]
RUN_EVALUATIONS, RUN_BYTES = 100_000, 10**6

#: Before the seed, in the name of a table or image.
TABLE = "table or image "
#: Problems of a file as a whole, which no line can be named for.
_LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # as YAML counts lines
_WHOLE_FILE = ("cannot be read", "is larger than", "is not UTF-8", "and at least")


@dataclass(frozen=True)
class Verdict:
    """What became of one file: "plan", "refused", "ran" or "defect", and what is wrong with us then."""

    name: str
    outcome: str
    defect: str = ""
    seconds: float = 0.0
    """Processor time."""
    bytes: int = 0
    """Growth of the memory in use."""


class Overtime(BaseException):
    """The file took too long; no `Exception`, so that nothing catches it on the way."""


def complaints(problems: Iterable[Problem], path: str, text: str) -> Iterator[str]:
    """Yield what is wrong with the problems that a study file was refused with."""
    lines = _LINE_END.split(text)
    problems, longest = list(problems), max(map(len, lines))
    for problem in problems:
        if not problem.message or not problem.file:
            yield f"no message or no file: {problem!r}"
        said = f"{problem.key}: {problem.message}"
        if not said.isprintable():
            yield f"not fit for a terminal: {said!r}"
        if len(said) > 2000:
            yield f"{len(said)} characters long: {said[:200]!r}"
        if problem.file == path and not problem.message.startswith(_WHOLE_FILE):
            if problem.line is None or problem.column is None:
                yield f"not located: {problem!r}"
            elif not (1 <= problem.line <= len(lines) + 1 and 1 <= problem.column <= longest + 2):
                yield f"located outside of the file: {problem!r}"
    if not 1 <= len(problems) <= 101:
        yield f"{len(problems)} problems"


def judge(
    path: Path, text: str, name: str, run_into: Path | None = None, read: Callable[[Path], object] | None = None
) -> Verdict:
    """Load and plan a study file, and run it where it is tiny and `run_into` is given, with the limits above.

    Another file is given to `read` instead.
    """
    status = _peak_reset()
    start = time.process_time()
    defect, outcome, study, planned = "", "plan", None, None
    try:
        with _limits():
            if read is not None:
                read(path)
            else:
                study = api.load(path)
                planned = api.plan(study)
    except StudyError as error:
        outcome = "refused"
        defect = "\n".join(complaints(error.problems, "" if read else str(path), text))
    except PlanError as error:
        outcome = "refused"
        defect = "" if str(error).isprintable() else f"not fit for a terminal: {error!s:.500}"
    except BaseException as error:
        defect = _last_calls(error)
    seconds, grown = time.process_time() - start, _peak() - status
    if not defect and seconds > SECONDS:
        defect = f"took {seconds:.1f} s"
    if not defect and grown > BYTES:
        defect = f"took {grown / 1e6:.0f} MB"
    if run_into and not defect and study is not None and planned is not None and _is_tiny(study, planned):
        outcome = "ran"
        try:
            api.run(study, run_into, report=False)
        except HeliosweepError as error:
            defect = "" if str(error) else f"no message: {error!r}"
        except BaseException as error:
            defect = "when run: " + _last_calls(error)
        finally:
            shutil.rmtree(run_into, ignore_errors=True)
    return Verdict(name, "defect" if defect else outcome, defect, seconds, grown)


def _is_tiny(study: Any, planned: Any) -> bool:
    quick = (
        planned.workload.points * planned.workload.evaluations < RUN_EVALUATIONS
        and planned.output_bytes < RUN_BYTES
        and planned.part_count < 100
    )
    return quick and study.execution.scheduler in ("threads", "synchronous")


def _last_calls(error: BaseException) -> str:
    calls = traceback.extract_tb(error.__traceback__)
    ours = [call for call in calls if "heliosweep" in call.filename] or list(calls)
    place = " < ".join(f"{Path(call.filename).name}:{call.lineno} {call.name}" for call in reversed(ours[-4:]))
    return f"{type(error).__name__}: {error!s:.300} at {place}"


@contextmanager
def _limits() -> Iterator[None]:
    """Little memory, little time, and warnings that are errors."""

    def stop(*_: object) -> None:
        raise Overtime

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGPROF, stop), signal.signal(signal.SIGALRM, stop)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + BYTES, hard))
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])


def _peak_reset() -> int:
    """Forget the peak of the memory in use, where the system can; return what is in use. [bytes]."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _peak()


def _peak() -> int:
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _work(connection: Connection, folder: Path) -> None:
    """Judge what comes, until nothing does: seeds, or names and contents."""
    hostile_folder(folder)
    os.chdir(folder)
    limits.resource = None  # type: ignore[assignment]  # the plan shall not take our limits for those of the machine
    for number in range(30):  # imports what is imported late
        kind, content = tables.originals()[number % len(tables.originals())]
        (folder / "table").write_bytes(content)
        tables.READERS[kind](folder / "table")
    for number, text in enumerate(corpus()):
        path = folder / f"warm{number}.yaml"
        path.write_text(text, encoding="utf-8")
        api.plan(api.load(path))
    gc.collect()
    gc.freeze()
    connection.send(None)
    while (task := connection.recv()) is not None:
        name, content, run = task
        path, read = folder / "study.yaml", None
        if name.startswith(TABLE):
            kind, content = tables.mutated(int(name.removeprefix(TABLE)))
            path, read = folder / "table", tables.READERS[kind]
        elif content is None:
            content = mutated(int(name))
        text = content.decode("utf-8", errors="replace")
        path.write_bytes(content)
        verdict = judge(path, text, name, folder / "out" if run else None, read)
        gc.collect()
        connection.send(verdict)


class Pool:
    """Worker processes, replaced where a file ends one of them."""

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._folder = folder
        self._started = 0
        self._workers = [self._start() for _ in range(workers)]
        for _, connection in self._workers:
            connection.recv()

    def _start(self) -> tuple[Any, Connection]:
        ours, theirs = self._context.Pipe()
        self._started += 1
        worker = self._context.Process(
            target=_work, args=(theirs, self._folder / f"worker{self._started}"), daemon=True
        )
        worker.start()
        theirs.close()
        return worker, ours

    def judge(self, tasks: Iterable[tuple[str, bytes | None, bool]]) -> Iterator[Verdict]:
        """Yield what becomes of each file: (name, content, whether to run it).

        Without content the name is the seed of a mutated study file, or with `TABLE` before it of another file.
        """
        tasks = iter(tasks)
        busy: dict[Connection, tuple[str, float]] = {}
        idle = [connection for _, connection in self._workers]
        while True:
            while idle and (task := next(tasks, None)) is not None:
                connection = idle.pop()
                connection.send(task)
                busy[connection] = task[0], time.monotonic() + (15 if task[2] else 1) * 2 * PATIENCE
            if not busy:
                return
            ready = wait(list(busy), timeout=1)
            for connection in [one for one in busy if one in ready]:
                name, _ = busy.pop(connection)
                try:
                    yield connection.recv()
                    idle.append(connection)
                except EOFError:
                    yield Verdict(name, "defect", "ended the process")
                    idle.append(self._replace(connection))
            for connection, (name, deadline) in list(busy.items()):
                if time.monotonic() > deadline:
                    del busy[connection]
                    yield Verdict(name, "defect", "never came back")
                    idle.append(self._replace(connection))

    def one(self, content: bytes) -> Verdict:
        """Return what becomes of one file."""
        return next(iter(list(self.judge([("one", content, False)]))))

    def _replace(self, connection: Connection) -> Connection:
        position = next(i for i, (_, ours) in enumerate(self._workers) if ours is connection)
        worker, _ = self._workers[position]
        worker.kill()
        worker.join()
        self._workers[position] = self._start()
        connection = self._workers[position][1]
        connection.recv()
        return connection

    def close(self) -> None:
        """End the workers."""
        for worker, connection in self._workers:
            with suppress(OSError):
                connection.send(None)
            worker.join(5)
            worker.kill()

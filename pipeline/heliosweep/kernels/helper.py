"""A process that compiles kernels while this one does: a process compiles in one thread at a time.

It leaves what it has compiled in the cache. Where it does not, this process compiles it.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from heliosweep.processors import processors

_LOOK_SECONDS = 0.02
_LONGEST = 60.0
"""How long it is waited for in all, from its start. [s]"""
_one = threading.Lock()


class _Helper:
    tasks: tuple[str, ...] = ()
    process: subprocess.Popen[bytes] | None = None
    late: float = 0.0


@contextmanager
def beside(*tasks: str) -> Iterator[None]:
    """Let another process call functions of `kernels.warm`, as soon as this one compiles something in the context.

    It is waited for at the end of the context. `tasks` are calls, as in Python. There is one such process at a time.
    """
    if not _one.acquire(blocking=False):
        yield
        return
    _Helper.tasks = tasks
    try:
        yield
        if _Helper.process:
            with suppress(subprocess.TimeoutExpired):
                _Helper.process.wait(max(0.0, _Helper.late - time.monotonic()))
    finally:
        if _Helper.process:
            with _Helper.process as process:
                process.kill()
        _Helper.tasks, _Helper.process = (), None
        _one.release()


def start() -> None:
    """Start the process, where one is wanted and there is a core for it."""
    if not _Helper.tasks or processors() == 1:
        return
    from numba import config

    settings: Any = config
    watch = "from heliosweep.kernels.helper import end_with_caller; end_with_caller()"
    program = "; ".join([watch, "from heliosweep.kernels.warm import *", *_Helper.tasks])
    # Python passes over what is no string, such as a Path; nothing stands for the folder that one is in.
    folders = os.pathsep.join(each or os.curdir for each in sys.path if isinstance(each, str))
    places = {"PYTHONPATH": folders, "NUMBA_CACHE_DIR": settings.CACHE_DIR}
    _Helper.tasks, _Helper.late, nothing = (), time.monotonic() + _LONGEST, subprocess.DEVNULL
    with suppress(OSError):
        _Helper.process = subprocess.Popen(
            [sys.executable, "-P", "-c", program],
            env=os.environ | places,
            stdin=subprocess.PIPE,
            stdout=nothing,
            stderr=nothing,
        )


def end_with_caller() -> None:
    """End this process when the one that started it has ended, however that was: nobody writes to its input then."""

    def watch() -> None:
        os.read(0, 1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def wait_for(path: Path) -> None:
    """Wait until there is a file, or the process has ended."""
    process = _Helper.process  # which another thread may end meanwhile
    while process and process.poll() is None and not path.exists() and time.monotonic() < _Helper.late:
        time.sleep(_LOOK_SECONDS)

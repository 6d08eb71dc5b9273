"""A copy of this process that does a part of the work while this one goes on, where there is a processor for it."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Self

from heliosweep.processors import processors

#: How long a result is waited for: a copy may wait for a lock that a library held. [s]
LONGEST = 120.0


class Beside:
    """Another process, from `start` to the end of the context; where there is none, nothing comes of it.

    Parameters
    ----------
    ready : callable
        What it does when it starts.
    work : callable
        What it does of that which `begin` tells; its result is pickled.
    """

    _process: BaseProcess | None = None

    def __init__(self, ready: Callable[[], Any], work: Callable[[Any], Any]) -> None:
        self._ready, self._work = ready, work

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._process:
            self._pipe.close()
            self._process.kill()
            self._process.join()
            self._process = None

    def start(self) -> None:
        """Copy this process.

        Only on Linux, where that is quick, and while no other thread could hold a lock that the copy would wait for. A
        daemon, such as a worker of a pool, may have no process of its own.
        """
        daemon = multiprocessing.current_process().daemon
        if sys.platform != "linux" or daemon or threading.active_count() > 1 or processors() == 1:
            return
        with suppress(OSError), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of NumPy's threads, which hold no lock of Python's
            self._pipe, other = multiprocessing.Pipe()
            with other:
                copy = multiprocessing.get_context("fork").Process(target=self._serve, args=(other,), daemon=True)
                copy.start()
                self._process = copy

    def begin(self, what: Any) -> None:
        """Have the work done."""
        with suppress(OSError):  # it has ended: nothing will come of it
            if self._process:
                self._pipe.send(what)

    def result(self) -> Any:
        """What came of the work; None where there is no other process, or it failed or took too long."""
        with suppress(EOFError, OSError):
            return self._pipe.recv() if self._process and self._pipe.poll(LONGEST) else None
        return None

    def _serve(self, pipe: Connection) -> None:
        """Do the work, in silence: what fails is done again by the process that was copied, which says why."""
        self._pipe.close()  # so that the other end closes when that process ends, however that is
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        logging.disable()
        with suppress(Exception):
            self._ready()
            pipe.send(self._work(pipe.recv()))

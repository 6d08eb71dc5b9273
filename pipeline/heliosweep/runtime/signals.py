"""Interruptions: what stops a run, and how tidying up is kept from being stopped too."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType, TracebackType
from typing import NoReturn

#: Ctrl-C, a polite kill, and a terminal that is closed.
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]

#: That a signal has asked to stop.
_asked = threading.Event()


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Give `handler` the signals that stop a run while the context lasts.

    Signals that are ignored (as under nohup) stay ignored. Only the main thread may set handlers, and only it is
    interrupted; in any other one this does nothing.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        now = {number: signal.getsignal(number) for number in _SIGNALS}
        before = {number: known for number, known in now.items() if known not in (signal.SIG_IGN, None)}
    try:
        for number in before:
            signal.signal(number, handler)
        yield
    finally:
        for number, known in before.items():
            signal.signal(number, known)


@contextmanager
def interruptible() -> Iterator[None]:
    """Let every signal that stops a run raise KeyboardInterrupt while the context lasts."""
    _asked.clear()
    with _handled(_interrupt):
        yield


def ignore_interruptions() -> None:
    """Ignore every signal that stops a run, to the end of the process."""
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _interrupt(*_: object) -> NoReturn:
    _asked.set()
    raise KeyboardInterrupt


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt where one was asked for; some libraries swallow the one that was raised in them."""
    if _asked.is_set() and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off interruptions to the end of the context."""
    held: list[int] = []
    try:
        with _handled(lambda number, _: held.append(number)):
            yield
    finally:
        if held:
            signal.raise_signal(held[0])


class TidyStack(ExitStack):
    """Exit stack that puts off interruptions while it is left, so that everything on it is tidied up."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        with uninterrupted():
            return super().__exit__(kind, error, trace)

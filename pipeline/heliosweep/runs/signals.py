"""Interruptions: what stops a run, and how tidying up is kept from being stopped too."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType, TracebackType

#: Ctrl-C, a polite kill, and a terminal that is closed.
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]

#: Signals so soon after another are one request: a terminal and make pass on the same Ctrl-C, and keys are hit twice,
#: which shall not tear the tidying up. [s]
_ONE_REQUEST = 1.0

#: When a signal that asked to stop was obeyed, by the clock that never goes backwards; None: none has asked. [s]
_obeyed: float | None = None


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Give `handler` the signals that stop a run while the context lasts.

    Signals that are ignored (as under nohup, or from `ignore_interruptions` on) stay ignored. Only the main thread may
    set handlers, and only it is interrupted; in any other one this does nothing.
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
            if signal.getsignal(number) is handler:
                signal.signal(number, known)


@contextmanager
def interruptible() -> Iterator[None]:
    """Let every signal that stops a run raise KeyboardInterrupt while the context lasts."""
    global _obeyed
    try:
        with _handled(_interrupt):
            yield
    finally:
        _obeyed = None


def ignore_interruptions() -> None:
    """Ignore every signal that stops a run, to the end of the process."""
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _interrupt(*_: object) -> None:
    """Obey a signal, unless it is one request with the last that was obeyed."""
    global _obeyed
    if _obeyed is None or time.monotonic() - _obeyed >= _ONE_REQUEST:
        _obeyed = time.monotonic()
        raise KeyboardInterrupt


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt where one was asked for; some libraries swallow the one that was raised in them."""
    if _obeyed is not None and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off an interruption to the end of the context; after one that was obeyed already, another changes nothing."""
    held: list[int] = []
    try:
        with _handled(lambda number, _: held.append(number)):
            yield
    finally:
        if held and _obeyed is None:
            signal.raise_signal(held[0])


@contextmanager
def interruptions_blocked() -> Iterator[None]:
    """Hand on blocked signals to threads, and by them to processes, that are started meanwhile.

    Ctrl-C reaches every process of a terminal: this one alone acts on it, when the context is left. (Blocked here, a
    signal may come by way of another thread.)
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        with uninterrupted():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class TidyStack(ExitStack):
    """Exit stack that puts off interruptions while it is left, so that everything on it is tidied up."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        with uninterrupted():
            return super().__exit__(kind, error, trace)

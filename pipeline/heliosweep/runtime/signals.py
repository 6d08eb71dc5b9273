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
def _handled(
    handler: Callable[[int, FrameType | None], object], ignored_after: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Give `handler` the signals that stop a run while the context lasts; from then on they may be `ignored_after`.

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
            signal.signal(number, signal.SIG_IGN if ignored_after() else known)


@contextmanager
def interruptible(*, ends_process: bool = False) -> Iterator[None]:
    """Let every signal that stops a run raise KeyboardInterrupt while the context lasts.

    Parameters
    ----------
    ends_process : bool
        Whether the process ends after the context: if it was stopped, later signals are then ignored, for they shall
        not change how a process ends that is ending.
    """
    global _obeyed
    _obeyed = None
    with _handled(_interrupt, lambda: ends_process and _obeyed is not None):
        yield


def _interrupt(*_: object) -> None:
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

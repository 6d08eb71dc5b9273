"""Interruptions: what raises them, what puts them off, and handlers left as they were."""

from __future__ import annotations

import signal
import threading
from contextlib import suppress

import pytest

from heliosweep.runs.signals import TidyStack, ignore_interruptions, interruptible, raise_if_interrupted, uninterrupted

if not hasattr(signal, "SIGHUP"):
    pytest.skip("signals of POSIX systems", allow_module_level=True)

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_each_signal_interrupts_and_handlers_are_restored(number):
    before = [signal.getsignal(known) for known in SIGNALS]
    with pytest.raises(KeyboardInterrupt), interruptible():
        signal.raise_signal(number)
    assert [signal.getsignal(known) for known in SIGNALS] == before


def test_signals_in_a_row_are_one_request(monkeypatch):
    with interruptible():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        monkeypatch.setattr("heliosweep.runs.signals._ONE_REQUEST", 0.0)  # a second one later
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_what_is_ignored_to_the_end_stays_ignored_after_the_context():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        with suppress(KeyboardInterrupt), interruptible():
            try:
                signal.raise_signal(signal.SIGTERM)
            finally:
                ignore_interruptions()
        assert all(signal.getsignal(number) == signal.SIG_IGN for number in SIGNALS)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_what_was_obeyed_is_forgotten_after_the_context():
    with suppress(KeyboardInterrupt), interruptible():
        signal.raise_signal(signal.SIGINT)
    raise_if_interrupted()


def test_a_second_signal_does_not_replace_what_is_said_of_the_first(monkeypatch):
    monkeypatch.setattr("heliosweep.runs.signals._ONE_REQUEST", 0.0)  # however much later it comes

    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            with uninterrupted():
                signal.raise_signal(signal.SIGINT)
            raise RuntimeError("interrupted: how to go on") from None

    with interruptible(), pytest.raises(RuntimeError):
        work()


def test_what_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_put_off_and_then_passed_on():
    done: list[str] = []

    def work() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            done.append("work")

    with interruptible(), pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["work"]


def test_everything_is_tidied_up_whatever_comes():
    done: list[str] = []

    def fill() -> None:
        with TidyStack() as stack:
            for step in ("last", "first"):
                stack.callback(done.append, step)
                stack.callback(signal.raise_signal, signal.SIGINT)
            raise KeyboardInterrupt

    with interruptible(), pytest.raises(KeyboardInterrupt):
        fill()
    assert done == ["first", "last"]


def test_threads_beside_the_main_one_set_nothing():
    before = signal.getsignal(signal.SIGTERM)
    seen = []

    def work() -> None:
        with interruptible(), uninterrupted():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]

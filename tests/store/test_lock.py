"""The library's lock: xarray's own, and reentrant."""

from __future__ import annotations

import pickle
import threading

import pytest
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

from heliosweep.store.lock import LIBRARY_LOCK


def from_another_thread() -> bool:
    got = []

    def attempt() -> None:
        got.append(LIBRARY_LOCK.acquire(blocking=False))
        if got[0]:
            LIBRARY_LOCK.release()

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    return got[0]


def test_one_thread_at_a_time_as_often_as_it_likes():
    with LIBRARY_LOCK:
        with LIBRARY_LOCK:
            assert not from_another_thread()
        assert not from_another_thread()
        assert not NETCDF4_PYTHON_LOCK.acquire(blocking=False)
    assert from_another_thread()


def test_waits_for_xarray():
    with NETCDF4_PYTHON_LOCK:
        assert not from_another_thread()
    assert from_another_thread()


def test_an_interruption_while_waiting_leaves_it_free(monkeypatch):
    class Interrupted:
        def acquire(self, blocking: bool) -> bool:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("heliosweep.store.lock.NETCDF4_PYTHON_LOCK", Interrupted())
        with pytest.raises(KeyboardInterrupt):
            LIBRARY_LOCK.acquire()
    assert from_another_thread()


def test_pickled_it_is_the_lock_of_the_process():
    assert pickle.loads(pickle.dumps(LIBRARY_LOCK)) is LIBRARY_LOCK

"""Other processes of tests."""

import time
from contextlib import suppress

import psutil


def assert_ends(pid: int) -> None:
    """Wait until a process has ended, half a minute at most."""
    with suppress(psutil.NoSuchProcess):
        other, last = psutil.Process(pid), time.monotonic() + 30.0
        while other.status() != psutil.STATUS_ZOMBIE:  # where nobody asks for its exit code
            assert time.monotonic() < last
            time.sleep(0.05)

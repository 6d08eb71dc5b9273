"""Fixtures of the tests of faults: runs in this process, and those that a nursery forks."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.kills import Nursery
from tests.faults.stopped import Runs


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Runs:
    caplog.set_level(logging.INFO, "heliosweep")
    return Runs(monkeypatch)


@pytest.fixture(scope="session")
def _nursery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nursery]:
    if not hasattr(os, "fork"):
        pytest.skip("kills and stops processes as POSIX systems do")
    with Nursery(tmp_path_factory.mktemp("nursery")) as started:
        yield started


@pytest.fixture
def nursery(_nursery: Nursery, tmp_path: Path) -> Iterator[Nursery]:
    """The one that all tests share, at work in the folder of this one."""
    _nursery.folder = tmp_path
    yield _nursery
    _nursery.clear()

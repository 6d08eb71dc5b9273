"""Runs that are killed: nothing done is lost, little is done again, and the result is that of a run in peace."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.faults.kills import STUDIES, Nursery, kill_and_resume

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills processes as POSIX systems do")


@pytest.fixture
def nursery(tmp_path) -> Iterator[Nursery]:
    with Nursery(tmp_path) as started:
        yield started


@pytest.mark.parametrize(("name", "kills"), [("field", 6), ("processes-zarr", 3), ("cluster", 3)])
def test_random_kills(nursery, name, kills):
    print(name, kill_and_resume(nursery, name, ["--no-report"], kills, seed=1))


@pytest.mark.long
@pytest.mark.parametrize("name", list(STUDIES))
def test_many_random_kills(nursery, name):
    print(name, kill_and_resume(nursery, name, [] if name == "dish" else ["--no-report"], kills=9, seed=2))

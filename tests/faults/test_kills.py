"""Runs that are killed: nothing done is lost, little is done again, and the result is that of a run in peace."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.kills import STUDIES, Nursery, kill_and_resume, write_study

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills processes as POSIX systems do")


@pytest.fixture
def nursery(tmp_path) -> Iterator[Nursery]:
    with Nursery(tmp_path) as started:
        yield started


def test_random_kills(nursery, tmp_path):
    study = write_study(tmp_path, STUDIES["field"])
    tally = kill_and_resume(nursery, study, ["--no-report"], kills=8, seed=1)
    print(tally)


@pytest.mark.long
@pytest.mark.parametrize("name", list(STUDIES))
def test_many_random_kills(nursery, tmp_path: Path, name):
    study = write_study(tmp_path, STUDIES[name])
    tally = kill_and_resume(nursery, study, [] if name == "dish" else ["--no-report"], kills=25, seed=2)
    print(name, tally)

"""Runs that are killed: nothing done is lost, little is done again, and the result is that of a run in peace."""

from __future__ import annotations

import pytest

from tests.faults.kills import STUDIES, kill_and_resume


@pytest.mark.parametrize(("name", "kills"), [("field", 6), ("processes-zarr", 3), ("cluster", 3)])
def test_random_kills(nursery, name, kills):
    print(name, kill_and_resume(nursery, name, ["--no-report"], kills, seed=1))


@pytest.mark.long
@pytest.mark.parametrize("name", list(STUDIES))
def test_many_random_kills(nursery, name):
    print(name, kill_and_resume(nursery, name, [] if name == "dish" else ["--no-report"], kills=9, seed=2))

"""Runs that are interrupted: nothing done is lost, little is done again, and the result is that of a run in peace."""

from __future__ import annotations

import pytest

from tests.faults.kills import interrupt_and_resume


@pytest.mark.parametrize("name", ["field", "zarr", "processes", "processes-zarr", "cluster", "cluster-zarr"])
@pytest.mark.attempts("signals", 50)
def test_signals_at_random_moments(nursery, attempts, name):
    interrupt_and_resume(nursery, name, attempts, seed=len(name))

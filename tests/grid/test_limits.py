"""What the machine offers: control groups count, and a folder that cannot be looked at is no error."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from heliosweep.grid import limits


@pytest.fixture
def groups(tmp_path, monkeypatch) -> Path:
    """A machine of 8 GB with processes in the control group /outer/inner; returns the folder of the groups."""
    (tmp_path / "proc/self").mkdir(parents=True)
    (tmp_path / "proc/meminfo").write_text("MemTotal: 9000000 kB\nMemAvailable: 8000000 kB\n")
    (tmp_path / "proc/self/cgroup").write_text("1:cpu:/old\n0::/outer/inner\n")
    (tmp_path / "groups/outer/inner").mkdir(parents=True)
    monkeypatch.setattr(limits, "_PROC", tmp_path / "proc")
    monkeypatch.setattr(limits, "_CGROUPS", tmp_path / "groups")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)), raising=False)
    return tmp_path / "groups"


def test_without_control_groups(groups, tmp_path):
    found = limits.machine_limits(None, None, tmp_path)
    assert (found.workers, found.memory) == (16, int(0.8 * 8_000_000 * 1024))


def test_the_tightest_control_group_counts(groups, tmp_path):
    (groups / "outer/cpu.max").write_text("350000 100000\n")
    (groups / "outer/inner/cpu.max").write_text("max 100000\n")
    (groups / "outer/memory.max").write_text("max\n")
    (groups / "outer/inner/memory.max").write_text("1000000000\n")
    found = limits.machine_limits(None, None, tmp_path)
    assert (found.workers, found.memory) == (4, 800_000_000)


def test_the_user_has_the_last_word(groups, tmp_path):
    (groups / "cpu.max").write_text("100000 100000\n")
    (groups / "memory.max").write_text("1000000\n")
    found = limits.machine_limits(5, 10**10, tmp_path)
    assert (found.workers, found.memory) == (5, 10**10)


@pytest.mark.parametrize("name", ["a/b/c", "n" * 300, "nul\0"])
def test_free_disk_of_the_nearest_parent_that_can_be_looked_at(tmp_path, name):
    assert limits.machine_limits(1, 1, tmp_path / name).disk > 0

"""What the machine offers: control groups count, and a folder that cannot be looked at is no error."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from heliosweep import processors
from heliosweep.grid import machine as limits


@pytest.fixture
def groups(tmp_path, monkeypatch) -> Path:
    """A machine of 8 GB with processes in the control group /outer/inner; returns the folder of the groups."""
    (tmp_path / "proc/self").mkdir(parents=True)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=8_000_000 * 1024))
    (tmp_path / "proc/self/cgroup").write_text("1:cpu:/old\n0::/outer/inner\n")
    (tmp_path / "groups/outer/inner").mkdir(parents=True)
    monkeypatch.setattr(processors, "_PROC", tmp_path / "proc")
    monkeypatch.setattr(processors, "_CGROUPS", tmp_path / "groups")
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


@pytest.fixture
def old_groups(groups, tmp_path) -> Path:
    """Control groups of version 1 around the same processes; returns the folder of all."""
    lines = "9:name=systemd:/\n4:memory:/outer/inner\n3:cpu,cpuacct:/outer/inner\n0::/\n"
    (tmp_path / "proc/self/cgroup").write_text(lines)
    for folder in ("memory/outer/inner", "cpu,cpuacct/outer/inner"):
        (groups / folder).mkdir(parents=True)
    return groups


def test_control_groups_of_version_1_count_as_well(old_groups, tmp_path):
    (old_groups / "memory/memory.limit_in_bytes").write_text("9223372036854771712\n")
    (old_groups / "memory/outer/memory.limit_in_bytes").write_text("2000000000\n")
    (old_groups / "memory/outer/inner/memory.limit_in_bytes").write_text("9223372036854771712\n")
    (old_groups / "cpu,cpuacct/cpu.cfs_quota_us").write_text("-1\n")
    (old_groups / "cpu,cpuacct/cpu.cfs_period_us").write_text("100000\n")
    (old_groups / "cpu,cpuacct/outer/inner/cpu.cfs_quota_us").write_text("250000\n")
    (old_groups / "cpu,cpuacct/outer/inner/cpu.cfs_period_us").write_text("100000\n")
    found = limits.machine_limits(None, None, tmp_path)
    assert (found.workers, found.memory) == (3, 1_600_000_000)


def test_a_container_sees_its_group_as_the_root(old_groups, tmp_path):
    (tmp_path / "proc/self/cgroup").write_text("4:memory:/docker/0123\n0::/docker/0123\n")
    (old_groups / "memory/memory.limit_in_bytes").write_text("1000000000\n")
    assert limits.machine_limits(None, None, tmp_path).memory == 800_000_000


@pytest.mark.parametrize("version", [1, 2])
def test_what_others_of_the_group_hold_is_not_available(old_groups, tmp_path, monkeypatch, version):
    folder = old_groups / ("memory/outer" if version == 1 else "")
    limit, used, cached = (
        ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_cache")
        if version == 1
        else ("memory.max", "memory.current", "file")
    )
    monkeypatch.setattr(psutil.Process, "memory_info", lambda self: SimpleNamespace(rss=100_000_000))
    (folder / limit).write_text("2000000000\n")
    (folder / used).write_text("900000000\n")
    (folder / "memory.stat").write_text(f"anon 1\n{cached} 300000000\n")
    memory = limits.machine_limits(None, None, tmp_path).memory
    assert memory == pytest.approx(0.8 * 1_500_000_000, rel=1e-4)


@pytest.mark.parametrize(
    ("kind", "left"), [("RLIMIT_AS", limits.UNUSED_ADDRESSES), ("RLIMIT_DATA", limits.UNUSED_DATA)]
)
def test_limits_of_the_process_count(groups, tmp_path, monkeypatch, kind, left):
    resource = pytest.importorskip("resource")
    given = {getattr(resource, kind): 3 * 2**30}
    unlimited = resource.RLIM_INFINITY
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (given.get(kind, unlimited), unlimited))
    found = limits.machine_limits(2, None, tmp_path)
    assert found.memory == int(0.8 * (3 * 2**30 - left - 2 * limits.UNUSED_PER_WORKER))
    given[getattr(resource, kind)] = 2**20
    assert limits.machine_limits(2, None, tmp_path).memory == 0

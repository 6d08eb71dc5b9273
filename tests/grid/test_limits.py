"""Limits of the machine: control groups count, and a folder that cannot be read is no error."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from heliosweep.grid import plan as machine


@pytest.fixture
def groups(tmp_path, monkeypatch) -> Path:
    """A machine with 8 GB of free memory and this process of 100 MB; returns the folder of control groups."""
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=8_000_000_000))
    monkeypatch.setattr(psutil.Process, "memory_info", lambda self: SimpleNamespace(rss=100_000_000))
    monkeypatch.setattr(machine, "_CGROUPS", tmp_path / "groups")
    monkeypatch.setattr(machine, "_OWN_GROUP", tmp_path / "cgroup")
    return tmp_path / "groups"


def limit(folder: Path, size: str, used: int = 0, cached: int = 0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    values = {"max": size, "current": used, "stat": f"anon 1\ninactive_file {cached}"}
    for name, value in values.items():
        (folder / f"memory.{name}").write_text(f"{value}\n")


def memory(tmp_path: Path) -> int:
    return machine.machine_limits(2, None, tmp_path).memory


def test_the_tightest_control_group_counts_with_what_others_in_it_hold(groups, tmp_path):
    (tmp_path / "cgroup").write_text("1:cpu:/old\n0::/outer/inner\n")
    limit(groups / "outer" / "inner", "max")
    assert memory(tmp_path) == 6_400_000_000
    limit(groups / "outer", "2000000000", 900_000_000, 300_000_000)
    assert memory(tmp_path) == int(0.8 * (2_000_000_000 - 900_000_000 + 300_000_000 + 100_000_000))


def test_the_study_has_the_last_word(groups, tmp_path):
    limits = machine.machine_limits(5, 10**10, tmp_path)
    assert (limits.workers, limits.memory) == (5, 10**10)
    assert machine.machine_limits(None, None, tmp_path).workers >= 1


@pytest.mark.parametrize("name", ["a/b/c", "n" * 300, "nul\0"])
def test_free_disk_of_the_nearest_parent_that_can_be_read(tmp_path, name):
    assert machine.machine_limits(1, 1, tmp_path / name).disk > 0

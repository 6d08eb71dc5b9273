"""Files that are not whole: names of their own, and none left of dead processes."""

from __future__ import annotations

import os
import platform
import subprocess
import sys

from heliosweep.store.temporary import remove_leftovers, temporary_name


def test_names_are_hidden_and_never_the_same(tmp_path):
    path = tmp_path / "result.nc"
    names = [temporary_name(path).name for _ in range(3)]
    assert len(set(names)) == 3
    assert all(name.startswith(".result.nc.") and name.endswith(".part") for name in names)


def test_only_what_a_dead_process_of_this_machine_left_is_removed(tmp_path):
    program = (
        "import sys; from pathlib import Path; from heliosweep.store.temporary import temporary_name\n"
        "print(temporary_name(Path(sys.argv[1])))"
    )
    dead = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "result.nc")], capture_output=True, text=True, check=True
    ).stdout.strip()
    host = platform.node()
    kept = {
        temporary_name(tmp_path / "result.nc").name,
        f".result.nc.{host}.{os.getppid()}-0.part",
        f".result.nc.another-{host}.999999999-0.part",
        f".result.nc.{host}.word-0.part",
        "result.nc",
    }
    for name in (*kept, dead):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept

"""Files that would take long or much memory to read are refused before they are split into cells."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.conftest import SMALL

#: Prints the memory that loading a study takes at most [kB], with Python and its libraries, and what was wrong.
PROGRAM = """
from pathlib import Path
from heliosweep import api
from heliosweep.errors import StudyError
try:
    api.load("study.yaml")
except StudyError as error:
    print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    print(error)
"""
MANY = 50_000_000
NAMES = ",".join(f"c{number}" for number in range(10_000))
TABLES = {
    "columns": (f"{NAMES}\n" * 2, "has 10,000 columns, more than 1,000"),
    "one column": ("x," * 40_000 + "\n1", "has 40,001 columns"),
    "wide": ("x," * 10**6 + "\n1", "holds a line of more than 100,000 letters"),
    "line ends": ("\n" * MANY, "has 50,000,000 lines, more than a table may have"),
    "old line ends": ("\r" * MANY, "has 50,000,000 lines"),
    "comments": ("#\n" * (MANY // 2), "has 25,000,000 lines"),
    "commas": ("," * MANY, "holds a line of more than 100,000 letters"),
    "tabs": ("\t1" * (MANY // 2), "holds a line of more than 100,000 letters"),
    "quotes": ('x,y\n"' + "1" * MANY, "holds a line of more than 100,000 letters"),
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the memory")
@pytest.mark.parametrize("name", TABLES)
def test_tables(tmp_path: Path, name: str) -> None:
    text, message = TABLES[name]
    (tmp_path / "layout.csv").write_text(text)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**SMALL, "layout": {"file": "layout.csv"}}))
    command = [sys.executable, "-c", PROGRAM]  # takes a second; without the limits some of these take minutes
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    memory, said = done.stdout.split("\n", 1)
    assert message in said
    assert int(memory) < 250_000

"""Loading is quick, whatever stands in the file; that it is refused with located problems, see `tests/faults`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from heliosweep.config.load import load
from heliosweep.errors import StudyError

from .conftest import REGISTRY

LARGE = ("x: " + "[" * 900_000, "x: [" + "a, " * 300_000 + "]", "? " * 400_000, "{" * 900_000, "- " * 400_000)


@pytest.mark.parametrize("text", LARGE, ids=["lists", "entries", "keys", "mappings", "dashes"])
def test_large_files_are_refused_quickly(text: str, tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError) as error:
        load(path, REGISTRY)
    assert all(problem.message and problem.file for problem in error.value.problems)


def test_importing_needs_nothing_heavy() -> None:
    code = (
        "import sys, heliosweep.config.load, heliosweep.config.study, heliosweep.families.field_efficiency.study;"
        "print(*({'pandas', 'xarray', 'dask', 'numba', 'scipy', 'pvlib', 'pint', 'matplotlib'} & set(sys.modules)))"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    loaded = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == ""

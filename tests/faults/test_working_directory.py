"""What lies in the working directory is data, whatever it is called."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.conftest import SMALL

COMMAND = Path(sys.executable).with_name("heliosweep")
#: Modules that starting processes imports.
NAMES = ("multiprocessing", "threading", "pickle", "socket", "logging", "numpy", "signal", "struct")


@pytest.mark.parametrize("scheduler", ["processes", "distributed", "local-jobs"])
def test_no_worker_imports_what_lies_beside_the_study(scheduler, tmp_path):
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'a').write('{name} ')\n")
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(SMALL))
    command = [COMMAND, "run", "study.yaml", "--scheduler", scheduler, "--workers", "1", "--no-report"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=dict(os.environ), check=False)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "imported").exists(), (tmp_path / "imported").read_text()

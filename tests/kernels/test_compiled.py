"""Compiled code on disk, and the pure-Python switch."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import heliosweep
from heliosweep.kernels import compiled

PROGRAM = """
import numpy as np
from heliosweep.kernels import compiled
from heliosweep.kernels.dish import UNTILTED_HOME_AXES, pack_windows, window_errors
windows = pack_windows([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]], [0, 2])
print(window_errors(UNTILTED_HOME_AXES, windows, 0.01, 0.3)[0][0], compiled.compilations(), len(compiled.UNCACHED))
"""


def run(**variables: str) -> tuple[float, int, int]:
    """Mean error, number of compilations and number of kernels without a cache, in a new process."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **variables}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    error, count, uncached = done.stdout.split()
    return float(error), int(count), int(uncached)


@pytest.mark.skipif(compiled.PURE_PYTHON, reason="nothing is compiled")
def test_compiled_code_is_found_until_any_kernel_is_edited(tmp_path):
    shutil.copytree(Path(heliosweep.__file__).parent, tmp_path / "heliosweep")
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    first = run(**variables)
    assert first[1] > 0
    assert run(**variables) == (first[0], 0, 0)
    vectors = tmp_path / "heliosweep" / "kernels" / "vectors.py"
    vectors.write_text(vectors.read_text().replace("a[1] * b[2] - a[2] * b[1], a[2]", "2.0 * a[1] * b[2], a[2]"))
    wrong = run(**variables)
    assert wrong[1] > 0
    assert wrong[0] != first[0]
    plain = run(**variables, HELIOSWEEP_PURE_PYTHON="1")
    assert plain == (pytest.approx(wrong[0], rel=1e-13), 0, 0)


@pytest.mark.skipif(compiled.PURE_PYTHON, reason="nothing is compiled")
def test_users_without_a_home_folder_compile_without_a_cache(monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", "~no-such-user")
    monkeypatch.setattr(compiled, "UNCACHED", [])
    assert compiled.kernel(lambda value: 2.0 * value)(1.5) == 3.0
    assert compiled.UNCACHED == ["<lambda>"]

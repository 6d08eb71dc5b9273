"""The same bits from every processor: kernels compiled for SSE2, AVX2 and AVX-512, on one machine.

What this cannot show: functions of the C library and of NumPy choose their own way by the processor that they run on.
"""

import json
import os
import platform
import subprocess
import sys

import pytest
from llvmlite import binding as llvm  # type: ignore[import-untyped]

from tests.kernels.processors import FAMILIES, digests

#: Of each target: what numba is told to use, and the registers that show that it does.
TARGETS = {
    "sse2": ("", "xmm"),
    "avx2": ("+avx2,+fma", "ymm"),
    "avx512": ("+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl,+fma", "zmm"),
}
pytestmark = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="not an x86-64 processor")


def compiled_for(target, folder, *families):
    """What another process computes with kernels compiled for a target, in a cache of its own."""
    features, registers = TARGETS[target]
    has = llvm.get_host_cpu_features()
    if missing := [name for name in features.replace("+", "").split(",") if name and not has.get(name)]:
        pytest.skip(f"this processor has no {', '.join(missing)}")
    run = subprocess.run(
        [sys.executable, "-m", "tests.kernels.processors", *families],
        env={
            **os.environ,
            "NUMBA_CPU_NAME": "x86-64",
            "NUMBA_CPU_FEATURES": features,
            "NUMBA_CACHE_DIR": str(folder),
            "PYTHONPATH": os.pathsep.join(sys.path),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(run.stdout)
    assert found.pop("registers") == registers
    return found


@pytest.mark.long
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_on_every_target(family, target, tmp_path):
    assert compiled_for(target, tmp_path, family) == {family: digests(family)}


def test_processors_that_share_a_cache_share_no_file():
    program = (
        "from heliosweep.kernels.field.sweep import sweep; from numba.core.registry import cpu_target\n"
        "print(sweep._cache.path((), cpu_target.target_context.codegen()))"
    )
    targets = [("x86-64", "+avx"), ("x86-64", ""), ("haswell", "")]
    files = []
    for name, features in targets:
        changed = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features, "PYTHONPATH": os.pathsep.join(sys.path)}
        command = [sys.executable, "-c", program]
        files.append(
            subprocess.run(command, env=os.environ | changed, capture_output=True, text=True, check=True).stdout
        )
    assert len(set(files)) == 3


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_parts_have_the_bits_of_kernels_that_are_compiled_by_themselves(family, tmp_path):
    program = (
        "import runpy, sys; from heliosweep.kernels import machine_code; machine_code._TRIED_WITH.clear()\n"
        f"sys.argv[1:] = [{family!r}]; runpy.run_module('tests.kernels.processors', run_name='__main__')"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert json.loads(run.stdout)[family] == digests(family)

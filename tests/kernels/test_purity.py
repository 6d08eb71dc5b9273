"""Kernels import the standard library, NumPy, numba, each other and the module of sources, nothing else."""

import ast
import sys
from pathlib import Path

import pytest

import heliosweep.kernels

KERNELS = Path(heliosweep.kernels.__file__).parent
SOURCES = {
    path.relative_to(KERNELS).with_suffix("").as_posix().replace("/", "."): path.read_text()
    for path in sorted(KERNELS.rglob("*.py"))
}
TREES = {name: ast.parse(text) for name, text in SOURCES.items()}
OWN = {"heliosweep.sources"}
ALLOWED = {"numpy", "numba"} | set(sys.stdlib_module_names)
#: Interpolation in grids, Bessel functions, and Sobol sequences with normal deviates: NumPy has none.
ALSO = {
    "gazing.geometry": {"scipy.ndimage", "scipy.spatial.transform"},
    "rays": {"scipy.ndimage", "scipy.special", "scipy.stats"},
}


@pytest.mark.parametrize("name", SOURCES)
def test_imports(name):
    for node in ast.walk(TREES[name]):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names = [node.module or ""]
        for module in names:
            own = f"{module}.".startswith("heliosweep.kernels.") or module in OWN
            assert own or module.split(".")[0] in ALLOWED or module in ALSO.get(name, ()), module
        assert "logging" not in names

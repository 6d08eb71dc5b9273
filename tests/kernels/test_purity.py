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
FORBIDDEN_CALLS = {"print", "open", "input"}


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


@pytest.mark.parametrize("name", SOURCES)
def test_no_output_and_no_files(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in FORBIDDEN_CALLS


def test_compiler_options_live_in_one_place():
    assert [name for name, text in SOURCES.items() if "njit" in text] == ["compiled"]


def decorated(name, *decorators):
    """Functions of one module that have one of these decorators."""
    nodes = [node for node in ast.walk(TREES[name]) if isinstance(node, ast.FunctionDef)]
    return [node for node in nodes if set(decorators) & {ast.unparse(each) for each in node.decorator_list}]


def test_kernels_that_count_no_references_are_given_no_array_by_others():
    """What is given would never be let go: the memory leaks, and nothing tells of it."""
    counting = {f"{name}.{function.name}" for name in SOURCES for function in decorated(name, "kernel")}
    for name, tree in TREES.items():
        home = {function.name: name for function in decorated(name, "kernel", "inner", "inline")}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("heliosweep.kernels."):
                module = str(node.module).removeprefix("heliosweep.kernels.")
                home |= {alias.asname or alias.name: module for alias in node.names}
        for function in decorated(name, "inline", "inner"):
            calls = [ast.unparse(call.func) for call in ast.walk(function) if isinstance(call, ast.Call)]
            called = {f"{home[call]}.{call}" for call in calls if call in home}
            assert not called & counting, f"{name}: {function.name}"

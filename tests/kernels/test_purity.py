"""Kernels import the standard library, NumPy, numba and each other, nothing else."""

import ast
import sys
from pathlib import Path

import pytest

import heliosweep.kernels

SOURCES = sorted(Path(heliosweep.kernels.__file__).parent.glob("*.py"))
ALLOWED = {"numpy", "numba"} | set(sys.stdlib_module_names)
FORBIDDEN_CALLS = {"print", "open", "input"}


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_imports(source):
    for node in ast.walk(ast.parse(source.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names = [node.module or ""]
        for name in names:
            assert name.startswith("heliosweep.kernels.") or name.split(".")[0] in ALLOWED, f"{source.name}: {name}"
        assert "logging" not in names


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_no_output_and_no_files(source):
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in FORBIDDEN_CALLS


def test_compiler_options_live_in_one_place():
    for source in SOURCES:
        if source.stem != "compiled":
            assert "njit" not in source.read_text(), source.name


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_kernels_that_count_no_references_make_no_arrays(source):
    makers = {"array", "concatenate", "copy", "empty", "empty_like", "full", "ones", "stack", "zeros", "zeros_like"}
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.FunctionDef) and {"inline", "inner"} & {ast.unparse(d) for d in node.decorator_list}:
            called = {ast.unparse(call.func) for call in ast.walk(node) if isinstance(call, ast.Call)}
            assert not called & {f"np.{name}" for name in makers}, f"{source.name}: {node.name}"

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


#: Kernels that make arrays for themselves and return none: all that those may call that count no references.
RETURN_NO_ARRAY = {"images._area_in_front", "least_squares.singular_values", "unions._general_with_more_room"}


def decorated(source, *names):
    """Functions of one file that have one of these decorators."""
    nodes = [node for node in ast.walk(ast.parse(source.read_text())) if isinstance(node, ast.FunctionDef)]
    return [node for node in nodes if set(names) & {ast.unparse(each) for each in node.decorator_list}]


def test_kernels_that_count_no_references_are_given_no_array_by_others():
    """What is given would never be let go: the memory leaks, and nothing tells of it."""
    counting = {f"{source.stem}.{function.name}" for source in SOURCES for function in decorated(source, "kernel")}
    assert counting >= RETURN_NO_ARRAY
    for source in SOURCES:
        home = {function.name: source.stem for function in decorated(source, "kernel", "inner", "inline")}
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("heliosweep.kernels."):
                home |= {alias.asname or alias.name: str(node.module).rpartition(".")[2] for alias in node.names}
        for function in decorated(source, "inline", "inner"):
            calls = [call.func for call in ast.walk(function) if isinstance(call, ast.Call)]
            called = {f"{home[name]}.{name}" for name in map(ast.unparse, calls) if name in home}
            assert called & counting <= RETURN_NO_ARRAY, f"{source.name}: {function.name}"

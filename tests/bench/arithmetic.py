"""Arithmetic of kernels, counted in their sources.

An addition, subtraction, multiplication, division, root, power or library function is one operation. Not counted:
comparisons, smallest and largest, signs, indices, and what the compiler computes ahead.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

_ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)
_FREE = {"abs", "min", "max", "float", "int", "int64", "float64", "len", "range", "isnan", "floor", "copysign", "view"}


def operations(
    kernel: Any, known: Mapping[str, float] | None = None, *, loops_only: bool = False, loop: int | None = None
) -> float:
    """Operations of one call of a kernel, those of the functions that it calls included.

    Parameters
    ----------
    kernel : function
        Compiled or not.
    known : mapping, optional
        By source text: how often `range(text)` or `while` goes round, or whether `if text` holds (0 to 1). Else a
        loop counts as one round, as lanes do, and of two branches the longer one.
    loops_only : bool
        Leave out what stands outside the loops of the kernel itself.
    loop : int, optional
        The one loop of the kernel itself to count.
    """
    function = _function(kernel)
    body = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(body, ast.FunctionDef)
    counter = _Counter(function.__globals__, known or {})
    loops: list[ast.stmt] = [s for s in body.body if isinstance(s, ast.For | ast.While)]
    if loop is not None:
        return counter.block([loops[loop]])
    return counter.block(loops if loops_only else body.body)


def _function(kernel: Any) -> Callable[..., Any]:
    function: Callable[..., Any] = getattr(kernel, "py_func", kernel)
    return function


class _Counter:
    """Counts in one function."""

    def __init__(self, names: Mapping[str, Any], known: Mapping[str, float]) -> None:
        self.names, self.known = names, known

    def block(self, statements: list[ast.stmt]) -> float:
        total = 0.0
        for number, statement in enumerate(statements):
            if isinstance(statement, ast.If):
                after = [*statement.orelse, *statements[number + 1 :]]
                ends = isinstance(statement.body[-1], ast.Return | ast.Continue | ast.Break)
                here, there = self.block(statement.body), self.block(after if ends else statement.orelse)
                share = self.known.get(ast.unparse(statement.test))
                total += self.value(statement.test)
                total += max(here, there) if share is None else share * here + (1.0 - share) * there
                if ends:
                    return total
            elif isinstance(statement, ast.For):
                total += self.rounds(statement.iter) * self.block(statement.body)
            elif isinstance(statement, ast.While):
                total += self.known.get("while", 1.0) * (self.value(statement.test) + self.block(statement.body))
            elif isinstance(statement, ast.AugAssign):
                whole = isinstance(statement.target, ast.Name) and _is_whole(statement.value)
                total += self.value(statement.value) + (isinstance(statement.op, _ARITHMETIC) and not whole)
            elif isinstance(statement, ast.Assign | ast.AnnAssign | ast.Return | ast.Expr):
                total += self.value(statement.value)
        return total

    def rounds(self, iterable: ast.expr) -> float:
        text = ast.unparse(iterable)
        text = text.removeprefix("range(").removesuffix(")")
        return self.known.get(text, float(text) if text.isdigit() else 1.0)

    def value(self, node: ast.AST | None) -> float:
        """Operations of an expression."""
        if node is None or isinstance(node, ast.Subscript) or self.is_index(node) or self.is_constant(node):
            return 0.0
        total = sum(self.value(child) for child in ast.iter_child_nodes(node))
        if isinstance(node, ast.BinOp):
            return total + isinstance(node.op, _ARITHMETIC)
        if isinstance(node, ast.Call):
            called = self.resolved(node.func)
            if called is None or isinstance(called, type):
                return total
            if getattr(_function(called), "__module__", "").startswith("heliosweep"):
                return total + operations(called, self.known)
            return total + (getattr(called, "__name__", "") not in _FREE)
        return total

    def resolved(self, node: ast.AST) -> Any:
        """What a name or an attribute of a module stands for, as far as that is known."""
        if isinstance(node, ast.Name):
            return self.names.get(node.id)
        if isinstance(node, ast.Attribute) and self.resolved(node.value) in (math, np):
            return getattr(self.resolved(node.value), node.attr)
        return None

    def is_constant(self, node: ast.AST) -> bool:
        if isinstance(node, ast.BinOp):
            return self.is_constant(node.left) and self.is_constant(node.right)
        return isinstance(node, ast.Constant) or isinstance(self.resolved(node), int | float)

    def is_index(self, node: ast.AST) -> bool:
        """Whether an expression is of integers and names an integer constant."""
        if not isinstance(node, ast.BinOp):
            return False
        leaves = [n for n in ast.walk(node) if not isinstance(n, ast.BinOp | ast.operator | ast.expr_context)]
        plain = all(isinstance(n, ast.Name) or _is_whole(n) for n in leaves)
        return plain and any(isinstance(self.resolved(n), int) for n in leaves)


def _is_whole(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int)

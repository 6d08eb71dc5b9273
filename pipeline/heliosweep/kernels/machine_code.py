"""Compile kernels in parts, so that a function that other kernels call is optimised only within its callers."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numba
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target


def compile_in_parts(whole: Any, part: Any) -> None:
    """Compile a kernel to machine code for Python, and to an unoptimised part for other kernels.

    By default, numba optimises each kernel, generates its machine code, and repeats both steps for each caller.
    This function compiles called functions to the intermediate form, links them, and optimises them only in their
    callers. With numba 0.68, the heliostat field kernels compile in 6 s of CPU time instead of 12 s. This function
    depends on internals of numba and is therefore limited to tested versions. Other versions compile in the usual way,
    with the same results.

    Parameters
    ----------
    whole, part : numba.core.dispatcher.Dispatcher
        The kernel with and without its Python interface. Both dispatchers compile on their first call.
    """
    if numba.version_info.short != (0, 68):  # not tested
        return
    compile_alone, template = whole.compile, part.get_call_template

    def compile_of_parts(signature: Any) -> Any:
        with global_compiler_lock, _parts():
            return compile_alone(signature)

    def call_template(args: Any, keywords: Any) -> Any:
        """Return the signature of a call. A literal number does not cause another compilation."""
        return template([types.unliteral(kind) for kind in args], keywords)

    whole.compile, whole.get_call_template, whole.get_overload = compile_of_parts, call_template, part.get_overload


@contextmanager
def _parts() -> Iterator[None]:
    """Compile with `_Library` and `_call_type`, and pause garbage collection, which takes 10 % of the time."""
    codegen: Any = cpu_target.target_context.codegen()
    if codegen._library_class is _Library:  # a kernel that calls this kernel is being compiled
        yield
        return
    cpu_target.target_context.refresh()  # registers all functions of the compiler
    before = codegen._library_class, _Function.get_call_type, gc.isenabled()
    codegen._library_class, _Function.get_call_type = _Library, _call_type
    gc.disable()
    try:
        yield
    finally:
        codegen._library_class, _Function.get_call_type, collects = before
        if collects:
            gc.enable()


_Function: Any = types.BaseFunction
_resolve = _Function.get_call_type
_signatures: dict[Any, Any] = {}


def _call_type(function: Any, context: Any, args: Any, keywords: Any) -> Any:
    """Return the signature of a call to a built-in function, from a cache if possible.

    Without the cache, the compiler would search for the signature at each call. Functions that are compiled for their
    caller are not cached, because they inherit the options of the caller.
    """
    key = function, tuple(args), tuple(keywords.items())
    signature = _signatures.get(key)
    if signature is None:
        signature = _resolve(function, context, args, keywords)
        if function.get_impl_key(signature) is function.typing_key:
            _signatures[key] = signature
    return signature


class _Library(JITCodeLibrary):
    """Module that is linked without optimisation, and optimised and compiled only if Python calls it."""

    _is_part, _asked = False, False

    def add_ir_module(self, ir_module: Any) -> None:
        for each in ir_module.functions:  # by default, LLVM uses only half the vector width of some processors
            set.add(each.attributes, '"prefer-vector-width"="512"')
        super().add_ir_module(ir_module)

    def get_pointer_to_function(self, name: str) -> int:
        defined = any(each.name == name and not each.is_declaration for each in self._final_module.functions)
        if self._is_part and defined:
            raise RuntimeError(f"{name} was compiled as a part")
        self._asked = self._asked or defined
        return int(super().get_pointer_to_function(name))

    def finalize(self) -> None:
        self._is_part = not self._asked
        super().finalize()

    def _optimize_final_module(self) -> None:
        if self._is_part:
            return
        # only this module calls the parts, so unused arguments can be removed
        for each in self._final_module.functions:
            if each.linkage.name == "linkonce_odr" and not each.is_declaration:
                each.linkage = "internal"
        super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self._is_part:
            self._finalize_dynamic_globals()
            self._finalized = True
            return
        super()._finalize_final_module()
        codegen: Any = self._codegen
        for variable in self._final_module.global_variables:  # the environments of parts now have addresses
            environment = lookup_environment(variable.name)
            if environment is not None:
                codegen.set_env(variable.name, environment)

    @property
    def codegen(self) -> Any:
        # A part has no address for an environment before its code is generated.
        nowhere = SimpleNamespace(set_env=lambda name, environment: None)
        return nowhere if self._is_part else self._codegen

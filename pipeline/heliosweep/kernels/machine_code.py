"""Compile kernels in parts: what other kernels call is optimised once, in its caller."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target

#: Versions of numba that kernels are compiled in parts with.
_TRIED_WITH = {(0, 68)}


def compile_in_parts(whole: Any, part: Any) -> None:
    """Compile a kernel to machine code if Python calls it, and to a part of other machine code if a kernel calls it.

    The compiler optimises each kernel and generates machine code, and repeats both in each calling kernel. Here,
    functions that other kernels call are compiled to the intermediate form, linked, and optimised in their callers
    alone. Measured with numba 0.68: 14 s of processor time instead of 30 s for heliostat fields, 8 s instead of 18 s
    for calibrations.

    It uses internals of the compiler and applies to tested versions only. Other versions compile in the usual way, with
    the same results.

    Parameters
    ----------
    whole, part : numba.core.dispatcher.Dispatcher
        The kernel, and the same without its interface to Python; each compiled on its first call.
    """
    if numba.version_info.short not in _TRIED_WITH:
        return
    compile_alone, template = whole.compile, part.get_call_template

    def compile_of_parts(signature: Any) -> Any:
        with global_compiler_lock, _parts():
            return compile_alone(signature)

    def call_template(args: Any, kws: Any) -> Any:
        """As a call, but a literal number is no reason to compile again, unless the caller contains the function."""
        if "forceinline" not in part.targetoptions:
            args, kws = [types.unliteral(each) for each in args], {k: types.unliteral(each) for k, each in kws.items()}
        return template(args, kws)

    whole.compile, whole.get_call_template, whole.get_overload = compile_of_parts, call_template, part.get_overload


@contextmanager
def _parts() -> Iterator[None]:
    """Compile with `_Library` and `_call_type`, and without collecting garbage: among so many objects it takes a tenth.

    Afterwards all of them count as old: the next collection would go through those made here one by one.
    """
    cpu_target.target_context.refresh()  # what comes with the compiler is to be whole
    codegen = cpu_target.target_context.codegen()
    library, collecting, frozen = codegen._library_class, gc.isenabled(), gc.get_freeze_count()
    codegen._library_class, _Function.get_call_type = _Library, _call_type
    gc.disable()
    try:
        yield
    finally:
        codegen._library_class, _Function.get_call_type = library, _resolve
        if collecting:
            if frozen == 0:
                gc.freeze()
                gc.unfreeze()
            gc.enable()


_Function: Any = types.BaseFunction
_resolve = _Function.get_call_type
_call_types: dict[Any, Any] = {}


def _call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of a call of a function of the compiler's own, as a sum of two numbers, found once.

    By itself the compiler finds it for every call anew, twice or more, and tries up to ten templates: a quarter of all
    its time. Functions that are compiled for the kernel that calls them are not kept: they take its options.
    """
    key = function, tuple(args), tuple(kws.items())
    signature = _call_types.get(key)
    if signature is None:
        signature = _resolve(function, context, args, kws)
        if function.get_impl_key(signature) is function.typing_key:
            _call_types[key] = signature
    return signature


class _Library(JITCodeLibrary):
    """Module that is linked unchanged, and optimised and compiled only if Python calls it."""

    _is_part, _asked = False, False

    def get_pointer_to_function(self, name: str) -> int:
        defined = any(each.name == name and not each.is_declaration for each in self._final_module.functions)
        if self._is_part and defined:
            raise RuntimeError(f"{name} was compiled as a part")
        self._asked = self._asked or defined
        return int(super().get_pointer_to_function(name))

    def finalize(self) -> None:
        self._is_part = not self._asked
        super().finalize()

    def _optimize_functions(self, module: Any) -> None:
        """Optimise functions that are defined: of six the compiler has passes for, five are only named."""
        module.data_layout = self._codegen._data_layout
        for each in module.functions:
            if not each.is_declaration:
                passes, settings = self._codegen._function_pass_manager()
                passes.run(each, settings)

    def _optimize_final_module(self) -> None:
        if self._is_part:
            return
        for each in self._final_module.functions:  # nobody else calls the parts: arguments they do not use may go
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
        for variable in self._final_module.global_variables:  # of the parts too: now they have an address
            environment = lookup_environment(variable.name)
            if environment is not None:
                codegen.set_env(variable.name, environment)

    @property
    def codegen(self) -> Any:
        return _Nowhere if self._is_part else self._codegen


class _Nowhere:
    """Takes the environment of a part, which has no address before its code is made."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        pass

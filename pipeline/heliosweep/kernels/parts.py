"""Kernels that other kernels call are compiled as parts of the code of these, not to the end for themselves.

By itself the compiler optimises every kernel and makes machine code of it, and then does both anew in each kernel that
calls it: half the time of a first run. Here machine code is made of kernels that Python calls alone. What other kernels
call is brought to the compiler's intermediate form, linked as it is, and optimised where it ends up.

What is left is mostly the compiler's own work in Python. So kernels go through those of its passes alone that they
need, and what an operator makes of the types of its operands is found out once, not anew for each time it is written.

This reaches into the compiler, so it is done for the versions alone that it was tried with; with any other, kernels
compile as they do by themselves, to the same results.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, cast

__all__ = ["compile_in_parts", "few_passes"]

_TRIED_WITH = {(0, 68)}
"""Versions of numba."""


def few_passes() -> dict[str, Any]:
    """Options of the compiler: that a kernel goes through few passes."""
    import numba

    return {"pipeline_class": _pipeline()} if numba.version_info.short in _TRIED_WITH else {}


def compile_in_parts(whole: Any, part: Any) -> None:
    """Make machine code of a kernel where Python calls it, and a part where another kernel does.

    Parameters
    ----------
    whole, part : numba.core.dispatcher.Dispatcher
        The kernel, and the same without what Python calls it by; each compiled on its first call.
    """
    import numba
    from numba.core import types
    from numba.core.compiler_lock import global_compiler_lock

    if numba.version_info.short not in _TRIED_WITH:
        return
    compile_alone, template = whole.compile, part.get_call_template

    def compile_of_parts(signature: Any) -> Any:
        with global_compiler_lock, _parts():
            return compile_alone(signature)

    def call_template(args: Any, kws: Any) -> Any:
        """As a call, but a number that is written out is no reason to compile again, unless its place is the caller."""
        if "forceinline" not in part.targetoptions:
            args, kws = [types.unliteral(each) for each in args], {k: types.unliteral(each) for k, each in kws.items()}
        return template(args, kws)

    whole.compile, whole.get_call_template, whole.get_overload = compile_of_parts, call_template, part.get_overload


@cache
def _pipeline() -> Any:
    """Class of compilers that leave out what no kernel needs.

    Left out are passes for closures, `with`, `literally`, `literal_unroll`, functions inlined as Python, branches that
    types alone decide, and what is told to people who look at types. A kernel that needs such a pass does not compile.
    """
    from numba.core import typed_passes, untyped_passes
    from numba.core.compiler import CompilerBase
    from numba.core.compiler_machinery import PassManager

    passes = (
        untyped_passes.TranslateByteCode,
        untyped_passes.FixupArgs,
        untyped_passes.IRProcessing,
        untyped_passes.GenericRewrites,
        untyped_passes.ReconstructSSA,
        typed_passes.NopythonTypeInference,
        typed_passes.PreLowerStripPhis,
        typed_passes.IRLegalization,
        typed_passes.NativeLowering,
        typed_passes.NoPythonBackend,
    )

    class Pipeline(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            manager = PassManager("kernel (few passes, see heliosweep.kernels.parts)")
            for each in passes:
                manager.add_pass(each, each.name())
            manager.finalize()
            return [manager]

    return Pipeline


@contextmanager
def _parts() -> Iterator[None]:
    """Compile as `_library` and `_remembered` do, and collect no garbage: that would take a tenth of the time."""
    from numba.core import types
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()  # what comes with the compiler is to be whole
    codegen, functions = cpu_target.target_context.codegen(), cast(Any, types.BaseFunction)
    library, find, collects = codegen._library_class, functions.get_call_type, gc.isenabled()
    codegen._library_class, functions.get_call_type = _library(), _remembered(find)
    gc.disable()
    try:
        yield
    finally:
        codegen._library_class, functions.get_call_type = library, find
        if collects:
            gc.enable()


def _remembered(find: Callable[..., Any]) -> Callable[..., Any]:
    """As `find`, the signature of an operator or function of the compiler for types of operands, but found once.

    Not where it stands for code that was compiled for these types: which code that is depends on the caller's options.
    """
    found: dict[Any, Any] = {}

    def get_call_type(function: Any, context: Any, operands: Any, named: Any) -> Any:
        key = function, tuple(operands), tuple(named)
        if key in found:
            return found[key]
        signature = find(function, context, operands, named)
        if not named and function.get_impl_key(signature) is function.typing_key:
            found[key] = signature
        return signature

    return get_call_type


@cache
def _library() -> Any:
    """Class of modules that are linked as they are, and optimised and made code only where Python asks for one."""
    from numba.core.codegen import JITCodeLibrary
    from numba.core.environment import lookup_environment

    class Library(JITCodeLibrary):
        _is_part, _asked = False, False

        def _optimize_functions(self, ll_module: Any) -> None:
            ll_module.data_layout = self._codegen._data_layout
            for function in ll_module.functions:
                if not function.is_declaration:
                    manager, builder = self._codegen._function_pass_manager()
                    manager.run(function, builder)

        def get_pointer_to_function(self, name: str) -> int:
            defined = any(each.name == name and not each.is_declaration for each in self._final_module.functions)
            if self._is_part and defined:
                raise RuntimeError(f"{name} was compiled as a part")
            self._asked = self._asked or defined
            return super().get_pointer_to_function(name)

        def finalize(self) -> None:
            self._is_part = not self._asked
            super().finalize()

        def _optimize_final_module(self) -> None:
            if not self._is_part:
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

    return Library


class _Nowhere:
    """Where the environment of a part is written to: it has no address before its code is made."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        pass

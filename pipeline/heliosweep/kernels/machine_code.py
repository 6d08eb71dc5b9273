"""Machine code of kernels: made where Python calls a kernel, and kept on disk for the next process."""

import gc
import hashlib
import itertools
import os
import pickle
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core import types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

from heliosweep.kernels.helper import start as start_helper
from heliosweep.kernels.helper import wait_for
from heliosweep.sources import numbers_digest

_TRIED_WITH = {(0, 68)}
"""Versions of numba that kernels are compiled in parts with."""
_DIGEST = hashlib.sha256().digest_size
"""Each file of compiled code begins with the digest of what follows. [bytes]"""
_KEPT = 16
"""Files of compiled code that are kept of a kernel: versions of its source, processors, types of arguments."""


class CodeCache(FunctionCache):
    """Compiled code of one kernel, one file for each version of its code, types of arguments and processor.

    numba's own cache does not see an edit of a kernel that this one calls, compiles anew after an edit of a comment,
    and numbers its files by those that it saw: two processes could give different code one name.

    Raises
    ------
    RuntimeError
        Where there is no folder that code could be written to, or no source file.
    """

    def __init__(self, function: Any, kind: str = ""):
        super().__init__(function)
        self.loaded: dict[Any, Any] = {}
        self._base = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}{kind}"
        try:
            self._version = numbers_digest(function.__module__)
        except ModuleNotFoundError as error:
            raise RuntimeError(str(error)) from error

    def path(self, signature: Any, codegen: Any) -> Path:
        """File of the code for types of arguments and a processor."""
        key = (self._version, numba.__version__, platform.python_version_tuple()[:2], signature, codegen.magic_tuple())
        return Path(self.cache_path, f"{self._base}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc")

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Code from the disk, None where there is none; what code is made with is not loaded for it, as numba does."""
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)

    def _load_overload(self, signature: Any, target: Any) -> Any:
        if signature in self.loaded:
            return self.loaded.pop(signature)
        path = self.path(signature, target.codegen())
        try:
            stored = path.read_bytes() if path.is_file() else b""
        except OSError:
            return None
        digest, content = stored[:_DIGEST], stored[_DIGEST:]
        if hashlib.sha256(content).digest() != digest:  # damaged: loaded, it could crash the process
            return None
        return self._impl.rebuild(target, pickle.loads(content))

    def _save_overload(self, signature: Any, result: Any) -> None:
        if not self._impl.check_cachable(result):
            return
        path, content = self.path(signature, result.codegen), self._cache_file._dump(self._impl.reduce(result))
        temporary = path.with_suffix(f".{os.getpid()}")
        with suppress(OSError):  # a full disk, say: the next process compiles once more
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
            temporary.replace(path)
            kept = sorted(path.parent.glob(f"{self._base}-*.nbc"), key=os.path.getmtime)
            for old in kept[:-_KEPT]:
                old.unlink(missing_ok=True)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


class PartCache(CodeCache):
    """The same of a part that another process may be about to make."""

    def __init__(self, function: Any):
        super().__init__(function, ".part")

    def _load_overload(self, signature: Any, target: Any) -> Any:
        wait_for(self.path(signature, target.codegen()))
        return super()._load_overload(signature, target)


def compile_part(kernel: Any, *arguments: Any) -> Any:
    """Bring a kernel to the form that others take it in, for types of arguments; returns the type of its result."""
    FunctionIdentity._unique_ids = itertools.count(time.time_ns())  # for symbols that no other process gives
    with global_compiler_lock, _parts():
        kernel.part.compile(arguments)
    return kernel.part.overloads[arguments].signature.return_type


def compile_in_parts(whole: Any, part: Any) -> None:
    """Make machine code of a kernel where Python calls it, and a part of other machine code where a kernel does.

    By itself the compiler optimises every kernel and makes machine code of it, and does both anew in each kernel that
    calls it. With this, what other kernels call is brought to the compiler's intermediate form, linked as it is, and
    optimised where it ends up, for its callers there alone. Measured on numba 0.68, processor time of compiling all
    kernels: 109 s instead of 179 s, those of a heliostat field 22 s instead of 51 s, which run in 0.94 of the time.

    It reaches into the compiler, so it is done for the versions alone that it was tried with. With any other, kernels
    compile as they do by themselves, to the same results.

    Parameters
    ----------
    whole, part : numba.core.dispatcher.Dispatcher
        The kernel, and the same without what Python calls it by; each compiled on its first call.
    """
    if numba.version_info.short not in _TRIED_WITH:
        return
    compile_alone, template = whole.compile, part.get_call_template

    def compile_of_parts(signature: Any) -> Any:
        with global_compiler_lock:
            found = whole._cache.load_overload(signature, whole.targetctx)
            if found is not None:
                whole._cache.loaded[signature] = found
            elif isinstance(whole._cache, CodeCache):
                start_helper()
            with nullcontext() if found is not None else _parts():
                return compile_alone(signature)

    def call_template(args: Any, kws: Any) -> Any:
        """As a call, but a number that is written out is no reason to compile again, unless its place is the caller."""
        if "forceinline" not in part.targetoptions:
            args, kws = [types.unliteral(each) for each in args], {k: types.unliteral(each) for k, each in kws.items()}
        return template(args, kws)

    whole.part, whole.compile, whole.get_call_template, whole.get_overload = (
        part, compile_of_parts, call_template, part.get_overload,
    )  # fmt: skip


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
    """Module that is linked as it is, and optimised and made code only where Python asks for it."""

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

    def serialize_using_object_code(self) -> Any:
        return self.serialize_using_bitcode() if self._is_part else super().serialize_using_object_code()

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "bitcode":
            return super()._unserialize(codegen, state)
        part = cls(codegen, name)
        part._is_part, part._final_module = True, ll.parse_bitcode(data)
        part._finalize_final_module()
        return part

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

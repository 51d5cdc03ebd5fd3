"""Kernels that only other kernels call. They have no machine code of their own.

Numba makes machine code of each function that it compiles, and of the function's copy in each of its callers once more.
Of a private kernel only the optimised code in LLVM's language is made and kept: that is what callers are linked with.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, compile_result
from numba.core.dispatcher import Dispatcher

from .kernel import Kernel

__all__ = ["LoopCompiler", "PrivateCompiler", "make_private"]


class _Codegen:
    """Numba's code generator as `CPUContext.get_executable` uses it: nothing has an address that could be told one."""

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing."""


class _Library(JITCodeLibrary):  # type: ignore[misc] # numba is untyped
    """The code of a private kernel and its callees."""

    @classmethod
    def known(cls, codegen: Any, name: str, bitcode: bytes) -> _Library:
        """A library that was kept."""
        library = cls(codegen, name)
        library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library

    @property
    def codegen(self) -> Any:
        """What takes environments."""
        return _Codegen()

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """The arguments of `known`."""
        return self.name, self._get_module_for_linking().as_bitcode()

    def _finalize_final_module(self) -> None:
        """After the code was optimised: everything that Numba does here except making machine code."""
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class PrivateCompiler(Compiler):  # type: ignore[misc] # numba is untyped
    """Numba's compiler, with our library for the result."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        self.state.library = _Library(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class LoopCompiler(PrivateCompiler):
    """For the body of a parallel loop: arrays that it writes are known to it by one name (`outline`), so what it has
    read from others need not be read again after a write."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        self.state.flags.noalias = True
        return super().compile_extra(func)


class _Results(CompileResultCacheImpl):  # type: ignore[misc] # numba is untyped
    """Turns results into what is kept, and back."""

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """A result from the tuple that Numba's `CompileResult._reduce` gives."""
        library, fndesc, environment, signature, _, _, annotation, reload_init, referenced = payload
        made = _Library.known(target_context.codegen(), *library)
        return compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=made,
            environment=environment,
            entry_point=target_context.get_executable(made, fndesc, environment),  # callers know the kernel by it
            fndesc=fndesc,
            type_annotation=annotation,
            signature=signature,
            objectmode=False,
            lifted=(),
            reload_init=reload_init,
            referenced_envs=referenced,
        )


class _Cache(FunctionCache):  # type: ignore[misc] # numba is untyped
    _impl_class = _Results


class _Private(Kernel):
    """A kernel that has no entry for Python."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        raise TypeError(f"{self.py_func.__name__}: called from Python: its name starts with _, so only kernels call it")

    def enable_caching(self) -> None:
        """Keep what is compiled."""
        self._cache = _Cache(self.py_func)


def make_private(kernel: Dispatcher, kept: bool) -> None:
    """Make a kernel that uses `PrivateCompiler` private; kept: whether compiled kernels are kept."""
    kernel.__class__ = _Private
    if kept:
        kernel.enable_caching()

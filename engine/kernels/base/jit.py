"""How kernels are compiled: the options of Numba, spelled once.

Kernels are kept on disk (`kernel_cache`). They divide as NumPy does: a division by zero gives infinity or NaN instead
of an exception. Each decorator is used as `@serial`, or with more options as `@serial(fastmath={"contract"})`. Kernels
are untyped for type checkers, because their scalars have more types than checkers accept as numbers.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numba
from numba.core.dispatcher import Dispatcher

from .kernel_cache import keeping
from .outline import outline
from .share import share

__all__ = ["inlined", "inlined_late", "parallel", "serial"]


_SHARE = "_share_among_threads"  # in modules with parallel loops


class _Private(Dispatcher):
    """A kernel that has no entry for Python."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        raise TypeError(f"{self.py_func.__name__}: called from Python: its name starts with _, so only kernels call it")


def _decorator(**options: Any) -> Any:
    """A decorator that compiles with these options; its use may add more."""

    def decorate(function: Any = None, **more: Any) -> Any:
        if function is None:
            return functools.partial(decorate, **more)
        with keeping(Path(function.__code__.co_filename)) as kept:
            private = function.__name__.startswith("_")
            wrappers = {"no_cpython_wrapper": private, "no_cfunc_wrapper": True}  # a third of a small kernel's code
            made = numba.njit(cache=kept, error_model="numpy", **wrappers, **options, **more)(function)
        if private and isinstance(made, Dispatcher):
            made.__class__ = _Private
        return made

    return decorate


serial = _decorator(nogil=True)
"""One thread; other Python threads run meanwhile."""



def parallel(function: Any = None, **more: Any) -> Any:
    """Loops over `numba.prange` are shared among the threads of the pool; they write into arrays only (`outline`)."""
    if function is None:
        return functools.partial(parallel, **more)
    if numba.config.DISABLE_JIT:
        return serial(function, **more)
    outlined, module = outline(function, _SHARE), function.__globals__
    module[_SHARE] = share
    for name, loop in outlined.loops.items():
        if name in module:
            raise ValueError(f"{module['__name__']}: {name}: expected no other thing of this name: it is a loop's")
        module[name] = serial(loop, **more)
    return serial(outlined.caller, **more)


inlined = _decorator(inline="always")
"""Becomes part of its callers before they are typed: tuples stay in registers, callers' options count."""

inlined_late = _decorator(forceinline=True)
"""Becomes part of its callers in LLVM, after it was compiled by itself: less to compile than `inlined`."""

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

from .kernel import Kernel
from .kernel_cache import keeping
from .outline import outline
from .private import LoopCompiler, PrivateCompiler, make_private
from .share import share

__all__ = ["inlined", "inlined_late", "parallel", "serial"]


_SHARE = "_share_among_threads"  # in modules with parallel loops


def _decorator(**options: Any) -> Any:
    """A decorator that compiles with these options; its use may add more."""

    def decorate(function: Any = None, **more: Any) -> Any:
        if function is None:
            return functools.partial(decorate, **more)
        with keeping(Path(function.__code__.co_filename)) as kept:
            private = function.__name__.startswith("_")
            wrappers = {"no_cpython_wrapper": private, "no_cfunc_wrapper": True}  # a third of a small kernel's code
            compiler = {"pipeline_class": PrivateCompiler} if private else {}
            chosen = {**compiler, **wrappers, **options, **more}
            made = numba.njit(cache=kept, error_model="numpy", **chosen)(function)
            if isinstance(made, Dispatcher):  # otherwise nothing is compiled
                made.__class__ = Kernel
                if private:
                    make_private(made, kept)
        return made

    return decorate


serial = _decorator(nogil=True)
"""One thread; other Python threads run meanwhile."""

_loop = _decorator(nogil=True, pipeline_class=LoopCompiler)


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
        module[name] = _loop(loop, **more)
    return serial(outlined.caller, **more)


inlined = _decorator(inline="always")
"""Becomes part of its callers before they are typed: tuples stay in registers, callers' options count."""

inlined_late = _decorator(forceinline=True)
"""Becomes part of its callers in LLVM, after it was compiled by itself: less to compile than `inlined`."""

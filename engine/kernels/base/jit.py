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

from .kernel_cache import keeping

__all__ = ["inlined", "inlined_late", "parallel", "serial"]


def _decorator(**options: Any) -> Any:
    """A decorator that compiles with these options; its use may add more."""

    def decorate(function: Any = None, **more: Any) -> Any:
        if function is None:
            return functools.partial(decorate, **more)
        with keeping(Path(function.__code__.co_filename)) as kept:
            return numba.njit(cache=kept, error_model="numpy", **options, **more)(function)

    return decorate


serial = _decorator(nogil=True)
"""One thread; other Python threads run meanwhile."""

parallel = _decorator(parallel=True, nogil=True)
"""Loops over `numba.prange` are shared among the threads of the pool."""

inlined = _decorator(inline="always")
"""Becomes part of its callers before they are typed: tuples stay in registers, callers' options count."""

inlined_late = _decorator(forceinline=True)
"""Becomes part of its callers in LLVM, after it was compiled by itself: less to compile than `inlined`."""

"""How kernels are compiled: the options of Numba, spelled once.

All kernels are cached on disk, and divide as NumPy does: a division by zero gives infinity or NaN instead of an
exception. Each decorator is used as `@serial`, or with more options as `@serial(fastmath={"contract"})`. Kernels are
untyped for type checkers, because their scalars have more types than checkers accept as numbers.
"""

from __future__ import annotations

from typing import Any

import numba

__all__ = ["inlined", "inlined_late", "parallel", "serial"]


def _decorator(**options: Any) -> Any:
    """A decorator that compiles with these options; its use may add more."""

    def decorate(function: Any = None, **more: Any) -> Any:
        compiled = numba.njit(cache=True, error_model="numpy", **options, **more)
        return compiled if function is None else compiled(function)

    return decorate


serial = _decorator(nogil=True)
"""One thread; other Python threads run meanwhile."""

parallel = _decorator(parallel=True, nogil=True)
"""Loops over `numba.prange` are shared among the threads of the pool."""

inlined = _decorator(inline="always")
"""Becomes part of its callers before they are typed: tuples stay in registers, callers' options count."""

inlined_late = _decorator(forceinline=True)
"""Becomes part of its callers in LLVM, after it was compiled by itself: less to compile than `inlined`."""

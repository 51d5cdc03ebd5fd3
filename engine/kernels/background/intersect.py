"""Embree's calls for a single ray, as kernels make them.

In compiled code a call is part of the kernel, the ray is made in registers and on the stack (`intersect_llvm`); where
nothing is compiled it goes through ctypes (`intersect_numpy`). The function, the scene and the query come as addresses,
because a ctypes function pointer as a global would keep Numba from caching the kernels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

__all__ = ["intersect1"]

if TYPE_CHECKING or config.DISABLE_JIT:
    from .intersect_numpy import intersect1
else:
    from .intersect_llvm import intersect1

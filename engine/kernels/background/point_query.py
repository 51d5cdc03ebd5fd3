"""Embree's search for what is near a point, as kernels call it, and its record of a search as callbacks read it.

In compiled code a call is part of the kernel (`point_query_llvm`); where nothing is compiled it goes through ctypes
(`point_query_numpy`). The function, the scene and the callback come as addresses (`intersect` tells why). Embree calls
the callback with the address of an RTCPointQueryFunctionArguments for each triangle whose box the search touches, also
for those that are flagged as invalid: it knows no filters here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

__all__ = ["CONTEXT", "GEOM_ID", "PRIM_ID", "QUERY", "USER", "point_query", "read_query", "shrink_query"]

# RTCPointQueryFunctionArguments: words of eight bytes (addresses), and of four (numbers of the triangle).
QUERY, USER, CONTEXT = 0, 1, 3
PRIM_ID, GEOM_ID = 4, 5

if TYPE_CHECKING or config.DISABLE_JIT:
    from .point_query_numpy import point_query, read_query, shrink_query
else:
    from .point_query_llvm import point_query, read_query, shrink_query

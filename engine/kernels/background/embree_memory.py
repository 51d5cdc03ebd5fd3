"""Counts the memory that Embree allocates: compiled code that its threads call without Python."""

from __future__ import annotations

from typing import Any

import numba
from numba import types
from numba.extending import intrinsic

from ..base.memory_llvm import add_atomically

__all__ = ["count_bytes"]


@intrinsic
def _add(typing: Any, address: Any, value: Any) -> Any:
    """Adds to the int64 at an address, whatever other threads add to it at the same time."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        add_atomically(builder, arguments[1], arguments[0])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), codegen


@numba.cfunc(types.uint8(types.intp, types.intp, types.uint8), cache=True)
def count_bytes(counter: int, size: int, after: int) -> int:
    """RTCMemoryMonitorFunction: adds `size` bytes (negative: freed) to the int64 at `counter`, and lets Embree go on
    (1). Embree calls it before or after (`after`) each allocation, from any of its threads."""
    _add(counter, size)
    return 1

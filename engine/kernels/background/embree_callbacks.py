"""What Embree calls back, from any of its threads and without Python: filters of hits, and a count of its memory.

Filters get RTCFilterFunctionNArguments, six words of eight bytes of Embree's own. With rtcIntersect1, N is 1 and the
hit is the second half of an RTCRayHit (`ray_hit`).
"""

from __future__ import annotations

import numba
from numba import types

from ..base.callbacks import callback
from ..base.memory import (
    add_i64_atomically,
    load_foreign_i64,
    load_foreign_u32,
    load_i64,
    load_u8,
    load_u64,
    or_u64,
    store_foreign_i32,
)
from .ray_hit import GEOM_ID, HIT, PRIM_ID
from .surfaces import MARKS, MARKS_SIZE, WORDS

__all__ = ["BITS", "CONTEXT_SIZE", "TABLE", "WORD", "count_bytes", "mark_and_pass", "skip_invalid"]

_VALID, _USER_DATA, _CONTEXT, _RAY, _HIT, _N = range(6)  # of RTCFilterFunctionNArguments
# The context of a query is int64 [CONTEXT_SIZE]: RTCRayQueryContext, padded to 16 bytes, then the address of a table of
# marks (`surfaces`), the number of a word of a triangle's marks, and the bits that it gets.
TABLE, WORD, BITS = range(2, 5)
CONTEXT_SIZE = 5


@callback(types.void(types.intp))
def skip_invalid(arguments: int) -> None:
    """Intersect filter of a geometry whose user data is a uint8 flag a triangle: flagged ones are not there."""
    primitive = load_foreign_u32(load_foreign_i64(arguments, _HIT), PRIM_ID - HIT)
    if load_u8(load_foreign_i64(arguments, _USER_DATA), primitive):
        store_foreign_i32(load_foreign_i64(arguments, _VALID), 0, numba.int32(0))


@callback(types.void(types.intp))
def mark_and_pass(arguments: int) -> None:
    """Intersect filter of a query: marks every triangle on the ray's interval, and lets the ray go on."""
    context, hit = load_foreign_i64(arguments, _CONTEXT), load_foreign_i64(arguments, _HIT)
    primitive, geometry = load_foreign_u32(hit, PRIM_ID - HIT), load_foreign_u32(hit, GEOM_ID - HIT)
    table, entry = load_i64(context, TABLE), MARKS_SIZE * geometry
    index = primitive * load_i64(table, entry + WORDS) + load_i64(context, WORD)
    or_u64(load_i64(table, entry + MARKS), index, load_u64(context, BITS))
    store_foreign_i32(load_foreign_i64(arguments, _VALID), 0, numba.int32(0))


@callback(types.uint8(types.intp, types.intp, types.uint8))
def count_bytes(counter: int, size: int, after: int) -> int:
    """RTCMemoryMonitorFunction: adds `size` bytes (negative: freed) to the int64 at `counter`, and lets Embree go on
    (1). Embree calls it before or after (`after`) each allocation, from any of its threads."""
    add_i64_atomically(counter, 0, size)
    return 1

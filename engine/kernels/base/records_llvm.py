"""`records` in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .memory_scalars_llvm import place_of
from .vectors_llvm import FLOATS, INTEGERS, LANES, MASK, joined, order_of

__all__ = ["gather_records", "load_triples"]


@intrinsic
def load_triples(typingctx: Any, address: Any, index: Any) -> Any:
    """The three int32 of each of sixteen records from address + 12 * index on, field by field."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        record = ir.ArrayType(ir.IntType(32), 3)
        loaded = builder.load(place_of(builder, record, *args), typ=ir.VectorType(ir.IntType(32), 3 * LANES), align=4)
        fields = [builder.shuffle_vector(loaded, loaded, order_of(range(k, 3 * LANES, 3))) for k in range(3)]
        return context.make_tuple(builder, signature.return_type, fields)

    return types.containers.UniTuple(INTEGERS, 3)(types.int64, types.int64), codegen


@intrinsic
def gather_records(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """The four float32 of each lane's record at address + 16 * index, field by field; where the mask is false those of
    record 0, which must exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, mask = args
        record, loaded = ir.VectorType(ir.FloatType(), 4), []
        number = builder.select(mask, index, ir.Constant(index.type, None))
        for lane in range(LANES):
            at = builder.zext(builder.extract_element(number, ir.IntType(32)(lane)), ir.IntType(64))
            loaded.append(builder.load(place_of(builder, record, address, at), typ=record, align=4))
        # Records that are four apart are joined: then no number has to move to another quarter of a register, which
        # would take longer.
        rows = [joined(builder, loaded[k::4]) for k in range(4)]
        return context.make_tuple(builder, signature.return_type, _transposed(builder, rows))

    return types.containers.UniTuple(FLOATS, 4)(types.int64, INTEGERS, MASK), codegen


def _transposed(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Four vectors: each quarter of them, 4 x 4 numbers, is transposed."""
    columns = []
    for order in ((0, 4, 1, 5), (2, 6, 3, 7)):
        low, high = (_by_quarter(builder, rows[k], rows[k + 1], order) for k in (0, 2))
        columns += [_by_quarter(builder, low, high, (0, 1, 4, 5)), _by_quarter(builder, low, high, (2, 3, 6, 7))]
    return columns


def _by_quarter(builder: Any, a: Any, b: Any, order: tuple[int, int, int, int]) -> Any:
    """In each quarter of two vectors, numbers of it in an order: 0 to 3 of the first one, 4 to 7 of the second one."""
    lanes = [4 * quarter + k % 4 + k // 4 * LANES for quarter in range(LANES // 4) for k in order]
    return builder.shuffle_vector(a, b, order_of(lanes))

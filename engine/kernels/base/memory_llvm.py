"""Operations of `memory` on vectors in compiled code: opaque pointers, made of addresses; nothing is checked."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .memory_scalars_llvm import place_of
from .vectors_llvm import FLOATS, INTEGERS, LANES, MASK, call_intrinsic, ir_type, order_of, splat

__all__ = [
    "BEYOND",
    "VECTOR_BYTES",
    "gather_bytes",
    "gather_floats",
    "gather_halves",
    "gather_integers",
    "gather_quads",
    "load",
    "load_where",
    "prefetch",
    "store",
    "store_byte_where",
    "store_larger",
    "store_packed",
    "store_where",
]

VECTOR_BYTES = 4 * LANES  # of sixteen float32 or int32
BEYOND = 3  # bytes behind the one that is meant which `gather_bytes` reads, too


@intrinsic
def load(typingctx: Any, address: Any, index: Any) -> Any:
    """Sixteen float32 side by side from address + 4 * index."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(place_of(builder, ir.FloatType(), *args), typ=ir_type(FLOATS), align=4)

    return FLOATS(types.int64, types.int64), codegen


@intrinsic
def store(typingctx: Any, address: Any, index: Any, values: Any) -> Any:
    """Write floats to sixteen float32 side by side from address + 4 * index."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], place_of(builder, ir.FloatType(), *args[:2]), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, FLOATS), codegen


@intrinsic
def store_larger(typingctx: Any, address: Any, index: Any, x: Any, y: Any) -> Any:
    """As `store` of the larger of two in each lane, neither of them NaN.

    In one piece: a `select` before a `store` becomes a store where a mask is true, and a load of the same place soon
    after waits until that has reached the memory."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        larger = call_intrinsic(builder, f"llvm.maxnum.v{LANES}f32", args[2].type, *args[2:], fastmath=("nnan", "nsz"))
        builder.store(larger, place_of(builder, ir.FloatType(), *args[:2]), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, FLOATS, FLOATS), codegen


@intrinsic
def load_where(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """As `load` where the mask is true, 0 elsewhere; what is masked out need not exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind, place = ir_type(FLOATS), place_of(builder, ir.FloatType(), *args[:2])
        nothing, alignment = ir.Constant(kind, None), ir.IntType(32)(4)
        return call_intrinsic(builder, f"llvm.masked.load.v{LANES}f32.p0", kind, place, alignment, args[2], nothing)

    return FLOATS(types.int64, types.int64, MASK), codegen


def _masked_store(builder: Any, name: str, values: Any, place: Any, bytes_each: int, mask: Any) -> None:
    alignment = ir.IntType(32)(bytes_each)
    call_intrinsic(builder, f"llvm.masked.store.v{LANES}{name}.p0", ir.VoidType(), values, place, alignment, mask)


@intrinsic
def store_where(typingctx: Any, address: Any, index: Any, values: Any, mask: Any) -> Any:
    """As `store` where the mask is true; elsewhere nothing is written."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _masked_store(builder, "f32", args[2], place_of(builder, ir.FloatType(), *args[:2]), 4, args[3])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, FLOATS, MASK), codegen


@intrinsic
def store_byte_where(typingctx: Any, address: Any, index: Any, number: Any, mask: Any) -> Any:
    """Write the low byte of a number to those of sixteen bytes from address + index where the mask is true."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte = ir.IntType(8)
        numbers = splat(builder, builder.trunc(args[2], byte))
        _masked_store(builder, "i8", numbers, place_of(builder, byte, *args[:2]), 1, args[3])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, MASK), codegen


@intrinsic
def store_packed(typingctx: Any, address: Any, values: Any, mask: Any) -> Any:
    """Write those integers where the mask is true side by side to int32 from address on; returns how many. There must
    be room for sixteen: what is behind them counts for nothing afterwards.

    They are packed in a register: a store that packs takes some processors 140 cycles."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, values, mask = args
        name, nothing = f"llvm.experimental.vector.compress.v{LANES}i32", ir.Constant(values.type, ir.Undefined)
        packed = call_intrinsic(builder, name, values.type, values, mask, nothing)
        builder.store(packed, builder.inttoptr(address, ir.PointerType()), align=4)
        bits = builder.bitcast(mask, ir.IntType(LANES))
        return builder.zext(call_intrinsic(builder, f"llvm.ctpop.i{LANES}", bits.type, bits), ir.IntType(64))

    return types.int64(types.int64, INTEGERS, MASK), codegen


@intrinsic
def prefetch(typingctx: Any, address: Any, index: Any) -> Any:
    """Have what lies at address + 2 * the first lane of index ready soon; it need not exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        first = builder.extract_element(args[1], ir.IntType(32)(0))
        place = place_of(builder, ir.IntType(16), args[0], first)
        read, near, data = ir.IntType(32)(0), ir.IntType(32)(3), ir.IntType(32)(1)
        call_intrinsic(builder, "llvm.prefetch.p0", ir.VoidType(), place, read, near, data)
        return context.get_dummy_value()

    return types.void(types.int64, INTEGERS), codegen


def _gather(element: int, bits: int) -> Any:
    """Signature and code of a gather of `bits` from (address, index in elements of so many bits, mask)."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, mask = args
        loaded = ir.VectorType(ir.IntType(bits), LANES)
        start = splat(builder, builder.inttoptr(address, ir.PointerType()))  # LLVM makes one number of it again
        places = builder.gep(start, [index], source_etype=ir.IntType(element))
        nothing, alignment = ir.Constant(loaded, None), ir.IntType(32)(1)
        return call_intrinsic(
            builder, f"llvm.masked.gather.v{LANES}i{bits}.v{LANES}p0", loaded, places, alignment, mask, nothing
        )

    return codegen


@intrinsic
def gather_halves(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 32 bits at address + 2 * index: two uint16 side by side, the first in the low half."""
    return INTEGERS(types.int64, INTEGERS, MASK), _gather(16, 32)


@intrinsic
def gather_bytes(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 32 bits at address + index: four uint8 side by side, the first lowest."""
    return INTEGERS(types.int64, INTEGERS, MASK), _gather(8, 32)


@intrinsic
def gather_integers(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the int32 at address + 4 * index."""
    return INTEGERS(types.int64, INTEGERS, MASK), _gather(32, 32)


@intrinsic
def gather_floats(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the float32 at address + 4 * index."""
    gather = _gather(32, 32)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(gather(context, builder, signature, args), ir_type(FLOATS))

    return FLOATS(types.int64, INTEGERS, MASK), codegen


@intrinsic
def gather_quads(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 64 bits at address + 2 * index, four uint16 side by side: those of the first eight
    lanes in one result, of the others in the next, two pairs a lane."""
    gather = _gather(16, 64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        quads = builder.bitcast(gather(context, builder, signature, args), ir.VectorType(ir.IntType(32), 2 * LANES))
        halves = [builder.shuffle_vector(quads, quads, order_of(range(k, k + LANES))) for k in (0, LANES)]
        return context.make_tuple(builder, signature.return_type, halves)

    return types.containers.UniTuple(INTEGERS, 2)(types.int64, INTEGERS, MASK), codegen

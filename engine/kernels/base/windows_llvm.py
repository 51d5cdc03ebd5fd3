"""`windows` in compiled code: permutations of 64 uint16 in registers are an instruction of AVX-512 (BW)."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from .memory_scalars_llvm import place_of
from .vectors_llvm import FLOATS, INTEGERS, LANES, MASK, call_intrinsic, ir_type, joined, order_of, splat

__all__ = [
    "extent_of",
    "fast_windows",
    "lane_of",
    "load_square",
    "lower_rows",
    "pairs_within",
    "prefetch_window",
    "quads_within",
    "store_square",
    "upper_rows",
    "window_of_bytes",
    "window_of_halves",
]

_ROWS = 8
_WINDOW = types.containers.UniTuple(INTEGERS, _ROWS // 2)
_HALVES, _INTEGERS = ir.VectorType(ir.IntType(16), 2 * LANES), ir_type(INTEGERS)
_I32 = ir.IntType(32)


def _permutes(context: Any) -> bool:
    """Whether the processor that is compiled for has the instruction."""
    _, cpu, features = context.codegen().magic_tuple()
    return cpu == "x86-64-v4" or "+avx512bw" in features.split(",")


@intrinsic
def fast_windows(typingctx: Any) -> Any:
    """Whether picking from windows is faster than gathers; a constant, so that the other way is not compiled."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.IntType(1)(_permutes(context))

    return types.boolean(), codegen


def _rows(context: Any, builder: Any, signature: Any, args: Any, bits: int) -> Any:
    """The code of a window of numbers of so many bits."""
    address, index, pitch = args
    element, halves, rows = ir.IntType(bits), ir.VectorType(ir.IntType(16), LANES), []
    for _ in range(_ROWS):
        place = place_of(builder, element, address, index)
        row = builder.load(place, typ=ir.VectorType(element, LANES), align=bits // 8)
        rows.append(row if bits == 16 else builder.zext(row, halves))
        index = builder.add(index, pitch)
    pairs = [builder.bitcast(joined(builder, rows[k : k + 2]), _INTEGERS) for k in range(0, _ROWS, 2)]
    return context.make_tuple(builder, signature.return_type, pairs)


@intrinsic
def window_of_halves(typingctx: Any, address: Any, index: Any, pitch: Any) -> Any:
    """Eight rows of sixteen uint16, from address + 2 * index on and `pitch` elements apart."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _rows(context, builder, signature, args, 16)

    return _WINDOW(types.int64, types.int64, types.int64), codegen


@intrinsic
def window_of_bytes(typingctx: Any, address: Any, index: Any, pitch: Any) -> Any:
    """Eight rows of sixteen uint8, as uint16, from address + index on and `pitch` elements apart."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _rows(context, builder, signature, args, 8)

    return _WINDOW(types.int64, types.int64, types.int64), codegen


@intrinsic
def prefetch_window(typingctx: Any, address: Any, index: Any, pitch: Any) -> Any:
    """Have a window of uint16 ready soon; it need not exist. For one of uint8, halve the index and the pitch."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, pitch = args
        read, near, data = _I32(0), _I32(3), _I32(1)
        for _ in range(_ROWS):
            place = place_of(builder, ir.IntType(16), address, index)
            call_intrinsic(builder, "llvm.prefetch.p0", ir.VoidType(), place, read, near, data)
            index = builder.add(index, pitch)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def lane_of(typingctx: Any, x: Any, lane: Any) -> Any:
    """One of sixteen integers."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.sext(builder.extract_element(args[0], args[1]), ir.IntType(64))

    return types.int64(INTEGERS, types.int64), codegen


def _picked(context: Any, builder: Any, window: Any, order: Any) -> Any:
    """Elements number `order` (two in each integer) of a window, as integers with two each."""
    parts = [builder.bitcast(part, _HALVES) for part in cgutils.unpack_tuple(builder, window)]
    order = builder.bitcast(order, _HALVES)
    if _permutes(context):
        name = "llvm.x86.avx512.vpermi2var.hi.512"
        upper, lower = (call_intrinsic(builder, name, _HALVES, a, order, b) for a, b in (parts[:2], parts[2:]))
        below = builder.icmp_unsigned("!=", builder.and_(order, _halves(64)), _halves(0))
        return builder.bitcast(builder.select(below, lower, upper), _INTEGERS)
    whole = joined(builder, parts)  # never fast, but right everywhere
    number = builder.zext(builder.and_(order, _halves(127)), ir.VectorType(_I32, 2 * LANES))
    picked = ir.Constant(_HALVES, ir.Undefined)
    for lane in map(_I32, range(2 * LANES)):
        half = builder.extract_element(whole, builder.extract_element(number, lane))
        picked = builder.insert_element(picked, half, lane)
    return builder.bitcast(picked, _INTEGERS)


def _halves(number: int) -> Any:
    return ir.Constant(_HALVES, [number] * (2 * LANES))


def _doubled(builder: Any, places: Any) -> Any:
    """Each lane's place in both halves of the lane."""
    inside = builder.and_(places, splat(builder, _I32(127)))
    return builder.mul(inside, splat(builder, _I32(0x10001)))


@intrinsic
def pairs_within(typingctx: Any, window: Any, places: Any) -> Any:
    """Of a window, the element at each lane's place, 16 * row + column, and the next one, the first in the low half;
    anything where a place lies elsewhere."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        order = builder.add(_doubled(builder, args[1]), splat(builder, _I32(0x10000)))
        return _picked(context, builder, args[0], order)

    return INTEGERS(_WINDOW, INTEGERS), codegen


@intrinsic
def quads_within(typingctx: Any, window: Any, places: Any) -> Any:
    """Of a window, the element at each lane's place and the next three: those of the first eight lanes in one result,
    of the others in the next, two pairs a lane; anything where a place lies elsewhere."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        both, found = _doubled(builder, args[1]), []
        ahead = ir.Constant(_INTEGERS, [0x10000, 0x30002] * (LANES // 2))
        for half in (0, LANES // 2):
            twice = builder.shuffle_vector(both, both, order_of(half + lane // 2 for lane in range(LANES)))
            found.append(_picked(context, builder, args[0], builder.add(twice, ahead)))
        return context.make_tuple(builder, signature.return_type, found)

    return types.containers.UniTuple(INTEGERS, 2)(_WINDOW, INTEGERS), codegen


@intrinsic
def extent_of(typingctx: Any, x: Any, y: Any, among: Any) -> Any:
    """The least x and y and the largest ones where the mask is true; x and y are 0 to 65534. Where it is nowhere, the
    least are larger than the largest."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x, y, among = args
        both = builder.or_(x, builder.shl(y, splat(builder, _I32(16))))
        found = []
        for name, nothing in (("umin", -1), ("umax", 0)):
            left = builder.bitcast(builder.select(among, both, splat(builder, _I32(nothing))), _HALVES)
            while left.type.count > 2:
                size = left.type.count // 2
                low, high = (
                    builder.shuffle_vector(left, left, ir.Constant(ir.VectorType(_I32, size), [*range(k, k + size)]))
                    for k in (0, size)
                )
                left = call_intrinsic(builder, f"llvm.{name}.v{size}i16", low.type, low, high)
            found += [builder.zext(builder.extract_element(left, _I32(k)), ir.IntType(64)) for k in (0, 1)]
        return context.make_tuple(builder, signature.return_type, found)

    return types.containers.UniTuple(types.int64, 4)(INTEGERS, INTEGERS, MASK), codegen


@intrinsic
def load_square(typingctx: Any, address: Any, index: Any, pitch: Any) -> Any:
    """Four rows of four float32, from address + 4 * index on and `pitch` elements apart."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, pitch = args
        parts = []
        for _ in range(4):
            place = place_of(builder, ir.FloatType(), address, index)
            parts.append(builder.load(place, typ=ir.VectorType(ir.FloatType(), 4), align=4))
            index = builder.add(index, pitch)
        return joined(builder, parts)

    return FLOATS(types.int64, types.int64, types.int64), codegen


@intrinsic
def store_square(typingctx: Any, address: Any, index: Any, pitch: Any, values: Any) -> Any:
    """Write sixteen floats as four rows of four float32, from address + 4 * index on and `pitch` elements apart."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, pitch, values = args
        for row in range(4):
            order = ir.Constant(ir.VectorType(_I32, 4), list(range(4 * row, 4 * row + 4)))
            part = builder.shuffle_vector(values, values, order)
            builder.store(part, place_of(builder, ir.FloatType(), address, index), align=4)
            index = builder.add(index, pitch)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, FLOATS), codegen


def _chosen(first: int) -> Any:
    lanes = [row + lane for row in (0, 4, 16, 20) for lane in (first, first + 1, first + 8, first + 9)]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.shuffle_vector(args[0], args[1], order_of(lanes))

    return FLOATS(FLOATS, FLOATS), codegen


@intrinsic
def upper_rows(typingctx: Any, top: Any, bottom: Any) -> Any:
    """Of four squares' four rows of two, left and right ones in each of two vectors, the first and the third rows, as
    four rows of four."""
    return _chosen(0)


@intrinsic
def lower_rows(typingctx: Any, top: Any, bottom: Any) -> Any:
    """As `upper_rows`: the second and the fourth rows."""
    return _chosen(2)

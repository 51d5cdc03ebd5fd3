"""Operations of `memory` on single numbers in compiled code: opaque pointers, made of addresses; nothing is checked."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

__all__ = [
    "add_i64_atomically",
    "load_as",
    "load_eight_u8",
    "load_f32",
    "load_foreign_i64",
    "load_foreign_u32",
    "load_i64",
    "load_u8",
    "load_u16",
    "load_u32",
    "load_u64",
    "or_u64",
    "place_of",
    "store_as",
    "store_foreign_i32",
]


def load_as(builder: Any, address: Any, kind: Any, align: int | None = None) -> Any:
    """Code that loads a value of a type in LLVM from an address that is a multiple of `align` bytes."""
    return builder.load(builder.inttoptr(address, ir.PointerType()), typ=kind, align=align)


def store_as(builder: Any, value: Any, address: Any, align: int | None = None) -> None:
    """Code that stores a value at an address that is a multiple of `align` bytes."""
    builder.store(value, builder.inttoptr(address, ir.PointerType()), align=align)


def place_of(builder: Any, element: Any, address: Any, index: Any) -> Any:
    """Code for the pointer to element `index`, of a type in LLVM, from an address on."""
    return builder.gep(builder.inttoptr(address, ir.PointerType()), [index], source_etype=element)


def _scalar_load(element: Any, result: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(place_of(builder, element, *args), typ=element)

    return result(types.int64, types.int64), codegen


def _unsigned_load(bits: int) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        element = ir.IntType(bits)
        return builder.zext(builder.load(place_of(builder, element, *args), typ=element), ir.IntType(64))

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def load_u8(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint8 at address + index, as int64."""
    return _unsigned_load(8)


@intrinsic
def load_u16(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint16 at address + 2 * index, as int64."""
    return _unsigned_load(16)


@intrinsic
def load_u32(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint32 at address + 4 * index, as int64."""
    return _unsigned_load(32)


@intrinsic
def load_u64(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint64 at address + 8 * index."""
    return _scalar_load(ir.IntType(64), types.uint64)


@intrinsic
def load_eight_u8(typingctx: Any, address: Any, index: Any) -> Any:
    """Eight uint8 side by side from address + index, wherever that is, as one int64; the first lowest."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(place_of(builder, ir.IntType(8), *args), typ=ir.IntType(64), align=1)

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def load_f32(typingctx: Any, address: Any, index: Any) -> Any:
    """The float32 at address + 4 * index."""
    return _scalar_load(ir.FloatType(), types.float32)


@intrinsic
def load_i64(typingctx: Any, address: Any, index: Any) -> Any:
    """The int64 at address + 8 * index."""
    return _scalar_load(ir.IntType(64), types.int64)


# Memory that is of no array: compiled code does not know one from the other.
load_foreign_i64, load_foreign_u32 = load_i64, load_u32


@intrinsic
def store_foreign_i32(typingctx: Any, address: Any, index: Any, value: Any) -> Any:
    """Write an int32 to address + 4 * index, in memory that is of no array."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], place_of(builder, ir.IntType(32), *args[:2]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int32), codegen


@intrinsic
def or_u64(typingctx: Any, address: Any, index: Any, bits: Any) -> Any:
    """Set bits of the uint64 at address + 8 * index; threads that set the same bits do not disturb one another."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = place_of(builder, ir.IntType(64), *args[:2])
        builder.store(builder.or_(builder.load(place, typ=ir.IntType(64)), args[2]), place)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.uint64), codegen


@intrinsic
def add_i64_atomically(typingctx: Any, address: Any, index: Any, value: Any) -> Any:
    """Add to the int64 at address + 8 * index; threads that add at the same time lose nothing."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        start = builder.add(args[0], builder.mul(args[1], ir.IntType(64)(8)))
        builder.atomic_rmw("add", builder.inttoptr(start, args[2].type.as_pointer()), args[2], "monotonic")
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen

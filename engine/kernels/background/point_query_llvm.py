"""`point_query` in compiled code."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ..base.memory_scalars_llvm import place_of
from .ray_hit import ALIGNMENT

__all__ = ["CONTEXT_WORDS", "INSTANCE_WORDS", "QUERY_WORDS", "RADIUS", "point_query", "read_query", "shrink_query"]

# RTCPointQuery: x, y, z, time and radius, float32, with padding. RTCPointQueryContext: two matrices of an instance,
# then the numbers of the instance (two words, -1: none) and how deep instances are, with padding. Words of four bytes.
RADIUS, QUERY_WORDS = 4, 8
INSTANCE_WORDS, CONTEXT_WORDS = (32, 33), 36
_I32, _I64, _F32 = ir.IntType(32), ir.IntType(64), ir.FloatType()


def _room(builder: Any, words: int) -> Any:
    """Code for memory on the stack, all zeros, as Embree wants it aligned; its address as a number."""
    memory = cgutils.alloca_once(builder, ir.ArrayType(_I32, words))
    memory.align = ALIGNMENT
    builder.store(ir.Constant(ir.ArrayType(_I32, words), None), memory)
    return builder.ptrtoint(memory, _I64)


def _store(builder: Any, value: Any, address: Any, index: int) -> None:
    builder.store(value, place_of(builder, _I32, address, _I32(index)))


@intrinsic
def point_query(
    typingctx: Any, function: Any, scene: Any, callback: Any, user: Any, x: Any, y: Any, z: Any, radius: Any
) -> Any:
    """rtcPointQuery: searches what is within `radius` of a point; returns the radius that the callback has left.

    `function`, `scene`, `callback` and `user`, which the callback is given, are addresses; the rest is float32.
    """
    i64, f32 = types.int64, types.float32

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, scene, callback, user, *numbers = arguments
        query, about = _room(builder, QUERY_WORDS), _room(builder, CONTEXT_WORDS)
        for index, number in zip((0, 1, 2, RADIUS), numbers, strict=True):
            _store(builder, number, query, index)
        for index in INSTANCE_WORDS:
            _store(builder, _I32(-1), about, index)
        kind = ir.FunctionType(ir.IntType(8), [cgutils.voidptr_t] * 5)
        given = [builder.inttoptr(each, cgutils.voidptr_t) for each in (scene, query, about, callback, user)]
        builder.call(builder.inttoptr(function, kind.as_pointer()), given)
        return builder.load(place_of(builder, _I32, query, _I32(RADIUS)), typ=_F32)

    return f32(i64, i64, i64, i64, f32, f32, f32, f32), codegen


@intrinsic
def read_query(typingctx: Any, address: Any) -> Any:
    """x, y, z and radius of an RTCPointQuery."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = [place_of(builder, _I32, arguments[0], _I32(index)) for index in (0, 1, 2, RADIUS)]
        values = [builder.load(place, typ=_F32) for place in places]
        return context.make_tuple(builder, signature.return_type, values)

    return types.UniTuple(types.float32, 4)(types.int64), codegen


@intrinsic
def shrink_query(typingctx: Any, address: Any, radius: Any) -> Any:
    """Sets the radius (float32) of an RTCPointQuery: from now on only what is nearer counts."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        _store(builder, arguments[1], arguments[0], RADIUS)
        return context.get_dummy_value()

    return types.void(types.int64, types.float32), codegen

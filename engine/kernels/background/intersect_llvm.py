"""`intersect` in compiled code."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .ray_hit import (
    ALIGNMENT,
    DIR_X,
    FLAGS,
    GEOM_ID,
    ID,
    INST_ID,
    INST_PRIM_ID,
    MASK,
    ORG_X,
    PRIM_ID,
    TFAR,
    TIME,
    TNEAR,
    WORDS,
    U,
    V,
)

__all__ = ["intersect1"]

_I32, _I64, _F32 = ir.IntType(32), ir.IntType(64), ir.FloatType()


def _word(builder: Any, words: Any, index: int) -> Any:
    """Code for the place of a word of a ray."""
    return builder.gep(words, [_I32(index)], source_etype=_I32)


def _write_ray(builder: Any, words: Any, numbers: Any) -> None:
    """Code that makes a ray of origin, direction and interval, which has hit nothing yet."""
    ox, oy, oz, dx, dy, dz, near, far = numbers
    floats = {TNEAR: near, TIME: _F32(0.0), TFAR: far}
    floats |= {ORG_X: ox, ORG_X + 1: oy, ORG_X + 2: oz, DIR_X: dx, DIR_X + 1: dy, DIR_X + 2: dz}
    for index in sorted(floats):
        builder.store(floats[index], _word(builder, words, index))
    for index, number in ((MASK, -1), (ID, 0), (FLAGS, 0), (GEOM_ID, -1), (INST_ID, -1), (INST_PRIM_ID, -1)):
        builder.store(_I32(number), _word(builder, words, index))


def _call(builder: Any, function: Any, scene: Any, memory: Any, query: Any) -> None:
    """Code that calls rtcIntersect1, or another function like it."""
    signature = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t] * 3)
    builder.call(
        builder.inttoptr(function, signature.as_pointer()),
        [
            builder.inttoptr(scene, cgutils.voidptr_t),
            builder.bitcast(memory, cgutils.voidptr_t),
            builder.inttoptr(query, cgutils.voidptr_t),
        ],
    )


@intrinsic
def intersect1(
    typingctx: Any,
    function: Any,
    scene: Any,
    query: Any,
    ox: Any, oy: Any, oz: Any,
    dx: Any, dy: Any, dz: Any,
    near: Any,
    far: Any,
) -> Any:  # fmt: skip
    """rtcIntersect1: (distance, u, v, geometry, primitive); the geometry is INVALID_ID where nothing was hit.

    `function`, `scene` and `query` (RTCIntersectArguments or 0) are addresses; origin, direction and the
    interval of distances (in lengths of the direction) are float32.
    """
    f32, u32, i64 = types.float32, types.uint32, types.int64
    result = types.Tuple((f32, f32, f32, u32, u32))

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, scene, query, *numbers = arguments
        memory = cgutils.alloca_once(builder, ir.ArrayType(_I32, WORDS))
        memory.align = ALIGNMENT
        words = builder.inttoptr(builder.ptrtoint(memory, _I64), ir.PointerType())  # a cast would keep the array's type
        _write_ray(builder, words, numbers)
        _call(builder, function, scene, memory, query)
        values = [builder.load(_word(builder, words, index), typ=_F32) for index in (TFAR, U, V)]
        values += [builder.load(_word(builder, words, index), typ=_I32) for index in (GEOM_ID, PRIM_ID)]
        return context.make_tuple(builder, result, values)

    return result(i64, i64, i64, *([f32] * 8)), codegen

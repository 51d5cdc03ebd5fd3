"""Triangles drawn in strips sixteen pixels wide, a row at a time in vector registers.

A pixel is inside a triangle where three functions of its place, the sides, are not negative; they and the disparity
are sums of multiples of a pixel's column and row. No branch depends on the triangle's shape: a small one costs little
more than its rows. Sums in float32 are wrong by 1e-4 pixels where a triangle is as large as the picture, and less in
smaller ones.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["LANES", "draw_strip"]

LANES = 16

_FLOAT, _INT, _LONG = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_FLOATS = ir.VectorType(_FLOAT, LANES)
_ZERO, _ONE = ir.Constant(_FLOATS, None), ir.Constant(_FLOATS, [1.0] * LANES)
_NUMBERS = ir.Constant(_FLOATS, [float(lane) for lane in range(LANES)])


def _spread(builder: Any, scalar: Any) -> Any:
    """A number in every lane; a float64 is rounded to float32."""
    scalar = builder.fptrunc(scalar, _FLOAT) if isinstance(scalar.type, ir.DoubleType) else scalar
    kind = ir.VectorType(scalar.type, LANES)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, _INT(0))
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), ir.Constant(ir.VectorType(_INT, LANES), None))


def _numbers(builder: Any, values: Any, count: int) -> list[Any]:
    return [_spread(builder, builder.extract_value(values, k)) for k in range(count)]


def _call(builder: Any, name: str, result: Any, *args: Any) -> Any:
    kind = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def _add_product(builder: Any, a: Any, b: Any, total: Any) -> Any:
    return _call(builder, f"llvm.fmuladd.v{LANES}f32", _FLOATS, a, b, total)


def _store(builder: Any, value: Any, pointer: Any, mask: Any, kind: str) -> None:
    align = _INT(4 if kind == "f32" else 1)
    _call(builder, f"llvm.masked.store.v{LANES}{kind}.p0", ir.VoidType(), value, pointer, align, mask)


def _pointer(builder: Any, address: Any, offset: Any) -> Any:
    return builder.inttoptr(builder.add(address, offset), ir.PointerType())


def _pushed(builder: Any, q: Any, push: Any) -> Any:
    """Disparity `push` metres farther away. Dividing is slow, and only a backdrop needs it."""
    before = builder.block
    with builder.if_then(builder.fcmp_ordered(">", push, ir.Constant(push.type, 0.0))):
        farther = builder.fdiv(q, builder.fadd(_ONE, builder.fmul(q, _spread(builder, push))))
        inside = builder.block
    result = builder.phi(_FLOATS)
    result.add_incoming(q, before)
    result.add_incoming(farther, inside)
    return result


def _clamped(builder: Any, q: Any, least: Any, largest: Any) -> Any:
    q = builder.select(builder.fcmp_ordered(">", q, least), q, least)
    return builder.select(builder.fcmp_ordered("<", q, largest), q, largest)


def _draw_where_nearer(builder: Any, q: Any, mask: Any, near: Any, won: Any, margin: Any, number: Any) -> None:
    """Of a row's pixels in `mask`, those take q and the view's number that are nearer than what is there."""
    loaded = f"llvm.masked.load.v{LANES}f32.p0"
    before = _call(builder, loaded, _FLOATS, near, _INT(4), mask, _ZERO)
    beaten = builder.select(builder.fcmp_ordered(">", before, _ZERO), builder.fadd(before, margin), _ZERO)
    mask = builder.and_(mask, builder.fcmp_ordered(">", q, beaten))
    _store(builder, q, near, mask, "f32")
    _store(builder, number, won, mask, "i8")


@intrinsic
def draw_strip(
    typingctx: Any, disparity: Any, winner: Any, width: Any, count: Any, rows: Any, sides: Any, plane: Any,
    margin: Any, push: Any, view: Any,
) -> Any:  # fmt: skip
    """Draw into the first `count` of 16 columns and `rows` rows of a picture that is `width` columns wide.

    disparity, winner: addresses of the strip's first pixel in C-contiguous arrays: of disparity (float32, 0 where
    nothing was drawn) and of the number of the view that won (uint8). sides: three times (at the first pixel, change a
    column, change a row); plane: the same of disparity, its least and its largest. What was drawn must be beaten by
    `margin`; `push` metres move what is drawn away.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        disparity, winner, width, count, rows = args[:5]
        side = _numbers(builder, args[5], 9)
        start, across, down, least, largest = _numbers(builder, args[6], 5)
        margin, push = _spread(builder, args[7]), args[8]
        number = _spread(builder, builder.trunc(args[9], ir.IntType(8)))
        among = builder.fcmp_ordered("<", _NUMBERS, _spread(builder, builder.sitofp(count, _FLOAT)))
        firsts = [_add_product(builder, side[k + 1], _NUMBERS, side[k]) for k in (0, 3, 6)]
        first = _add_product(builder, across, _NUMBERS, start)
        with cgutils.for_range(builder, rows) as loop:
            row = _spread(builder, builder.sitofp(loop.index, _FLOAT))
            q = _clamped(builder, _add_product(builder, down, row, first), least, largest)
            mask = among
            for k in range(3):
                inside = _add_product(builder, side[3 * k + 2], row, firsts[k])
                mask = builder.and_(mask, builder.fcmp_ordered(">=", inside, _ZERO))
            at = builder.mul(loop.index, width)
            near, won = _pointer(builder, disparity, builder.shl(at, _LONG(2))), _pointer(builder, winner, at)
            _draw_where_nearer(builder, _pushed(builder, q, push), mask, near, won, margin, number)
        return context.get_dummy_value()

    forms = (types.containers.UniTuple(types.float64, 9), types.containers.UniTuple(types.float64, 5))
    how = (types.float64, types.float64, types.int64)
    return types.none(*(types.int64,) * 5, *forms, *how), codegen

"""Operations of `simd` in compiled code: LLVM maps them to instructions of the processor."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .vectors_llvm import FLAGS, FLOATS, INTEGERS, LANES, MASK, Vector, call_intrinsic, ir_type, order_of, splat

__all__ = [
    "LANES",
    "any_of",
    "evens",
    "lane_numbers",
    "maximum",
    "minimum",
    "odds",
    "round_down",
    "round_up",
    "select",
    "spread",
    "square_root",
    "sum_pairs",
    "to_floats",
    "to_integers",
    "zipped",
    "zipped_rest",
]

@intrinsic
def spread(typingctx: Any, number: Any) -> Any:
    """A number in all lanes, as floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return splat(builder, args[0])

    return FLOATS(types.float32), codegen


@intrinsic
def select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    """In each lane, `yes` if the condition is true, else `no`; one of them may be a number."""
    kind = yes if isinstance(yes, Vector) else no

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(*args)

    return kind(MASK, kind, kind), codegen


def _of_two(name: str) -> Callable[..., Any]:
    def typed(typingctx: Any, x: Any, y: Any) -> Any:
        kind = x if isinstance(x, Vector) else y

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            if kind.kind == "integers":
                return builder.select(builder.icmp_signed("<" if name == "min" else ">", *args), *args)
            return builder.select(builder.fcmp_ordered("<" if name == "min" else ">", *args), *args)

        return kind(kind, kind), codegen

    return typed


@intrinsic
def minimum(typingctx: Any, x: Any, y: Any) -> Any:
    """The smaller of two in each lane; one of them may be a number."""
    return _of_two("min")(typingctx, x, y)


@intrinsic
def maximum(typingctx: Any, x: Any, y: Any) -> Any:
    """The larger of two in each lane; one of them may be a number."""
    return _of_two("max")(typingctx, x, y)


@intrinsic
def square_root(typingctx: Any, x: Any) -> Any:
    """Square roots of floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return call_intrinsic(builder, f"llvm.sqrt.v{LANES}f32", args[0].type, args[0], fastmath=FLAGS)

    return FLOATS(FLOATS), codegen


def _rounding(name: str) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return call_intrinsic(builder, f"llvm.{name}.v{LANES}f32", args[0].type, args[0])

    return FLOATS(FLOATS), codegen


@intrinsic
def round_down(typingctx: Any, x: Any) -> Any:
    """The largest whole numbers not above floats, as floats."""
    return _rounding("floor")


@intrinsic
def round_up(typingctx: Any, x: Any) -> Any:
    """The smallest whole numbers not below floats, as floats."""
    return _rounding("ceil")


@intrinsic
def to_floats(typingctx: Any, x: Any) -> Any:
    """Integers as floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.sitofp(args[0], ir_type(FLOATS))

    return FLOATS(INTEGERS), codegen


@intrinsic
def to_integers(typingctx: Any, x: Any) -> Any:
    """Floats towards zero; they must be within int32."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fptosi(args[0], ir_type(INTEGERS))

    return INTEGERS(FLOATS), codegen


@intrinsic
def any_of(typingctx: Any, x: Any) -> Any:
    """Whether a lane is true."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], bits), bits(0))

    return types.boolean(MASK), codegen


def _pick(lanes: Iterable[int]) -> Any:
    """The code that chooses lanes of two concatenated vectors."""
    order = order_of(lanes)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.shuffle_vector(args[0], args[1], order)

    return codegen


@intrinsic
def evens(typingctx: Any, x: Any, y: Any) -> Any:
    """Lanes 0, 2, 4 ... of two concatenated vectors."""
    return x(x, x), _pick(range(0, 2 * LANES, 2))


@intrinsic
def odds(typingctx: Any, x: Any, y: Any) -> Any:
    """Lanes 1, 3, 5 ... of two concatenated vectors."""
    return x(x, x), _pick(range(1, 2 * LANES, 2))


@intrinsic
def zipped(typingctx: Any, x: Any, y: Any) -> Any:
    """The first eight lanes of two vectors, interleaved."""
    return x(x, x), _pick([lane // 2 + lane % 2 * LANES for lane in range(LANES)])


@intrinsic
def zipped_rest(typingctx: Any, x: Any, y: Any) -> Any:
    """The last eight lanes of two vectors, interleaved."""
    return x(x, x), _pick([(LANES + lane) // 2 + lane % 2 * LANES for lane in range(LANES)])


@intrinsic
def lane_numbers(typingctx: Any) -> Any:
    """0, 1, 2 ... 15 as floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(ir_type(FLOATS), [float(lane) for lane in range(LANES)])

    return FLOATS(), codegen


@intrinsic
def sum_pairs(typingctx: Any, pairs: Any, shares: Any) -> Any:
    """In each lane the sum of two products: of the int16 in the lower and in the upper halves of the integers."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        halves = ir.VectorType(ir.IntType(16), 2 * LANES)
        wide = ir.VectorType(ir.IntType(32), 2 * LANES)
        x, y = (builder.sext(builder.bitcast(value, halves), wide) for value in args)
        products = builder.mul(x, y)
        lower, upper = (builder.shuffle_vector(products, products, order_of(range(k, 2 * LANES, 2))) for k in (0, 1))
        return builder.add(lower, upper)

    return INTEGERS(INTEGERS, INTEGERS), codegen

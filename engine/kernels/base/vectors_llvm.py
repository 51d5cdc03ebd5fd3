"""Vector types of compiled code (LLVM) and their operators: sixteen float32, int32 or truths.

`simd` explains their purpose. Here they are declared to Numba; NumPy's operators (arithmetic, comparisons,
& | ^ >> <<) become single instructions, and Python numbers are spread over all lanes.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, models, register_model

__all__ = [
    "FLAGS",
    "FLOATS",
    "INTEGERS",
    "LANES",
    "MASK",
    "Vector",
    "call_intrinsic",
    "ir_type",
    "joined",
    "order_of",
    "splat",
]

LANES = 16

_ELEMENTS = {"floats": ir.FloatType(), "integers": ir.IntType(32), "mask": ir.IntType(1)}
FLAGS = ("nsz", "arcp", "contract")  # products may be fused with sums


class Vector(types.Type):
    """The type of sixteen values of a kind: floats (float32), integers (int32) or truths (a mask)."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        super().__init__(name=f"{kind} x {LANES}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numbers are spread over the lanes."""
        numbers = (types.Integer, types.IntegerLiteral)
        spreads = isinstance(other, (*numbers, types.Float)) if self.kind == "floats" else isinstance(other, numbers)
        return Conversion.promote if spreads and self.kind != "mask" else None


FLOATS, INTEGERS, MASK = Vector("floats"), Vector("integers"), Vector("mask")


def ir_type(kind: Any) -> Any:
    """A vector's type in LLVM."""
    return ir.VectorType(_ELEMENTS[kind.kind], LANES)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc] # numba is untyped
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir_type(kind))


def splat(builder: Any, value: Any) -> Any:
    """A scalar in all lanes."""
    vector = ir.VectorType(value.type, LANES)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)


@lower_cast(types.Integer, Vector)
@lower_cast(types.IntegerLiteral, Vector)
@lower_cast(types.Float, Vector)
def _cast(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    scalar = types.float32 if target.kind == "floats" else types.int32
    return splat(builder, context.cast(builder, value, source, scalar))


def _define(name: str, build: Callable[..., Any], result: Vector, *arguments: Vector) -> None:
    """Define an operator on vectors, and its in-place form, by its code: build(builder, *values)."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return build(builder, *args)

    for function in (getattr(operator, name), getattr(operator, f"i{name.rstrip('_')}", None)):
        if function is not None:
            lower_builtin(function, *arguments)(lower)
            template = type(function.__name__, (ConcreteTemplate,), {"cases": [signature(result, *arguments)]})
            infer_global(function)(template)


def _instruction(name: str, **options: Any) -> Callable[..., Any]:
    return lambda builder, *values: getattr(builder, name)(*values, **options)


def _comparison(method: str, sign: str) -> Callable[..., Any]:
    return lambda builder, *values: getattr(builder, method)(sign, *values)


def _define_operators() -> None:
    for name, instruction in {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}.items():
        _define(name, _instruction(instruction, flags=FLAGS), FLOATS, FLOATS, FLOATS)
    _define("neg", _instruction("fneg"), FLOATS, FLOATS)
    for name, instruction in {"add": "add", "sub": "sub", "mul": "mul", "lshift": "shl", "rshift": "lshr"}.items():
        _define(name, _instruction(instruction), INTEGERS, INTEGERS, INTEGERS)
    for kind in (INTEGERS, MASK):
        for name in ("and_", "or_", "xor"):
            _define(name, _instruction(name), kind, kind, kind)
    _define("invert", _instruction("not_"), MASK, MASK)
    for name, sign in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}.items():
        # As IEEE 754 has it: what is no number differs from everything, and compares with nothing.
        _define(name, _comparison("fcmp_unordered" if name == "ne" else "fcmp_ordered", sign), MASK, FLOATS, FLOATS)
        _define(name, _comparison("icmp_signed", sign), MASK, INTEGERS, INTEGERS)


_define_operators()


def call_intrinsic(builder: Any, name: str, result: Any, *values: Any, **options: Any) -> Any:
    """A call of an LLVM intrinsic."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, [value.type for value in values]), name
    )
    return builder.call(function, values, **options)


def order_of(lanes: Iterable[int]) -> Any:
    """The numbers of lanes as the mask of `shuffle_vector`."""
    return ir.Constant(ir.VectorType(ir.IntType(32), LANES), list(lanes))


def joined(builder: Any, parts: Sequence[Any]) -> Any:
    """Vectors of one type, a power of two of them, side by side in one."""
    while len(parts) > 1:
        both = ir.Constant(ir.VectorType(ir.IntType(32), 2 * parts[0].type.count), [*range(2 * parts[0].type.count)])
        parts = [builder.shuffle_vector(a, b, both) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]

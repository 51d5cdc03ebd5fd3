"""Vectors in kernels: sixteen floats, integers or truths that compiled code computes with as with scalars.

Loops that gather from pictures do not become vector code by themselves. These types have the operators of NumPy arrays
(arithmetic, comparisons, & | ^ >> <<), Python numbers are spread over all lanes, and the functions below do the rest.
They exist in compiled code only; LLVM turns them into what the processor has, one AVX-512 register or several smaller.
Memory is reached by address: an array handed from function to function is counted up and down each time, which costs
more than what is done with it here.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

__all__ = [
    "BEYOND",
    "LANES",
    "Floats",
    "Integers",
    "Truths",
    "any_of",
    "evens",
    "gather_bytes",
    "gather_floats",
    "gather_halves",
    "gather_integers",
    "gather_quads",
    "lane_numbers",
    "load",
    "load_float",
    "load_integer",
    "load_where",
    "maximum",
    "minimum",
    "odds",
    "prefetch",
    "round_down",
    "round_up",
    "select",
    "spread",
    "square_root",
    "store",
    "store_byte_where",
    "store_larger",
    "store_packed",
    "store_where",
    "sum_pairs",
    "to_floats",
    "to_integers",
    "zipped",
    "zipped_rest",
]

LANES = 16
BEYOND = 3  # bytes behind the one that is meant which `gather_bytes` reads, too
# Vectors, in annotations.
Floats: TypeAlias = Any
Integers: TypeAlias = Any
Truths: TypeAlias = Any

_ELEMENTS = {"floats": ir.FloatType(), "integers": ir.IntType(32), "truths": ir.IntType(1)}
_FLAGS = ("nsz", "arcp", "contract")  # products may be fused with sums


class Vector(types.Type):
    """The type of sixteen numbers of a kind: floats (float32), integers (int32) or truths."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        super().__init__(name=f"{kind} x {LANES}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numbers are spread over the lanes."""
        numbers = (types.Integer, types.IntegerLiteral)
        spreads = isinstance(other, (*numbers, types.Float)) if self.kind == "floats" else isinstance(other, numbers)
        return Conversion.promote if spreads and self.kind != "truths" else None


_FLOATS, _INTEGERS, _TRUTHS = Vector("floats"), Vector("integers"), Vector("truths")


def _ir_type(kind: Any) -> Any:
    return ir.VectorType(_ELEMENTS[kind.kind], LANES)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):  # type: ignore[misc] # numba is untyped
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _ir_type(kind))


def _spread(builder: Any, value: Any) -> Any:
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
    return _spread(builder, context.cast(builder, value, source, scalar))


def _define(name: str, build: Callable[..., Any], result: Vector, *arguments: Vector) -> None:
    """What an operator, and its form in place, does with vectors: build(builder, *values)."""

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
        _define(name, _instruction(instruction, flags=_FLAGS), _FLOATS, _FLOATS, _FLOATS)
    _define("neg", _instruction("fneg"), _FLOATS, _FLOATS)
    for name, instruction in {"add": "add", "sub": "sub", "mul": "mul", "lshift": "shl", "rshift": "lshr"}.items():
        _define(name, _instruction(instruction), _INTEGERS, _INTEGERS, _INTEGERS)
    for kind in (_INTEGERS, _TRUTHS):
        for name in ("and_", "or_", "xor"):
            _define(name, _instruction(name), kind, kind, kind)
    _define("invert", _instruction("not_"), _TRUTHS, _TRUTHS)
    for name, sign in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}.items():
        _define(name, _comparison("fcmp_ordered", sign), _TRUTHS, _FLOATS, _FLOATS)
        _define(name, _comparison("icmp_signed", sign), _TRUTHS, _INTEGERS, _INTEGERS)


_define_operators()


def _call(builder: Any, name: str, result: Any, *values: Any, **options: Any) -> Any:
    """A call of an LLVM intrinsic."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, [value.type for value in values]), name
    )
    return builder.call(function, values, **options)


@intrinsic
def spread(typingctx: Any, number: Any) -> Any:
    """A number in all lanes, as floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _spread(builder, args[0])

    return _FLOATS(types.float32), codegen


@intrinsic
def select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Of each lane yes where the condition is true, no elsewhere; one of them may be a number."""
    kind = yes if isinstance(yes, Vector) else no

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(*args)

    return kind(_TRUTHS, kind, kind), codegen


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
        return _call(builder, f"llvm.sqrt.v{LANES}f32", args[0].type, args[0], fastmath=_FLAGS)

    return _FLOATS(_FLOATS), codegen


def _rounding(name: str) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _call(builder, f"llvm.{name}.v{LANES}f32", args[0].type, args[0])

    return _FLOATS(_FLOATS), codegen


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
        return builder.sitofp(args[0], _ir_type(_FLOATS))

    return _FLOATS(_INTEGERS), codegen


@intrinsic
def to_integers(typingctx: Any, x: Any) -> Any:
    """Floats towards zero; they must be within int32."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fptosi(args[0], _ir_type(_INTEGERS))

    return _INTEGERS(_FLOATS), codegen


@intrinsic
def any_of(typingctx: Any, x: Any) -> Any:
    """Whether a lane is true."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], bits), bits(0))

    return types.boolean(_TRUTHS), codegen


def _order(lanes: Iterable[int]) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), LANES), list(lanes))


def _pick(lanes: Iterable[int]) -> Any:
    """Code of a choice among the lanes of two vectors in a row."""
    order = _order(lanes)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.shuffle_vector(args[0], args[1], order)

    return codegen


@intrinsic
def evens(typingctx: Any, x: Any, y: Any) -> Any:
    """Lanes 0, 2, 4 ... of two vectors in a row."""
    return x(x, x), _pick(range(0, 2 * LANES, 2))


@intrinsic
def odds(typingctx: Any, x: Any, y: Any) -> Any:
    """Lanes 1, 3, 5 ... of two vectors in a row."""
    return x(x, x), _pick(range(1, 2 * LANES, 2))


@intrinsic
def zipped(typingctx: Any, x: Any, y: Any) -> Any:
    """The first eight lanes of two vectors in turn."""
    return x(x, x), _pick([lane // 2 + lane % 2 * LANES for lane in range(LANES)])


@intrinsic
def zipped_rest(typingctx: Any, x: Any, y: Any) -> Any:
    """The last eight lanes of two vectors in turn."""
    return x(x, x), _pick([(LANES + lane) // 2 + lane % 2 * LANES for lane in range(LANES)])


def _pointer(builder: Any, element: Any, address: Any, index: Any) -> Any:
    return builder.gep(builder.inttoptr(address, ir.PointerType()), [index], source_etype=element)


def _scalar_load(element: Any, result: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(builder, element, *args), typ=element)

    return result(types.int64, types.int64), codegen


@intrinsic
def load_float(typingctx: Any, address: Any, index: Any) -> Any:
    """The float32 at address + 4 * index."""
    return _scalar_load(ir.FloatType(), types.float32)


@intrinsic
def load_integer(typingctx: Any, address: Any, index: Any) -> Any:
    """The int64 at address + 8 * index."""
    return _scalar_load(ir.IntType(64), types.int64)


@intrinsic
def load(typingctx: Any, address: Any, index: Any) -> Any:
    """Sixteen float32 side by side from address + 4 * index."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(builder, ir.FloatType(), *args), typ=_ir_type(_FLOATS), align=4)

    return _FLOATS(types.int64, types.int64), codegen


@intrinsic
def store(typingctx: Any, address: Any, index: Any, values: Any) -> Any:
    """Write floats to sixteen float32 side by side from address + 4 * index."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(builder, ir.FloatType(), *args[:2]), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, _FLOATS), codegen


@intrinsic
def store_larger(typingctx: Any, address: Any, index: Any, x: Any, y: Any) -> Any:
    """As `store` of the larger of two in each lane, neither of them NaN.

    In one piece: a `select` before a `store` becomes a store where a mask is true, and a load of the same place soon
    after waits until that has reached the memory."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        larger = _call(builder, f"llvm.maxnum.v{LANES}f32", args[2].type, *args[2:], fastmath=("nnan", "nsz"))
        builder.store(larger, _pointer(builder, ir.FloatType(), *args[:2]), align=4)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, _FLOATS, _FLOATS), codegen


@intrinsic
def lane_numbers(typingctx: Any) -> Any:
    """0, 1, 2 ... 15 as floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(_ir_type(_FLOATS), [float(lane) for lane in range(LANES)])

    return _FLOATS(), codegen


@intrinsic
def load_where(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """As `load` where the mask is true, 0 elsewhere; what is masked out need not exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind, place = _ir_type(_FLOATS), _pointer(builder, ir.FloatType(), *args[:2])
        nothing, alignment = ir.Constant(kind, None), ir.IntType(32)(4)
        return _call(builder, f"llvm.masked.load.v{LANES}f32.p0", kind, place, alignment, args[2], nothing)

    return _FLOATS(types.int64, types.int64, _TRUTHS), codegen


def _masked_store(builder: Any, name: str, values: Any, place: Any, bytes_each: int, mask: Any) -> None:
    alignment = ir.IntType(32)(bytes_each)
    _call(builder, f"llvm.masked.store.v{LANES}{name}.p0", ir.VoidType(), values, place, alignment, mask)


@intrinsic
def store_where(typingctx: Any, address: Any, index: Any, values: Any, mask: Any) -> Any:
    """As `store` where the mask is true; elsewhere nothing is written."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _masked_store(builder, "f32", args[2], _pointer(builder, ir.FloatType(), *args[:2]), 4, args[3])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, _FLOATS, _TRUTHS), codegen


@intrinsic
def store_byte_where(typingctx: Any, address: Any, index: Any, number: Any, mask: Any) -> Any:
    """Write the low byte of a number to those of sixteen bytes from address + index where the mask is true."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte = ir.IntType(8)
        numbers = _spread(builder, builder.trunc(args[2], byte))
        _masked_store(builder, "i8", numbers, _pointer(builder, byte, *args[:2]), 1, args[3])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, _TRUTHS), codegen


@intrinsic
def store_packed(typingctx: Any, address: Any, values: Any, mask: Any) -> Any:
    """Write those integers where the mask is true side by side to int32 from address on; returns how many."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.inttoptr(args[0], ir.PointerType())
        _call(builder, f"llvm.masked.compressstore.v{LANES}i32", ir.VoidType(), args[1], place, args[2])
        bits = builder.bitcast(args[2], ir.IntType(LANES))
        return builder.zext(_call(builder, f"llvm.ctpop.i{LANES}", bits.type, bits), ir.IntType(64))

    return types.int64(types.int64, _INTEGERS, _TRUTHS), codegen


@intrinsic
def prefetch(typingctx: Any, address: Any, index: Any) -> Any:
    """Have what lies at address + 2 * the first lane of index ready soon; it need not exist."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        first = builder.extract_element(args[1], ir.IntType(32)(0))
        place = _pointer(builder, ir.IntType(16), args[0], first)
        read, near, data = ir.IntType(32)(0), ir.IntType(32)(3), ir.IntType(32)(1)
        _call(builder, "llvm.prefetch.p0", ir.VoidType(), place, read, near, data)
        return context.get_dummy_value()

    return types.void(types.int64, _INTEGERS), codegen


def _gather(element: int, bits: int) -> Any:
    """Signature and code of a gather of `bits` from (address, index in elements of so many bits, mask)."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address, index, mask = args
        loaded = ir.VectorType(ir.IntType(bits), LANES)
        places = _pointer(builder, ir.IntType(element), address, index)
        places.type = ir.VectorType(ir.PointerType(), LANES)  # llvmlite does not know vectors of indices
        nothing, alignment = ir.Constant(loaded, None), ir.IntType(32)(1)
        return _call(
            builder, f"llvm.masked.gather.v{LANES}i{bits}.v{LANES}p0", loaded, places, alignment, mask, nothing
        )

    return codegen


@intrinsic
def gather_halves(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 32 bits at address + 2 * index: two uint16 side by side, the first in the low half."""
    return _INTEGERS(types.int64, _INTEGERS, _TRUTHS), _gather(16, 32)


@intrinsic
def gather_bytes(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 32 bits at address + index: four uint8 side by side, the first lowest."""
    return _INTEGERS(types.int64, _INTEGERS, _TRUTHS), _gather(8, 32)


@intrinsic
def gather_integers(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the int32 at address + 4 * index."""
    return _INTEGERS(types.int64, _INTEGERS, _TRUTHS), _gather(32, 32)


@intrinsic
def gather_floats(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the float32 at address + 4 * index."""
    gather = _gather(32, 32)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(gather(context, builder, signature, args), _ir_type(_FLOATS))

    return _FLOATS(types.int64, _INTEGERS, _TRUTHS), codegen


@intrinsic
def gather_quads(typingctx: Any, address: Any, index: Any, mask: Any) -> Any:
    """Where the mask is true the 64 bits at address + 2 * index, four uint16 side by side: those of the first eight
    lanes in one result, of the others in the next, two pairs a lane."""
    gather = _gather(16, 64)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        quads = builder.bitcast(gather(context, builder, signature, args), ir.VectorType(ir.IntType(32), 2 * LANES))
        halves = [builder.shuffle_vector(quads, quads, _order(range(k, k + LANES))) for k in (0, LANES)]
        return context.make_tuple(builder, signature.return_type, halves)

    return types.containers.UniTuple(_INTEGERS, 2)(types.int64, _INTEGERS, _TRUTHS), codegen


@intrinsic
def sum_pairs(typingctx: Any, pairs: Any, shares: Any) -> Any:
    """Sums of two products each: of the int16 in the lower and in the upper half of integers."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        halves = ir.VectorType(ir.IntType(16), 2 * LANES)
        wide = ir.VectorType(ir.IntType(32), 2 * LANES)
        x, y = (builder.sext(builder.bitcast(value, halves), wide) for value in args)
        products = builder.mul(x, y)
        lower, upper = (builder.shuffle_vector(products, products, _order(range(k, 2 * LANES, 2))) for k in (0, 1))
        return builder.add(lower, upper)

    return _INTEGERS(_INTEGERS, _INTEGERS), codegen

"""Operations of `lanes` in compiled code (LLVM); nothing is checked."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from .memory_scalars_llvm import load_as, store_as

__all__ = [
    "LANES", "bits_of", "bytes_from", "codes_there", "cuts", "differ", "lowest", "mark", "move", "ones", "side_errors",
    "square_errors",
]  # fmt: skip

LANES = 64

_I32, _I64 = ir.IntType(32), ir.IntType(64)
_BYTES, _CODES, _MASK = (ir.VectorType(ir.IntType(bits), LANES) for bits in (8, 16, 1))
_int, _void = types.int64, types.void


def _load(builder: Any, address: Any, kind: Any = _CODES) -> Any:
    return load_as(builder, address, kind, kind.element.width // 8)


def _store(builder: Any, vector: Any, address: Any) -> None:
    store_as(builder, vector, address, vector.type.element.width // 8)


def _all(builder: Any, value: Any, kind: Any = _CODES) -> Any:
    """A vector with the low bits of a value in all lanes."""
    single = builder.insert_element(
        ir.Constant(kind, ir.Undefined), builder.trunc(value, kind.element), ir.Constant(_I32, 0)
    )
    order = ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
    return builder.shuffle_vector(single, ir.Constant(kind, ir.Undefined), order)


def _call(builder: Any, name: str, *vectors: Any) -> Any:
    """A call of an LLVM intrinsic, such as a saturating sum, on vectors of codes."""
    signature = ir.FunctionType(_CODES, [_CODES] * len(vectors))
    function = cgutils.get_or_insert_function(builder.module, signature, f"llvm.{name}.v{LANES}i16")
    return builder.call(function, vectors)


def _apart(builder: Any, a: Any, b: Any) -> Any:
    return builder.sub(_call(builder, "umax", a, b), _call(builder, "umin", a, b))


def _word(builder: Any, mask: Any) -> Any:
    return builder.bitcast(mask, _I64)


def _mask(builder: Any, word: Any) -> Any:
    return builder.bitcast(word, _MASK)


def _zero(kind: Any = _CODES) -> Any:
    return ir.Constant(kind, None)


@intrinsic
def ones(typingctx: Any, word: Any) -> Any:
    """The number of set bits of a word."""
    return _int(_int), lambda context, builder, signature, args: builder.ctpop(args[0])


@intrinsic
def lowest(typingctx: Any, word: Any) -> Any:
    """The number of the lowest set bit of a word that is not 0."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return _int(_int), generate


@intrinsic
def bits_of(typingctx: Any, address: Any, mask: Any) -> Any:
    """A word: which of 64 bytes have a bit of the mask."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        row = builder.and_(_load(builder, args[0], _BYTES), _all(builder, args[1], _BYTES))
        return _word(builder, builder.icmp_unsigned("!=", row, _zero(_BYTES)))

    return _int(_int, _int), generate


@intrinsic
def bytes_from(typingctx: Any, a: Any, b: Any, c: Any, d: Any, e: Any, target: Any) -> Any:
    """Write 64 bytes at `target`; their lowest five bits are those of five words."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        row = _zero(_BYTES)
        for k, word in enumerate(args[:5]):
            bit = ir.Constant(_BYTES, [1 << k] * LANES)
            row = builder.or_(row, builder.select(_mask(builder, word), bit, _zero(_BYTES)))
        _store(builder, row, args[5])
        return context.get_dummy_value()

    return _void(_int, _int, _int, _int, _int, _int), generate


@intrinsic
def codes_there(typingctx: Any, address: Any) -> Any:
    """A word: which of 64 codes are not 0."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _word(builder, builder.icmp_unsigned("!=", _load(builder, args[0]), _zero()))

    return _int(_int), generate


@intrinsic
def differ(typingctx: Any, a: Any, b: Any) -> Any:
    """A word: which of 64 pairs of codes differ."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b = (_load(builder, address) for address in args)
        return _word(builder, builder.icmp_unsigned("!=", a, b))

    return _int(_int, _int), generate


@intrinsic
def move(typingctx: Any, source: Any, target: Any) -> Any:
    """Copy 64 codes."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _store(builder, _load(builder, args[0]), args[1])
        return context.get_dummy_value()

    return _void(_int, _int), generate


@intrinsic
def mark(typingctx: Any, word: Any, target: Any) -> Any:
    """Write 64 codes at `target`: 65535 where a word's bit is set, else 0."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _store(builder, builder.sext(_mask(builder, args[0]), _CODES), args[1])
        return context.get_dummy_value()

    return _void(_int, _int), generate


@intrinsic
def cuts(
    typingctx: Any, before: Any, a: Any, b: Any, after: Any, edge: Any, odd: Any, has_invalid: Any
) -> Any:  # fmt: skip
    """A word: where no surface joins pixels a and b, the middle two of four in line (addresses of 64 codes each).

    That is where one is invalid, or where their step is more than `edge` plus one and a half times the smaller of the
    slopes on both sides: in whole codes, with `odd` (0 or 1) added where that slope is odd.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        before, a, b, after = (_load(builder, address) for address in args[:4])
        edge, odd = _all(builder, args[4]), _all(builder, args[5])
        checks = builder.icmp_unsigned("!=", _all(builder, args[6]), _zero())

        def is_invalid(codes: Any) -> Any:
            return builder.and_(checks, builder.icmp_unsigned("==", codes, _zero()))

        slopes = (
            builder.select(is_invalid(before), _zero(), _apart(builder, a, before)),
            builder.select(is_invalid(after), _zero(), _apart(builder, after, b)),
        )
        slope = _call(builder, "umin", *slopes)
        one = ir.Constant(_CODES, [1] * LANES)
        half = builder.add(builder.lshr(slope, one), builder.and_(slope, odd))
        step = _call(builder, "usub.sat", _apart(builder, b, a), slope)
        cut = builder.icmp_unsigned(">", _call(builder, "usub.sat", step, edge), half)
        return _word(builder, builder.or_(cut, builder.or_(is_invalid(a), is_invalid(b))))

    return _int(_int, _int, _int, _int, _int, _int, _int), generate


def _deviation(builder: Any, code: Any, a: Any, b: Any) -> Any:
    """Twice the distance of codes from the means of two others."""
    sides = []
    for names in (((code, a), (code, b)), ((a, code), (b, code))):
        sides.append(_call(builder, "uadd.sat", *(_call(builder, "usub.sat", *pair) for pair in names)))
    return _apart(builder, *sides)


def _largest(builder: Any, *vectors: Any) -> Any:
    largest = vectors[0]
    for vector in vectors[1:]:
        largest = _call(builder, "umax", largest, vector)
    return largest


@intrinsic
def side_errors(
    typingctx: Any, code: Any, a: Any, b: Any, least: Any, above: Any, below: Any, reach: Any, limit: Any, out: Any
) -> Any:
    """Write the errors of the middles of sides between a and b to `out`; returns a word: which of them exceed `limit`
    (see `kernels.geometry.splits`).

    The errors of their children are `reach` bytes before and behind the addresses `above` and `below`.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        code, a, b, least = (_load(builder, address) for address in args[:4])
        above, below, reach, limit, out = args[4:]
        places = (beside(row, reach) for row in (above, below) for beside in (builder.sub, builder.add))
        children = _largest(builder, *(_load(builder, place) for place in places))
        error = _call(builder, "uadd.sat", _deviation(builder, code, a, b), children)
        error = builder.or_(error, least)
        _store(builder, error, out)
        return _word(builder, builder.icmp_unsigned(">", error, _all(builder, limit)))

    return _int(_int, _int, _int, _int, _int, _int, _int, _int, _int), generate


@intrinsic
def square_errors(
    typingctx: Any, code: Any, reach_down: Any, reach: Any, falling: Any, least: Any, side: Any, lanes: Any,
    limit: Any, out: Any,
) -> Any:  # fmt: skip
    """Write the errors of the middles of squares to `out`, 0 outside `lanes`; returns a word: which exceed `limit`.

    Corners are `reach` bytes to either side of `code`, and `reach_down` bytes above and below; so are the errors of the
    sides' middles round `side`. The diagonal goes down-right where `falling` is set.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        code_at, down, reach, falling, least_errors, side, lanes, limit, out = args

        def around(place: Any, down_by: Any, right_by: Any) -> Any:
            for offset, steps in ((down, down_by), (reach, right_by)):
                place = (place, builder.add(place, offset), builder.sub(place, offset))[steps]
            return _load(builder, place)

        falls, inside = _mask(builder, falling), _mask(builder, lanes)
        left = builder.select(falls, around(code_at, -1, -1), around(code_at, 1, -1))
        right = builder.select(falls, around(code_at, 1, 1), around(code_at, -1, 1))
        children = _largest(
            builder, around(side, -1, 0), around(side, 1, 0), around(side, 0, -1), around(side, 0, 1)
        )
        deviation = _deviation(builder, _load(builder, code_at), left, right)
        error = builder.or_(_call(builder, "uadd.sat", deviation, children), _load(builder, least_errors))
        error = builder.select(inside, error, _zero())
        _store(builder, error, out)
        return _word(builder, builder.icmp_unsigned(">", error, _all(builder, limit)))

    return _int(_int, _int, _int, _int, _int, _int, _int, _int, _int), generate

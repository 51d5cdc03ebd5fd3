"""Runs a loop on the threads of Numba's pool: equal parts of its indices, one for each thread."""

from __future__ import annotations

from typing import Any

import numba.core.types as _types
from llvmlite import ir
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.ufunc import parallel as pool

__all__ = ["share"]

types: Any = _types  # its stubs know only a part of it

pool._launch_threads()  # from now on kernels find the pool's functions by name; the package has chosen the pool


@intrinsic
def share(typing: Any, loop: Any, first: Any, end: Any, values: Any) -> Any:
    """Calls loop(first, end, *values) for parts of the indices first to end - 1, at the same time.

    loop: a kernel that returns nothing, or a whole number: then the sum of these is returned. Raises RuntimeError if it
    has raised an exception in any part.
    """
    if not isinstance(loop, types.Dispatcher):
        raise TypingError("loop: expected a kernel")
    asked = (types.int64, types.int64, *values.types)
    resolved = typing.resolve_function_type(loop, asked, {})
    if resolved is None or resolved.return_type not in (types.none, types.int64):
        raise TypingError(f"{loop}: expected a loop that returns nothing, or a whole number")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        _, low, high, packed = arguments
        data_type = ir.LiteralStructType([_I64, _I64, packed.type])
        data = cgutils.alloca_once(builder, data_type)
        builder.store(data_type([_I64(0), _I64(0), ir.Undefined]), data)
        builder.store(_lent(context, builder, values, packed), _field(builder, data, _VALUES))
        low = context.cast(builder, low, signature.args[1], types.int64)
        high = context.cast(builder, high, signature.args[2], types.int64)
        part = _part_function(context, builder.module, loop, resolved, values, data_type)
        _run(builder, part, data, low, high)
        failed = builder.icmp_signed("!=", builder.load(_field(builder, data, _FAILED)), _I64(0))
        with cgutils.if_unlikely(builder, failed):
            context.call_conv.return_user_exc(builder, RuntimeError, ("a part of a parallel loop failed",))
        counts = resolved.return_type == types.int64
        return builder.load(_field(builder, data, _SUM)) if counts else context.get_dummy_value()

    return resolved.return_type(loop, first, end, values), generate


_FAILED, _SUM, _VALUES = range(3)  # what the parts of a loop share
_I64, _BYTES = ir.IntType(64), ir.IntType(8).as_pointer()


def _field(builder: Any, pointer: Any, index: int) -> Any:
    return builder.gep(pointer, [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), index)], inbounds=True)


def _lent(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value whose arrays, also those in tuples, have no owner: the caller holds them as long as the loop runs.

    Otherwise threads would contend for the counts of the arrays' references, which each call and each record changes.
    """
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = array.parent = ir.Constant(array.meminfo.type, None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for place, inner in enumerate(kind.types):
            lent = _lent(context, builder, inner, builder.extract_value(value, place))
            value = builder.insert_value(value, lent, place)
    return value


def _part_function(
    context: Any, module: Any, loop: Any, resolved: Any, values: Any, data_type: Any
) -> Any:
    """void part(char **parts, int64 *count, int64 *steps, void *data): the pool's form of a function.

    parts[0] points to `count` pairs of indices: the loop is run for each.
    """
    kind = ir.FunctionType(ir.VoidType(), [_BYTES.as_pointer(), _I64.as_pointer(), _I64.as_pointer(), _BYTES])
    name = module.get_unique_name(f"part_of_{loop.dispatcher.py_func.__name__}")
    function = ir.Function(module, kind, name)
    function.linkage = "internal"
    builder = ir.IRBuilder(function.append_basic_block())
    pairs = builder.bitcast(builder.load(function.args[0]), _I64.as_pointer())
    data = builder.bitcast(function.args[3], data_type.as_pointer())
    unpacked = cgutils.unpack_tuple(builder, builder.load(_field(builder, data, _VALUES)))
    compiled = loop.dispatcher.get_compile_result(resolved)
    context.active_code_library.add_linking_library(compiled.library)
    with cgutils.for_range(builder, builder.load(function.args[1])) as turn:
        place = builder.gep(pairs, [builder.mul(turn.index, _I64(2))])
        bounds = [builder.load(place), builder.load(builder.gep(place, [_I64(1)]))]
        status, number = context.call_internal_no_propagate(builder, compiled.fndesc, resolved, [*bounds, *unpacked])
        with cgutils.if_unlikely(builder, status.is_error):
            builder.store(_I64(1), _field(builder, data, _FAILED))
        if resolved.return_type == types.int64:
            builder.atomic_rmw("add", _field(builder, data, _SUM), number, "monotonic")
    builder.ret_void()
    return function


def _run(builder: Any, part: Any, data: Any, low: Any, high: Any) -> None:
    """Divides the indices among the threads that the calling thread may use, and waits for them."""
    module = builder.module
    count_of = cgutils.get_or_insert_function(module, ir.FunctionType(_I64, []), "get_num_threads")
    wanted, length = builder.call(count_of, []), builder.sub(high, low)
    threads = builder.select(builder.icmp_signed("<", length, wanted), length, wanted)
    with builder.if_then(builder.icmp_signed(">", length, _I64(0))):
        pairs = _divided(builder, low, length, threads)
        parts, steps, count = (cgutils.alloca_once(builder, kind) for kind in (_BYTES, _I64, _I64))
        builder.store(builder.bitcast(pairs, _BYTES), parts)
        builder.store(_I64(16), steps)
        builder.store(threads, count)
        with builder.if_else(builder.icmp_signed("==", threads, _I64(1))) as (alone, together):
            with alone:
                builder.call(part, [parts, count, steps, builder.bitcast(data, _BYTES)])
            with together:
                kind = ir.FunctionType(ir.VoidType(), [_BYTES] * 5 + [_I64] * 3)
                run = cgutils.get_or_insert_function(module, kind, "numba_parallel_for")
                given = [builder.bitcast(each, _BYTES) for each in (part, parts, count, steps, data)]
                builder.call(run, [*given, _I64(0), _I64(1), threads])


def _divided(builder: Any, low: Any, length: Any, threads: Any) -> Any:
    """A pointer to the first and the last index, plus 1, of each thread's part."""
    pairs = builder.alloca(_I64, builder.mul(threads, _I64(2)))
    with cgutils.for_range(builder, threads) as turn:
        for side in (0, 1):
            number = builder.add(turn.index, _I64(side))
            bound = builder.add(low, builder.sdiv(builder.mul(length, number), threads))
            builder.store(bound, builder.gep(pairs, [builder.add(builder.mul(turn.index, _I64(2)), _I64(side))]))
    return pairs

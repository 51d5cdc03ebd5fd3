"""Types of kernels' arguments as text, and back: `needed.json` lists with which types each kernel is compiled.

    int64, float32, bool    numbers
    float64[2C]             an array: type of its elements, dimensions, layout (C, F, or A for any)
    int64=0, bool=False     a constant that Numba has compiled in
    floats x 16             a vector (`kernels.base.vectors_llvm`)
    (int64, float32)        a tuple
    module:Name(int64, ...) a named tuple
    default=4               an argument that is left out
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numba.core.types as _types

from ..kernels.base import vectors_llvm as vectors

__all__ = ["from_text", "to_text"]

types: Any = _types  # its stubs know only a part of it
_ARRAY = re.compile(r"(\w+)\[(\d)([CFA])\]")
_NAMED = re.compile(r"([\w.]+):(\w+)")
_VECTORS = {str(kind): kind for kind in (vectors.FLOATS, vectors.INTEGERS, vectors.MASK)}


def to_text(arguments: Sequence[Any]) -> str:
    """The types of arguments, separated by commas; raises ValueError for a type that has no form here."""
    return ", ".join(map(_one_to_text, arguments))


def _one_to_text(kind: Any) -> str:
    if isinstance(kind, types.Array) and kind.mutable and kind.aligned:
        return f"{kind.dtype}[{kind.ndim}{kind.layout}]"
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        record = kind.instance_class
        return f"{record.__module__}:{record.__name__}({to_text(kind.types)})"
    if isinstance(kind, types.BaseTuple):
        return f"({to_text(kind.types)})"
    if isinstance(kind, types.IntegerLiteral | types.BooleanLiteral):
        return f"{'bool' if isinstance(kind, types.BooleanLiteral) else kind.literal_type}={kind.literal_value!r}"
    if isinstance(kind, types.Omitted):
        return f"default={kind.value!r}"
    if isinstance(kind, types.Number | types.Boolean) or str(kind) in _VECTORS:
        return str(kind)
    raise ValueError(f"type: {kind}: expected numbers, arrays, tuples or vectors")


def from_text(text: str) -> tuple[Any, ...]:
    """The types that `to_text` has written; raises ValueError for other text."""
    return tuple(map(_one_from_text, _parts(text)))


def _parts(text: str) -> Iterator[str]:
    """The text between the commas that are outside parentheses."""
    depth, start = 0, 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            yield text[start:place].strip()
            start = place + 1
    if text[start:].strip():
        yield text[start:].strip()


def _one_from_text(text: str) -> Any:
    head, bracket, rest = text.partition("(")
    if bracket:
        inner = from_text(rest.removesuffix(")"))
        named = _NAMED.fullmatch(head)
        if not named:
            return types.Tuple(inner)
        record = getattr(importlib.import_module(named[1]), named[2])
        same = len(set(inner)) == 1
        return types.NamedUniTuple(inner[0], len(inner), record) if same else types.NamedTuple(inner, record)
    if array := _ARRAY.fullmatch(text):
        return types.Array(_number(array[1]), int(array[2]), array[3])
    kind, equals, value = text.partition("=")
    if equals:
        constant = ast.literal_eval(value)
        return types.Omitted(constant) if kind == "default" else types.literal(constant)
    return _VECTORS.get(text) or _number(text)


def _number(name: str) -> Any:
    kind = getattr(types, {"bool": "boolean"}.get(name, name), None)
    if not isinstance(kind, types.Number | types.Boolean):
        raise ValueError(f"type: {name!r}: expected a number's type")
    return kind

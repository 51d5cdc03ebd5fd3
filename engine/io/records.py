"""Frozen dataclasses of arrays, numbers and text as what JSON can hold and a list of arrays, and back.

A record becomes an object of its fields, a tuple a list, and an array `{"array": k}`, its number in the list. What is
read back must have the fields and the types that the dataclass declares: nothing else is ever made of it.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["from_plain", "to_plain"]

Record = TypeVar("Record")
_SHOWN = 80  # characters of a value in a message


def to_plain(record: Any, arrays: list[tuple[str, npt.NDArray[Any]]], name: str) -> Any:
    """A record, tuple, array or scalar for JSON; `arrays` gets its arrays, with their names: `name` and the path."""
    if dataclasses.is_dataclass(record):
        fields = [field.name for field in dataclasses.fields(record)]
        return {field: to_plain(getattr(record, field), arrays, f"{name}.{field}") for field in fields}
    if isinstance(record, tuple):
        return [to_plain(item, arrays, f"{name}[{number}]") for number, item in enumerate(record)]
    if isinstance(record, np.ndarray):
        arrays.append((name, record))
        return {"array": len(arrays) - 1}
    if record is None or isinstance(record, bool | int | float | str):
        return record
    raise TypeError(f"{name}: {type(record).__name__}: expected an array, a number, text, None, a tuple or a record")


def from_plain(kind: type[Record], plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> Record:
    """The record of class `kind` that `to_plain` has made plain; raises ValueError, which names the field, the value
    and what was expected, for anything else."""
    record: Record = _read(kind, plain, arrays, name)
    return record


def _read(kind: Any, plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> Any:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _read_one_of(inner, plain, arrays, name)
    if dataclasses.is_dataclass(kind):
        return _read_record(kind, plain, arrays, name)
    if origin is tuple:
        return _read_tuple(inner, plain, arrays, name)
    if origin is np.ndarray:
        return _read_array(np.dtype(typing.get_args(inner[1])[0]), plain, arrays, name)
    if origin is npt.NDArray:  # in newer releases of NumPy it is an alias with an origin of its own
        return _read_array(np.dtype(inner[0]), plain, arrays, name)
    if kind is float and type(plain) is int:
        return plain
    if type(plain) is not kind and not (plain is None and kind is type(None)):
        raise _wrong(name, plain, kind.__name__)
    return plain


def _read_one_of(kinds: Sequence[Any], plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> Any:
    """The value as the first of the kinds that it fits; the error is that of the last one."""
    for kind in kinds[:-1]:
        try:
            return _read(kind, plain, arrays, name)
        except ValueError:
            pass
    return _read(kinds[-1], plain, arrays, name)


def _read_record(kind: Any, plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> Any:
    hints = typing.get_type_hints(kind)
    fields = [field.name for field in dataclasses.fields(kind)]
    if not isinstance(plain, Mapping) or set(plain) != set(fields):
        found = sorted(plain) if isinstance(plain, Mapping) else plain
        raise _wrong(name, found, f"the fields {', '.join(fields)}")
    return kind(**{field: _read(hints[field], plain[field], arrays, f"{name}.{field}") for field in fields})


def _read_tuple(kinds: Sequence[Any], plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> tuple[Any, ...]:
    if not isinstance(plain, list):
        raise _wrong(name, plain, "a list")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = [kinds[0]] * len(plain)
    if len(kinds) != len(plain):
        raise _wrong(name, plain, f"a list of {len(kinds)}")
    pairs = enumerate(zip(kinds, plain, strict=True))
    return tuple(_read(kind, item, arrays, f"{name}[{number}]") for number, (kind, item) in pairs)


def _read_array(dtype: np.dtype[Any], plain: Any, arrays: Sequence[npt.NDArray[Any]], name: str) -> Any:
    number = plain.get("array") if isinstance(plain, Mapping) else None
    if type(number) is not int or not 0 <= number < len(arrays):
        raise _wrong(name, plain, f"an array's number below {len(arrays)}")
    if arrays[number].dtype != dtype:
        raise _wrong(name, arrays[number].dtype, str(dtype))
    return arrays[number]


def _wrong(name: str, found: Any, expected: str) -> ValueError:
    return ValueError(f"{name}: {str(found)[:_SHOWN]}: expected {expected}")

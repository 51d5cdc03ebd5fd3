"""Fields of a TMIV JSON, fetched with checks, and the kinds of values that they may have."""

from __future__ import annotations

import json
import math
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

__all__ = [
    "BITS",
    "BOOL",
    "COUNT",
    "DEPTH_RANGE",
    "FILE",
    "FRAME_RANGES",
    "NAMES",
    "OBJECTS",
    "PAIR",
    "POSITIVE",
    "PROJECTION",
    "RADIANS",
    "SIZE",
    "TEXT",
    "VECTOR",
    "Fields",
    "Kind",
]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Kind(Generic[T]):
    """A kind of value: `convert` raises TypeError or ValueError for any other; `expected` names it in messages."""

    expected: str
    convert: Callable[[Any], T]


class Fields:
    """Fetches the fields of a JSON object with checks; problems are added to `problems`, each starting with `where`."""

    def __init__(self, fields: dict[str, Any], where: str, problems: list[str]) -> None:
        self.fields, self.where, self.problems = fields, where, problems

    def get(self, key: str, kind: Kind[T], *default: T | None) -> T | None:
        """The field's value, or the default if it is absent; None, and a problem, if it is wrong or lacks a default."""
        if key not in self.fields:
            if not default:
                self.problems.append(f"{self.where}{key}: missing: expected {kind.expected}")
            return default[0] if default else None
        try:
            return kind.convert(self.fields[key])
        except (TypeError, ValueError, KeyError, OverflowError, AttributeError, IndexError):
            shown = json.dumps(self.fields[key])
            shown = shown if len(shown) < 80 else shown[:77] + "..."
            self.problems.append(f"{self.where}{key}: {shown}: expected {kind.expected}")
        return None


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError
    return float(value)


def _positive(value: Any) -> float:
    if _number(value) <= 0:
        raise ValueError
    return float(value)


def _integer(value: Any, low: int, high: int) -> int:
    if _number(value) != int(value) or not low <= value <= high:
        raise ValueError
    return int(value)


def _text(value: Any) -> str:
    # Names become parts of file names.
    if not isinstance(value, str) or not value or "/" in value or "\\" in value or "\0" in value:
        raise TypeError
    return unicodedata.normalize("NFC", value)  # macOS composes names in another way


def _file(value: Any) -> str:
    parts = [part for part in value.replace("\\", "/").split("/") if part != "."]
    if ":" in parts[0] or ".." in parts or not all(parts):
        raise ValueError
    return "/".join(map(_text, parts))


def _list(value: Any, count: int | None = None) -> list[Any]:
    if not isinstance(value, list) or (count is not None and len(value) != count):
        raise TypeError
    return value


def _bool(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _pair(value: Any) -> tuple[float, float]:
    first, second = map(_number, _list(value, 2))
    return first, second


def _vector(value: Any) -> tuple[float, float, float]:
    x, y, z = map(_number, _list(value, 3))
    return x, y, z


def _size(value: Any) -> tuple[int, int]:
    width, height = (_integer(item, 1, 1 << 16) for item in _list(value, 2))
    return width, height


def _radians(value: Any) -> tuple[float, float]:
    low, high = _pair(value)
    return math.radians(low), math.radians(high)


def _depth_range(value: Any) -> tuple[float, float]:
    near, far = _list(value, 2)
    return _number(near), math.inf if far == "inf" else _number(far)


def _objects(value: Any) -> list[dict[str, Any]]:
    if not value or not all(isinstance(item, dict) for item in _list(value)):
        raise TypeError
    return list(value)


def _projection(value: Any) -> str:
    if value not in ("Perspective", "Equirectangular"):
        raise ValueError
    return str(value)


def _frame_ranges(value: Any) -> tuple[tuple[int, int], ...]:
    return tuple(
        (_integer(item["maxNumberOfFrames"], 0, 1 << 31), _integer(item["startFrame"], 0, 1 << 31))
        for item in _list(value)
    )


TEXT = Kind("a name without slashes", _text)
FILE = Kind("a path to a file below the JSON's folder", _file)
POSITIVE = Kind("a positive number", _positive)
COUNT = Kind("a whole number, 0 or more", lambda value: _integer(value, 0, 1 << 31))
BITS = Kind("a whole number from 8 to 16", lambda value: _integer(value, 8, 16))
BOOL = Kind("true or false", _bool)
VECTOR = Kind("three numbers", _vector)
PAIR = Kind("two numbers", _pair)
SIZE = Kind("two positive whole numbers", _size)
RADIANS = Kind("two numbers, degrees", _radians)
DEPTH_RANGE = Kind('two numbers (the second may be "inf")', _depth_range)
PROJECTION = Kind("Perspective or Equirectangular", _projection)
NAMES = Kind("a list of names", lambda value: tuple(map(_text, _list(value))))
OBJECTS = Kind("a list of at least one camera", _objects)
FRAME_RANGES = Kind("a list of {maxNumberOfFrames, startFrame}", _frame_ranges)

"""Checked access to the fields of a decoded message, and the error that names what is wrong."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable
from enum import IntEnum
from typing import Any

__all__ = ["CloseCode", "ProtocolError", "Quaternion", "Reader", "Vector"]

MAX_NUMBER = 1e12

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
# Of a value within values it shows the outer ones only: whatever was sent, it ends.
_REPR = reprlib.Repr()
_REPR.maxlist = _REPR.maxtuple = _REPR.maxdict = 20
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 100


class CloseCode(IntEnum):
    """The reason why a connection was closed, in WebSocket's private range."""

    MALFORMED = 4400  # not a msgpack map, or a field is missing or has the wrong type
    TOKEN = 4401
    VERSION = 4402
    VALUE = 4403  # a field has the right type and a wrong value
    CAMERA = 4404  # unknown camera
    TYPE = 4405  # a message type that is not expected here
    ORDER = 4406
    SIZE = 4407  # a resolution or length that differs from the announced one
    TIMEOUT = 4408
    BUSY = 4409  # another source is there, or there are too many viewers
    FEATURE = 4410  # a required feature that the server does not have
    TOO_BIG = 4413
    INTERNAL = 4500


class ProtocolError(ValueError):
    """A peer sent something wrong: close code, field, value and expectation."""

    def __init__(self, code: CloseCode, field: str, value: object, expected: str) -> None:
        self.code, self.field, self.expected = code, field, expected
        self.value = _printable(value if isinstance(value, str) else _REPR.repr(value))
        if len(self.value) > 80:
            self.value = self.value[:77] + "..."
        super().__init__(f"{field}: {self.value}: expected {expected}")


def _printable(text: str) -> str:
    """A text in which what could control a terminal or begin a line of a log is escaped."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


class Reader:
    """Checked access to a decoded map; `path` names the map in errors.

    Every method raises ProtocolError if the field `name` is missing, has the wrong type or a value out of bounds.
    """

    def __init__(self, fields: object, path: str = "") -> None:
        if not isinstance(fields, dict):
            raise ProtocolError(CloseCode.MALFORMED, path or "message", type(fields).__name__, "a map")
        self._fields, self._path = fields, path

    def fail(
        self, name: str, value: object, expected: str, code: CloseCode = CloseCode.VALUE
    ) -> ProtocolError:
        """The error for the field `name` with `value` instead of what was `expected`."""
        return ProtocolError(code, f"{self._path}.{name}" if self._path else name, value, expected)

    def has(self, name: str) -> bool:
        """Whether an optional field is present and not nil."""
        return self._fields.get(name) is not None

    def _get(self, name: str, kinds: tuple[type, ...], expected: str) -> Any:
        if name not in self._fields:
            raise self.fail(name, "missing", expected, CloseCode.MALFORMED)
        value = self._fields[name]
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise self.fail(name, value, expected, CloseCode.MALFORMED)
        return value

    def integer(self, name: str, low: int, high: int) -> int:
        """An integer from `low` to `high`; true and false do not count as integers."""
        expected = f"an integer from {low} to {high}"
        value: int = self._get(name, (int,), expected)
        if not low <= value <= high:
            raise self.fail(name, value, expected)
        return value

    def number(self, name: str, low: float = -MAX_NUMBER, high: float = MAX_NUMBER) -> float:
        """A finite number from `low` to `high`."""
        expected = f"a number from {low:g} to {high:g}"
        value = self._get(name, (int, float), expected)
        if not low <= value <= high:
            raise self.fail(name, value, expected)
        return float(value)

    def flag(self, name: str) -> bool:
        """True or false."""
        return bool(self._get(name, (bool,), "true or false"))

    def text(self, name: str, longest: int = 200) -> str:
        """A string of at most `longest` characters."""
        expected = f"a string of at most {longest} characters"
        value: str = self._get(name, (str,), expected)
        if len(value) > longest:
            raise self.fail(name, value, expected)
        return value

    def label(self, name: str, longest: int = 200) -> str:
        """A name of at most `longest` printable characters: it is shown to people and written into logs."""
        value = self.text(name, longest)
        if not value.isprintable():
            raise self.fail(name, value, "printable characters")
        return value

    def choice(self, name: str, options: Iterable[str]) -> str:
        """A string that is one of `options`."""
        expected = "one of " + ", ".join(options)
        value: str = self._get(name, (str,), expected)
        if value not in options:
            raise self.fail(name, value, expected)
        return value

    def data(self, name: str) -> bytes | memoryview:
        """Binary data."""
        value: bytes | memoryview = self._get(name, (bytes, memoryview), "binary data")
        return value

    def items(self, name: str, low: int, high: int) -> list[Any]:
        """An array of `low` to `high` items."""
        expected = f"an array of {low} to {high} items" if low < high else f"an array of {low} items"
        value: list[Any] = self._get(name, (list,), expected)
        if not low <= len(value) <= high:
            raise self.fail(name, f"{len(value)} items", expected)
        return value

    def texts(self, name: str, most: int, longest: int = 100) -> tuple[str, ...]:
        """An array of at most `most` strings of at most `longest` characters."""
        values = self.items(name, 0, most)
        expected = f"strings of at most {longest} characters"
        for value in values:
            if not isinstance(value, str):
                raise self.fail(name, value, expected, CloseCode.MALFORMED)
            if len(value) > longest:
                raise self.fail(name, value, expected)
        return tuple(values)

    def numbers(self, name: str, count: int) -> tuple[float, ...]:
        """An array of `count` finite numbers."""
        values = self.items(name, count, count)
        for value in values:
            if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
                raise self.fail(name, values, f"{count} finite numbers")
        return tuple(map(float, values))

    def vector(self, name: str) -> Vector:
        """Three finite numbers."""
        x, y, z = self.numbers(name, 3)
        return x, y, z

    def quaternion(self, name: str) -> Quaternion:
        """A unit quaternion, in the order in which it was sent."""
        a, b, c, d = self.numbers(name, 4)
        # A little less than `Pose` takes, which adds the squares in another order.
        if not abs(math.sqrt(a * a + b * b + c * c + d * d) - 1.0) < 1e-3 - 1e-9:
            raise self.fail(name, [a, b, c, d], "a unit quaternion")
        return a, b, c, d

    def child(self, name: str) -> Reader:
        """A nested map."""
        return Reader(self._get(name, (dict,), "a map"), f"{self._path}.{name}" if self._path else name)

    def children(self, name: str, low: int, high: int) -> list[Reader]:
        """An array of `low` to `high` maps."""
        path = f"{self._path}.{name}" if self._path else name
        return [Reader(item, f"{path}[{i}]") for i, item in enumerate(self.items(name, low, high))]

    def scalars(self, name: str, most: int = 64) -> dict[str, Any]:
        """A map of strings to scalars, with at most `most` items."""
        fields: dict[str, Any] = self._get(name, (dict,), "a map")
        for key, value in fields.items():
            if not isinstance(key, str) or not isinstance(value, str | int | float | bool | None):
                raise self.fail(name, {key: value}, "a map of strings to scalars", CloseCode.MALFORMED)
        if len(fields) > most:
            raise self.fail(name, f"{len(fields)} items", f"at most {most}")
        return fields

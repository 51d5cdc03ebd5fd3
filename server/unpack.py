"""msgpack without copies, for messages of many megabytes: the msgpack package copies these while it holds the GIL."""

from __future__ import annotations

import struct
from typing import Any

__all__ = ["unpack"]

_DEEPEST = 32  # maps and arrays within one another; the protocol needs five
_MOST = 10_000  # values in a message; a view has about thirty
# First byte -> how a number is stored.
_NUMBERS = {
    0xCA: ">f", 0xCB: ">d", 0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q", 0xD0: ">b", 0xD1: ">h", 0xD2: ">i",
    0xD3: ">q",
}  # fmt: skip
# First byte -> the kind of value that follows, and how its length is stored.
_SIZED = {
    0xC4: ("bin", ">B"), 0xC5: ("bin", ">H"), 0xC6: ("bin", ">I"),
    0xD9: ("str", ">B"), 0xDA: ("str", ">H"), 0xDB: ("str", ">I"),
    0xDC: ("array", ">H"), 0xDD: ("array", ">I"), 0xDE: ("map", ">H"), 0xDF: ("map", ">I"),
}  # fmt: skip
_CONSTANTS = {0xC0: None, 0xC2: False, 0xC3: True}


def unpack(data: bytes) -> Any:
    """The same value as msgpack.unpackb returns, but with binary data as memoryviews of `data`.

    Raises ValueError for malformed data, keys that are not strings, extension types, too many values or too deep maps.
    """
    reader = _Reader(data)
    value = reader.value(0)
    if reader.at != len(data):
        raise ValueError(f"{len(data) - reader.at} bytes more than the message")
    return value


class _Reader:
    def __init__(self, data: bytes) -> None:
        self._data, self.at, self._values = memoryview(data), 0, 0

    def value(self, depth: int) -> Any:
        first = self._number(">B")
        self._values += 1
        if self._values > _MOST:
            raise ValueError(f"byte {self.at}: expected at most {_MOST} values in a message of this size")
        if first < 0x80:
            return first
        if first >= 0xE0:
            return first - 0x100
        if first < 0xC0:
            kind = "map" if first < 0x90 else "array" if first < 0xA0 else "str"
            return self._sized(kind, first & (0x1F if kind == "str" else 0x0F), depth)
        if first in _NUMBERS:
            return self._number(_NUMBERS[first])
        if first in _SIZED:
            kind, stored = _SIZED[first]
            return self._sized(kind, self._number(stored), depth)
        if first in _CONSTANTS:
            return _CONSTANTS[first]
        raise ValueError(f"byte {self.at - 1}: {first:#x}: expected the beginning of a value")

    def _sized(self, kind: str, length: int, depth: int) -> Any:
        if kind == "bin":
            return self._bytes(length)
        if kind == "str":
            return str(self._bytes(length), "utf-8")
        if depth == _DEEPEST:
            raise ValueError(f"byte {self.at}: expected at most {_DEEPEST} maps and arrays within one another")
        if kind == "array":
            return [self.value(depth + 1) for _ in range(length)]
        return {self._key(): self.value(depth + 1) for _ in range(length)}

    def _key(self) -> str:
        key = self.value(_DEEPEST)
        if not isinstance(key, str):
            raise ValueError(f"byte {self.at}: {type(key).__name__} as a key: expected a string")
        return key

    def _number(self, stored: str) -> Any:
        return struct.unpack(stored, self._bytes(struct.calcsize(stored)))[0]

    def _bytes(self, length: int) -> memoryview:
        found = self._data[self.at : self.at + length]
        if len(found) < length:
            raise ValueError(f"{length} bytes from byte {self.at}: only {len(found)} are there")
        self.at += length
        return found

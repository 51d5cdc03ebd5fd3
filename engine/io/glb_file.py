"""Reading of GLB files: the container, its buffer and its arrays (Khronos, glTF 2.0 specification, sections 3.6 and 4).

All functions raise ValueError, which names the field, its value and what was expected. Nothing is allocated that is
larger than the file says and has room for.
"""

from __future__ import annotations

import io
import json
import math
import os
import struct
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["GlbFile"]

T = TypeVar("T")
_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_MOST_TEXT = 1 << 28  # bytes of the description
_SHOWN = 60  # characters of a value in a message
# Extensions that a file may require: those whose meaning is known here, and materials, of which only the base colour
# counts.
_KNOWN = ("KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp")


class GlbFile:
    """A GLB file in memory, read from a path or given as bytes: `whole` is its description, checked field by field as
    it is read."""

    def __init__(self, given: Path | bytes) -> None:
        with io.BytesIO(given) if isinstance(given, bytes) else given.open("rb") as file:
            size = len(given) if isinstance(given, bytes) else os.fstat(file.fileno()).st_size
            start = file.read(_HEADER.size)
            if start[:4] != b"glTF":
                raise ValueError(f"first bytes: {start[:4]!r}: expected {b'glTF'!r}, a GLB file, or a saved model")
            if len(start) < _HEADER.size:
                raise ValueError(f"size: {size} bytes: expected at least {_HEADER.size}; it is cut short")
            _, version, length = _HEADER.unpack(start)
            if version != 2:
                raise ValueError(f"version: {version}: expected 2")
            if length > size:
                raise ValueError(f"length: {length} bytes: expected at most {size}, the file's size; it is cut short")
            self._data = start + file.read(length - len(start))
        end, text = self._chunk(_HEADER.size, b"JSON")
        if len(text) > _MOST_TEXT:
            raise ValueError(f"JSON chunk: {len(text)} bytes: expected at most {_MOST_TEXT}")
        try:
            self.whole: Any = json.loads(bytes(text))
        except (RecursionError, ValueError) as error:
            raise ValueError(f"JSON chunk: {error}: expected the description of a scene") from error
        if not isinstance(self.whole, dict):
            raise ValueError(f"JSON chunk: {str(self.whole)[:_SHOWN]}: expected an object")
        self._buffer = self._chunk(end, b"BIN\0")[1] if end < len(self._data) else memoryview(b"")
        for name in self.field(self.whole, "extensionsRequired", list, "extensionsRequired", []):
            if name not in _KNOWN and not str(name).startswith("KHR_materials_"):
                raise ValueError(f"extensionsRequired: {str(name)[:_SHOWN]}: expected {', '.join(_KNOWN)} at most")

    def _chunk(self, start: int, kind: bytes) -> tuple[int, memoryview]:
        """The chunk that begins at a byte: where it ends, and its data."""
        if start + _CHUNK.size > len(self._data):
            raise ValueError(f"chunk at byte {start}: cut short: expected {_CHUNK.size} bytes")
        length, found = _CHUNK.unpack_from(self._data, start)
        end = start + _CHUNK.size + length
        if found != kind or end > len(self._data):
            raise ValueError(
                f"chunk at byte {start}: {found!r} of {length} bytes: expected {kind!r} of at most "
                f"{len(self._data) - start - _CHUNK.size}"
            )
        return end, memoryview(self._data)[start + _CHUNK.size : end]

    @staticmethod
    def field(holder: Any, key: str, kind: type[T], name: str, default: T | None = None) -> T:
        """A field of an object; `default` stands for a field that is not there, None: it must be there."""
        value: Any = holder.get(key, default) if isinstance(holder, dict) else None
        if kind is float and type(value) is int:
            value = float(value) if abs(value) < 1 << 1000 else math.inf
        if type(value) is not kind or (isinstance(value, float) and not math.isfinite(value)):
            raise ValueError(f"{name}: {str(value)[:_SHOWN]}: expected {kind.__name__}")
        found: T = value
        return found

    def numbers(self, holder: Any, key: str, default: list[float], name: str) -> list[float]:
        """A list of as many finite numbers as `default` has, which stands for a list that is not there."""
        given = self.field(holder, key, list, name, default)
        if len(given) != len(default) or not all(
            type(n) in (int, float) and abs(n) < 1e30 for n in given  # NaN fails the comparison
        ):
            raise ValueError(f"{name}: {str(given)[:_SHOWN]}: expected {len(default)} numbers")
        return [float(n) for n in given]

    def item(self, kind: str, number: Any, name: str) -> dict[str, Any]:
        """Object `number` of a top-level list."""
        items = self.field(self.whole, kind, list, kind, [])
        if type(number) is not int or not 0 <= number < len(items) or not isinstance(items[number], dict):
            raise ValueError(f"{name}: {str(number)[:_SHOWN]}: expected a number below {len(items)}, one of the {kind}")
        found: dict[str, Any] = items[number]
        return found

    def view(self, number: Any, name: str) -> tuple[memoryview, int]:
        """The bytes of a buffer view, and the step between its elements; 0: they have no gaps."""
        view, here = self.item("bufferViews", number, name), f"bufferViews[{number}]"
        buffer = self.item("buffers", view.get("buffer"), f"{here}.buffer")
        if view["buffer"] != 0 or "uri" in buffer:
            raise ValueError(f"{here}.buffer: {view['buffer']}: expected the file's own buffer, not another file")
        start = self.field(view, "byteOffset", int, f"{here}.byteOffset", 0)
        length = self.field(view, "byteLength", int, f"{here}.byteLength")
        step = self.field(view, "byteStride", int, f"{here}.byteStride", 0)
        if min(start, length, step) < 0 or start + length > len(self._buffer):
            raise ValueError(f"{here}: bytes {start} to {start + length}: expected 0 to {len(self._buffer)}")
        return self._buffer[start : start + length], step

    def count(self, number: Any, name: str) -> int:
        """The number of elements of an accessor."""
        return self.field(self.item("accessors", number, name), "count", int, f"accessors[{number}].count")

    def array(self, number: Any, name: str, widths: tuple[int, ...]) -> npt.NDArray[Any]:  # [n, width]
        """An accessor's elements, of one of the given numbers of components; normalised ones as float32."""
        accessor, here = self.item("accessors", number, name), f"accessors[{number}]"
        width = _WIDTHS.get(self.field(accessor, "type", str, f"{here}.type"), 0)
        kind = self.field(accessor, "componentType", int, f"{here}.componentType")
        if width not in widths or kind not in _DTYPES:
            expected = f"{' or '.join(map(str, widths))} numbers of a known type"
            raise ValueError(f"{name}: {accessor['type'][:_SHOWN]} of {kind}: expected {expected}")
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"{name}: accessor {number}: expected one with all its numbers in the buffer, not sparse")
        dtype = np.dtype(_DTYPES[kind])
        data, step = self.view(accessor["bufferView"], f"{here}.bufferView")
        start, count = self.field(accessor, "byteOffset", int, f"{here}.byteOffset", 0), self.count(number, name)
        step = step or dtype.itemsize * width
        end = start + step * (count - 1) + dtype.itemsize * width if count > 0 else start
        if min(start, count) < 0 or end > len(data) or step < dtype.itemsize * width:
            raise ValueError(f"{name}: accessor {number}: {count} elements to byte {end}: expected at most {len(data)}")
        shape, steps = (count, width), (step, dtype.itemsize)
        found: npt.NDArray[Any] = np.empty(shape, dtype)
        if count:
            found[:] = np.ndarray(shape, dtype, data, start, steps)
        if accessor.get("normalized") is True and dtype.kind in "iu":
            found = np.maximum(found / np.float32(np.iinfo(dtype).max), np.float32(-1.0)).astype(np.float32)
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            where = np.argwhere(~np.isfinite(found))[0].tolist()
            raise ValueError(f"{name}: {found[tuple(where)]} in element {where[0]}: expected finite numbers")
        return found

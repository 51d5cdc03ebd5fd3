"""A file that holds a description and arrays, each with its checksum.

Layout, all numbers little-endian:

| bytes | what |
|---|---|
| 8 | `MAGIC` |
| 4 | version of the content, uint32 |
| 8 | length of the description in bytes, uint64 |
| 32 | SHA-256 of the bytes before it and of the description |
| length | the description: JSON (UTF-8), an object with `content` and `arrays` |
| rest | the arrays one after the other, row by row, without gaps |

`arrays` lists, in the order of the file, each array's `name`, `dtype` (as in `DTYPES`), `shape` and `sha256`. So every
byte is checked, the file has exactly one possible length, and nothing in it can be executed. In `content`, an object
`{"array": k}` stands for array number k.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import math
import os
import stat
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["DTYPES", "MAGIC", "Sealed", "read_sealed", "write_sealed"]

MAGIC = b"\x8eFARSIDE"  # the first byte is no text
DTYPES = ("|b1", "|u1", "<u2", "<i4", "<i8", "<u8", "<f4", "<f8")
_START = struct.Struct("<8sIQ")
_DIGEST = hashlib.sha256().digest_size
_MOST_TEXT = 1 << 26  # bytes of the description: a hundred times that of a rig with a thousand cameras
_MOST_ARRAYS = 1 << 20
_SHOWN = 12  # digits of a checksum in a message


class Sealed(NamedTuple):
    """What a file holds: its content, and its arrays by number."""

    content: Any
    arrays: tuple[npt.NDArray[Any], ...]


def write_sealed(path: Path, version: int, content: Any, arrays: Sequence[tuple[str, npt.NDArray[Any]]]) -> int:
    """Writes a file as a whole: until everything is on the disk, a file of that name stays as it was. Returns the
    number of bytes.

    content: what JSON can hold; arrays: with their names, of the types in `DTYPES`. Raises OSError if the file cannot
    be written, or if another process is writing it, and ValueError for another type of array.
    """
    plain = [(name, np.ascontiguousarray(array, array.dtype.newbyteorder("<"))) for name, array in arrays]
    listed = [_listed(name, array) for name, array in plain]
    text = json.dumps({"content": content, "arrays": listed}, separators=(",", ":")).encode()
    start = _START.pack(MAGIC, version, len(text))
    seal = hashlib.sha256(start + text).digest()
    with _replacing(path) as file:
        file.write(start + seal + text)
        for _, array in plain:
            file.write(_bytes(array))
    return len(start) + len(seal) + len(text) + sum(array.nbytes for _, array in plain)


def read_sealed(path: Path, version: int, *, arrays: bool = True) -> Sealed:
    """Reads and checks a whole file; with `arrays` False the arrays are only checked, and none are returned.

    Raises ValueError, which names the file and what is wrong with it, for a file of another kind or version, that is
    cut short or too long, or of which a bit has changed. Takes no more memory than the file has bytes.
    """
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise ValueError("kind: no regular file: expected a saved model")
            content, listed = _description(file, status.st_size, version)
            found = [_array(file, item, arrays) for item in listed]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Sealed(content, tuple(found) if arrays else ())


def _listed(name: str, array: npt.NDArray[Any]) -> dict[str, Any]:
    if array.dtype.str not in DTYPES:
        raise ValueError(f"{name}: {array.dtype.str}: expected one of {', '.join(DTYPES)}")
    digest = hashlib.sha256(_bytes(array)).hexdigest()
    return {"name": name, "dtype": array.dtype.str, "shape": list(array.shape), "sha256": digest}


def _bytes(array: npt.NDArray[Any]) -> memoryview:
    """The bytes of a contiguous array, not copied."""
    return array.reshape(-1).view(np.uint8).data


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[BinaryIO]:
    """A new file that takes the place of `path` at the end of the block, if that is reached.

    It is written beside it, as .NAME.part. A lock keeps two processes from writing it at once; what a process that was
    killed has left there is overwritten.
    """
    part = path.with_name(f".{path.name}.part")
    file = _locked(part)
    try:
        yield file
        file.flush()
        os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink()
        raise
    finally:
        file.close()
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _locked(part: Path) -> BinaryIO:
    """The empty file `part`, open and locked."""
    while True:
        file = os.fdopen(os.open(part, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "r+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_at(file, part):
                file.truncate(0)
                return file
        except BlockingIOError as error:
            file.close()
            raise BlockingIOError(f"{part}: expected no other process to write it") from error
        except BaseException:
            file.close()
            raise
        file.close()  # another process has just finished it: it is not there any more


def _is_at(file: BinaryIO, path: Path) -> bool:
    """Whether an open file is the one that has this name now."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _description(file: BinaryIO, size: int, version: int) -> tuple[Any, list[dict[str, Any]]]:
    """The content and the list of arrays, checked; the file is then at the first array."""
    least = _START.size + _DIGEST
    start = file.read(least)
    if start[: len(MAGIC)] != MAGIC[: len(start)] or not start:
        raise ValueError(f"first bytes: {start[: len(MAGIC)]!r}: expected {MAGIC!r}, as in a saved model")
    if len(start) < least:
        raise ValueError(f"size: {size} bytes: expected at least {least}; it is cut short")
    _, found, length = _START.unpack_from(start)
    if found != version:
        raise ValueError(f"version: {found}: expected {version}")
    if length > min(size - least, _MOST_TEXT):
        raise ValueError(f"length of the description: {length}: expected at most {min(size - least, _MOST_TEXT)}")
    text = file.read(length)
    _compare("the description", hashlib.sha256(start[: _START.size] + text).digest().hex(), start[_START.size :].hex())
    try:
        whole = json.loads(text)
        content, listed = whole["content"], [_checked(item) for item in whole["arrays"]]
    except (KeyError, TypeError, RecursionError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"description: {type(error).__name__} {error}: expected content and arrays") from error
    expected = least + length + sum(map(_size, listed))
    if size != expected or len(listed) > _MOST_ARRAYS:
        kind = "it is cut short" if size < expected else "something follows"
        raise ValueError(f"size: {size} bytes: expected {expected}; {kind}")
    return content, listed


def _checked(item: Any) -> dict[str, Any]:
    """An entry of the list of arrays, of the right types."""
    name, dtype, shape, digest = (item[key] for key in ("name", "dtype", "shape", "sha256"))
    if not (isinstance(name, str) and dtype in DTYPES and isinstance(digest, str) and isinstance(shape, list)):
        raise ValueError(f"arrays: {str(item)[:200]}: expected a name, a known dtype, a shape and a checksum")
    if not all(type(side) is int and 0 <= side < 1 << 48 for side in shape) or len(shape) > 8:
        raise ValueError(f"{name}: shape {str(shape)[:200]}: expected up to 8 numbers of 0 or more")
    return {"name": name, "dtype": dtype, "shape": shape, "sha256": digest}


def _size(item: dict[str, Any]) -> int:
    sides: list[int] = item["shape"]
    return int(item["dtype"][2:]) * math.prod(sides)


def _array(file: BinaryIO, item: dict[str, Any], wanted: bool) -> npt.NDArray[Any]:
    """The next array of the file; without `wanted` it is only checked, and one without elements is returned."""
    digest = hashlib.sha256()
    array = np.empty(item["shape"] if wanted else 0, item["dtype"])
    if wanted:
        into = _bytes(array)
        if file.readinto(into) != len(into):  # type: ignore[attr-defined]
            raise ValueError(f"{item['name']}: cut short: expected {len(into)} bytes")
        digest.update(into)
    else:
        left = _size(item)
        while left and (piece := file.read(min(left, 1 << 22))):
            digest.update(piece)
            left -= len(piece)
    _compare(item["name"], digest.hexdigest(), item["sha256"])
    return array


def _compare(name: str, found: str, expected: str) -> None:
    if found != expected:
        raise ValueError(f"checksum of {name}: {found[:_SHOWN]}: expected {expected[:_SHOWN]}; the file is damaged")

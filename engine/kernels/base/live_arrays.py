"""Which array an address lies in, where nothing is compiled: kernels can be run in a debugger, and are checked.

Arrays are known by `address_of`, which tables of addresses are made with, and by looking for them among the local
variables of the functions that are running: an address comes from one of those. None is kept alive. Any thread may ask.
"""

from __future__ import annotations

import bisect
import sys
import threading
import weakref
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import config

from ...support.array_types import U8

__all__ = ["address_of", "bytes_at"]


class _Known(NamedTuple):
    array: weakref.ref[npt.NDArray[Any]]  # that owns the memory
    name: str
    start: int
    size: int  # bytes


_KNOWN: dict[int, _Known] = {}  # by start
_STARTS: list[int] = []  # in order
_LOCK = threading.RLock()  # of both


def address_of(array: npt.NDArray[Any]) -> int:
    """The address of an array, for a table: whoever takes it keeps the array alive."""
    if config.DISABLE_JIT:
        _note("an array", array)
    return int(array.ctypes.data)


def bytes_at(address: int, index: int, size: int, count: int = 1) -> U8:
    """The bytes of elements index to index + count - 1, of `size` bytes each, from an address on.

    Raises IndexError where the address lies in no array that is alive, or the elements go beyond it.
    """
    start = int(address) + int(index) * size
    with _LOCK:
        known = _find(int(address)) or _search(int(address))
    if known is None:
        raise IndexError(f"address {int(address):#x}: in no array that is alive (index {index})")
    array = known.array()
    first = start - known.start
    if array is None or first < 0 or first + count * size > known.size:
        raise IndexError(
            f"{known.name}: {known.size} bytes: index {index} of {size} bytes each from byte "
            f"{int(address) - known.start} on, {count} of them: beyond it"
        )
    return _bytes_of(array)[first : first + count * size]


def _owner(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def _bytes_of(array: npt.NDArray[Any]) -> U8:
    """All bytes of the memory that an array owns, as one row: in the order of memory, whatever that of its axes is."""
    axes = sorted(range(array.ndim), key=lambda axis: -array.strides[axis])
    return array.transpose(axes).reshape(-1).view(np.uint8)


def _note(name: str, array: npt.NDArray[Any]) -> None:
    owner = _owner(array)
    if owner.nbytes:
        start = int(owner.ctypes.data)
        label = f"{name}, {owner.dtype} {list(owner.shape)}"
        with _LOCK:
            if start not in _KNOWN:
                bisect.insort(_STARTS, start)
            _KNOWN[start] = _Known(weakref.ref(owner), label, start, owner.nbytes)


def _find(address: int) -> _Known | None:
    while (number := bisect.bisect_right(_STARTS, address) - 1) >= 0:
        known = _KNOWN[_STARTS[number]]
        if known.array() is not None:
            return known if address < known.start + known.size else None
        del _KNOWN[_STARTS.pop(number)]  # its memory may be another's by now
    return None


def _search(address: int) -> _Known | None:
    """Look among the arrays in local variables of the functions that are running."""
    frame = sys._getframe(2)
    while frame is not None:
        for name, value in frame.f_locals.items():
            for array in _arrays(value):
                owner = _owner(array)
                start = int(owner.ctypes.data)
                if start <= address < start + owner.nbytes:
                    _note(f"{name} in {frame.f_code.co_name}", array)
                    return _KNOWN[start]
        frame = frame.f_back  # type: ignore[assignment]
    return None


def _arrays(value: Any) -> Iterator[npt.NDArray[Any]]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from _arrays(part)

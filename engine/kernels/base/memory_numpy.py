"""Operations of `memory` by NumPy, where nothing is compiled: addresses are looked up in `live_arrays`, and checked.

Raises IndexError, which tells the array and the index, where one goes beyond an array or lies in none.
"""

from __future__ import annotations

import ctypes
import threading
from typing import Any

import numpy as np
import numpy.typing as npt

from .live_arrays import bytes_at
from .vectors_numpy import LANES, Floats, Integers, Mask

__all__ = [
    "add_i64_atomically",
    "gather_bytes",
    "gather_floats",
    "gather_halves",
    "gather_integers",
    "gather_quads",
    "load",
    "load_eight_u8",
    "load_f32",
    "load_foreign_i64",
    "load_foreign_u32",
    "load_i64",
    "load_u8",
    "load_u16",
    "load_u32",
    "load_u64",
    "load_where",
    "or_u64",
    "prefetch",
    "store",
    "store_byte_where",
    "store_foreign_i32",
    "store_larger",
    "store_packed",
    "store_where",
]


_ADDING = threading.Lock()


def _place(address: int, index: int, dtype: Any) -> npt.NDArray[Any]:  # [1]
    return bytes_at(address, index, np.dtype(dtype).itemsize).view(dtype)


def _scalar(address: int, index: int, dtype: Any) -> Any:
    return _place(address, index, dtype)[0]


def load_u8(address: int, index: int) -> int:
    """The uint8 at address + index."""
    return int(_scalar(address, index, np.uint8))


def load_u16(address: int, index: int) -> int:
    """The uint16 at address + 2 * index."""
    return int(_scalar(address, index, np.uint16))


def load_u32(address: int, index: int) -> int:
    """The uint32 at address + 4 * index."""
    return int(_scalar(address, index, np.uint32))


def load_u64(address: int, index: int) -> int:
    """The uint64 at address + 8 * index."""
    return int(_scalar(address, index, np.uint64))


def load_eight_u8(address: int, index: int) -> int:
    """Eight uint8 side by side from address + index, as one int64; the first lowest."""
    return int(bytes_at(address, index, 1, 8).view(np.int64)[0])


def load_f32(address: int, index: int) -> float:
    """The float32 at address + 4 * index."""
    number: float = _scalar(address, index, np.float32)  # a NumPy number: products with it are in single precision
    return number


def load_i64(address: int, index: int) -> int:
    """The int64 at address + 8 * index."""
    return int(_scalar(address, index, np.int64))


def load_foreign_i64(address: int, index: int) -> int:
    """The int64 at address + 8 * index, in memory that is of no array: nothing is checked."""
    return ctypes.c_int64.from_address(address + 8 * index).value


def load_foreign_u32(address: int, index: int) -> int:
    """The uint32 at address + 4 * index, in memory that is of no array: nothing is checked."""
    return ctypes.c_uint32.from_address(address + 4 * index).value


def store_foreign_i32(address: int, index: int, value: int) -> None:
    """Write an int32 to address + 4 * index, in memory that is of no array: nothing is checked."""
    ctypes.c_int32.from_address(address + 4 * index).value = int(value)


def or_u64(address: int, index: int, bits: int) -> None:
    """Set bits of the uint64 at address + 8 * index."""
    _place(address, index, np.uint64)[0] |= np.uint64(bits)


def add_i64_atomically(address: int, index: int, value: int) -> None:
    """Add to the int64 at address + 8 * index; threads that add at the same time lose nothing."""
    with _ADDING:
        _place(address, index, np.int64)[0] += value


def load(address: int, index: int) -> Floats:
    """Sixteen float32 side by side from address + 4 * index."""
    return Floats(bytes_at(address, index, 4, LANES).view(np.float32).copy())


def store(address: int, index: int, values: Floats) -> None:
    """Write floats to sixteen float32 side by side from address + 4 * index."""
    bytes_at(address, index, 4, LANES).view(np.float32)[:] = values.lanes


def store_larger(address: int, index: int, x: Floats, y: Floats) -> None:
    """As `store` of the larger of two in each lane, neither of them NaN."""
    bytes_at(address, index, 4, LANES).view(np.float32)[:] = np.maximum(x.lanes, y.lanes)


def load_where(address: int, index: int, mask: Mask) -> Floats:
    """As `load` where the mask is true, 0 elsewhere; what is masked out need not exist."""
    out = np.zeros(LANES, np.float32)
    for lane in np.flatnonzero(mask.lanes):
        out[lane] = _scalar(address, index + int(lane), np.float32)
    return Floats(out)


def store_where(address: int, index: int, values: Floats, mask: Mask) -> None:
    """As `store` where the mask is true; elsewhere nothing is written."""
    for lane in np.flatnonzero(mask.lanes):
        bytes_at(address, index + int(lane), 4).view(np.float32)[0] = values.lanes[lane]


def store_byte_where(address: int, index: int, number: int, mask: Mask) -> None:
    """Write the low byte of a number to those of sixteen bytes from address + index where the mask is true."""
    for lane in np.flatnonzero(mask.lanes):
        bytes_at(address, index + int(lane), 1)[0] = number & 0xFF


def store_packed(address: int, values: Integers, mask: Mask) -> int:
    """Write those integers where the mask is true side by side to int32 from address on; returns how many. There must
    be room for sixteen: what is behind them counts for nothing afterwards."""
    chosen = values.lanes[mask.lanes]
    bytes_at(address, 0, 4, LANES).view(np.int32)[:] = np.pad(chosen, (0, LANES - len(chosen)), constant_values=-1)
    return len(chosen)


def prefetch(address: int, index: Integers) -> None:
    """Nothing: what compiled code has ready soon need not exist."""


def _gathered(address: int, index: Integers, mask: Mask, element: int, dtype: Any) -> npt.NDArray[Any]:
    """A number of a type from address + element * index on in each lane where the mask is true, 0 elsewhere."""
    out = np.zeros(LANES, dtype)
    for lane in np.flatnonzero(mask.lanes):
        out[lane] = bytes_at(address, int(index.lanes[lane]), element, out.itemsize // element).view(dtype)[0]
    return out


def gather_halves(address: int, index: Integers, mask: Mask) -> Integers:
    """Where the mask is true the 32 bits at address + 2 * index: two uint16 side by side, the first in the low half."""
    return Integers(_gathered(address, index, mask, 2, np.int32))


def gather_bytes(address: int, index: Integers, mask: Mask) -> Integers:
    """Where the mask is true the 32 bits at address + index: four uint8 side by side, the first lowest."""
    return Integers(_gathered(address, index, mask, 1, np.int32))


def gather_integers(address: int, index: Integers, mask: Mask) -> Integers:
    """Where the mask is true the int32 at address + 4 * index."""
    return Integers(_gathered(address, index, mask, 4, np.int32))


def gather_floats(address: int, index: Integers, mask: Mask) -> Floats:
    """Where the mask is true the float32 at address + 4 * index."""
    return Floats(_gathered(address, index, mask, 4, np.float32))


def gather_quads(address: int, index: Integers, mask: Mask) -> tuple[Integers, Integers]:
    """Where the mask is true the 64 bits at address + 2 * index, four uint16 side by side: those of the first eight
    lanes in one result, of the others in the next, two pairs a lane."""
    pairs = _gathered(address, index, mask, 2, np.int64).view(np.int32)
    return Integers(pairs[:LANES].copy()), Integers(pairs[LANES:].copy())

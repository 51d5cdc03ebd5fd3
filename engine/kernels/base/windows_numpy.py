"""`windows` by NumPy, where nothing is compiled. What a whole window reads must lie in an array."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .live_arrays import bytes_at
from .vectors_numpy import LANES, Floats, Integers, Mask

__all__ = [
    "Window",
    "extent_of",
    "fast_windows",
    "lane_of",
    "load_square",
    "lower_rows",
    "pairs_within",
    "prefetch_window",
    "quads_within",
    "store_square",
    "upper_rows",
    "window_of_bytes",
    "window_of_halves",
]

_ROWS, _SIZE = 8, 8 * LANES
Window = tuple[Integers, Integers, Integers, Integers]


def fast_windows() -> bool:
    """Whether picking from windows is faster than gathers."""
    return True


def _window(address: int, index: int, pitch: int, dtype: Any) -> Window:
    size = np.dtype(dtype).itemsize
    rows = [bytes_at(address, index + row * pitch, size, LANES).view(dtype).astype(np.uint16) for row in range(_ROWS)]
    a, b, c, d = (Integers(pair.copy()) for pair in np.concatenate(rows).view(np.int32).reshape(-1, LANES))
    return a, b, c, d


def window_of_halves(address: int, index: int, pitch: int) -> Window:
    """Eight rows of sixteen uint16, from address + 2 * index on and `pitch` elements apart."""
    return _window(address, index, pitch, np.uint16)


def window_of_bytes(address: int, index: int, pitch: int) -> Window:
    """Eight rows of sixteen uint8, as uint16, from address + index on and `pitch` elements apart."""
    return _window(address, index, pitch, np.uint8)


def prefetch_window(address: int, index: int, pitch: int) -> None:
    """Nothing: what compiled code has ready soon need not exist."""


def lane_of(x: Integers, lane: int) -> int:
    """One of sixteen integers."""
    return int(x.lanes[lane])


def _picked(window: Window, places: Integers, count: int) -> npt.NDArray[np.int32]:  # [LANES * count / 2]
    """`count` elements from each lane's place on, two in each integer; behind the window it begins again."""
    elements = np.concatenate([part.lanes for part in window]).view(np.uint16)
    found = elements[(places.lanes[:, np.newaxis] + np.arange(count)) % _SIZE]
    return np.ascontiguousarray(found).ravel().view(np.int32)


def pairs_within(window: Window, places: Integers) -> Integers:
    """Of a window, the element at each lane's place, 16 * row + column, and the next one, the first in the low half;
    anything where a place lies elsewhere."""
    return Integers(_picked(window, places, 2))


def quads_within(window: Window, places: Integers) -> tuple[Integers, Integers]:
    """Of a window, the element at each lane's place and the next three: those of the first eight lanes in one result,
    of the others in the next, two pairs a lane; anything where a place lies elsewhere."""
    pairs = _picked(window, places, 4)
    return Integers(pairs[:LANES].copy()), Integers(pairs[LANES:].copy())


def extent_of(x: Integers, y: Integers, among: Mask) -> tuple[int, int, int, int]:
    """The least x and y and the largest ones where the mask is true; x and y are 0 to 65534. Where it is nowhere, the
    least are larger than the largest."""
    chosen = [values.lanes[among.lanes] for values in (x, y)]
    left, top = (int(values.min(initial=65535)) for values in chosen)
    right, bottom = (int(values.max(initial=0)) for values in chosen)
    return left, top, right, bottom


def load_square(address: int, index: int, pitch: int) -> Floats:
    """Four rows of four float32, from address + 4 * index on and `pitch` elements apart."""
    rows = [bytes_at(address, index + row * pitch, 4, 4).view(np.float32) for row in range(4)]
    return Floats(np.concatenate(rows))


def store_square(address: int, index: int, pitch: int, values: Floats) -> None:
    """Write sixteen floats as four rows of four float32, from address + 4 * index on and `pitch` elements apart."""
    for row in range(4):
        bytes_at(address, index + row * pitch, 4, 4).view(np.float32)[:] = values.lanes[4 * row : 4 * row + 4]


def _rows_of(top: Floats, bottom: Floats, first: int) -> Floats:
    squares = np.stack([top.lanes, bottom.lanes]).reshape(2, 2, 4, 2)[:, :, first::2]  # vector, side, row, column
    return Floats(squares.transpose(0, 2, 1, 3).ravel())


def upper_rows(top: Floats, bottom: Floats) -> Floats:
    """Of four squares' four rows of two, left and right ones in each of two vectors, the first and the third rows, as
    four rows of four."""
    return _rows_of(top, bottom, 0)


def lower_rows(top: Floats, bottom: Floats) -> Floats:
    """As `upper_rows`: the second and the fourth rows."""
    return _rows_of(top, bottom, 1)

"""A block's triangles as words: bit x of a word stands for the triangle of one shape at column x of a row.

A word, that is a row of triangles of equal shape, is computed at once. A triangle exists if the vertex at its right
angle is split and the middle of its longest side is not. Of half quads, the smallest triangles, those that a depth edge
crosses are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...support.array_types import I32, I64, U8
from ..base import lanes
from ..base.jit import inlined, serial
from .cuts import CUT_DOWN, CUT_RIGHT, KEPT, VALID
from .splits import BLOCK, EVEN, MIXED, ODD, SIDE

__all__ = [
    "DOWN_WORD",
    "KEPT_WORD",
    "RIGHT_WORD",
    "SHAPES",
    "VALID_WORD",
    "TriangleList",
    "count_listed",
    "count_plain",
    "list_triangles",
    "new_list",
    "read_flags",
]

RIGHT_WORD, DOWN_WORD, KEPT_WORD, VALID_WORD = 0, 1, 2, 3  # words of a row of pixels
_ALL = (1 << SIDE) - 1
_CORNERS = 1 | 1 << BLOCK
_INNER = _ALL & ~_CORNERS


def _shapes() -> npt.NDArray[np.int64]:
    """Corners a, b, c as offsets (x, y) of every shape of triangle, wound counter-clockwise on screen (v down).

    First the four half quads, relative to their quad; then, for s from 1 on, the four quarters of a square of size 2s
    and its four halves, relative to its middle.
    """
    halves = np.array([(0, 0, 1, 1, 1, 0), (1, 1, 0, 0, 0, 1), (0, 1, 1, 0, 0, 0), (1, 0, 0, 1, 1, 1)])
    quarters = np.array([(-1, -1, 0, 0, 1, -1), (1, 1, 0, 0, -1, 1), (-1, 1, 0, 0, -1, -1), (1, -1, 0, 0, 1, 1)])
    sizes = [s * part for s in (1, 2, 4, 8, 16) for part in (quarters, 2 * halves - 1)]
    return np.concatenate([halves, *sizes])


SHAPES = _shapes()
_LEVELS, _A_LEVEL = 6, 8  # levels: half quads and s = 1 to 16; number of shapes for each s
_LISTED = 8 * (BLOCK - 1) + 4 * BLOCK + 1  # length of the longest list, and one entry to spare
# By s: the middles of squares of size 2s in even columns.
FALLING = ODD[np.minimum(2 * np.arange(SIDE), BLOCK)] >> np.arange(SIDE)


class TriangleList(NamedTuple):
    """Words of triangles, each of one shape: the word, its row of the block, and the shape's number."""

    words: I64  # [n]
    ys: I32
    shapes: I32


@serial
def new_list() -> TriangleList:
    """Room for the longest list."""
    return TriangleList(np.empty(_LISTED, np.int64), np.empty(_LISTED, np.int32), np.empty(_LISTED, np.int32))


@serial
def read_flags(flags: U8, x0: int, y0: int, wraps: bool, state: int, bits: I64) -> None:
    """bits [4, 33]: cuts, mask and validity of a block's pixels as words; only for MIXED blocks."""
    h, w = flags.shape
    mixed = state == MIXED
    for y in range(SIDE):
        bits[RIGHT_WORD, y] = bits[DOWN_WORD, y] = 0
        bits[KEPT_WORD, y] = bits[VALID_WORD, y] = 0 if mixed else _ALL
    if state != MIXED:
        return
    if x0 + BLOCK < w and y0 + BLOCK < h and (y0 + BLOCK) * w + x0 + lanes.LANES <= h * w:
        for y in range(SIDE):
            address = flags.ctypes.data + (y0 + y) * w + x0
            bits[RIGHT_WORD, y] = lanes.bits_of(address, CUT_RIGHT) & _ALL
            bits[DOWN_WORD, y] = lanes.bits_of(address, CUT_DOWN) & _ALL
            bits[KEPT_WORD, y] = lanes.bits_of(address, KEPT) & _ALL
            bits[VALID_WORD, y] = lanes.bits_of(address, VALID) & _ALL
        return
    limit = w if wraps else w - 1
    for y in range(min(SIDE, h - y0)):
        for x in range(min(SIDE, limit + 1 - x0)):
            flag = np.int64(flags[y0 + y, (x0 + x) % w])
            bits[RIGHT_WORD, y] |= ((flag & CUT_RIGHT) != 0) << x
            bits[DOWN_WORD, y] |= ((flag & CUT_DOWN) != 0) << x
            bits[KEPT_WORD, y] |= ((flag & KEPT) != 0) << x
            bits[VALID_WORD, y] |= ((flag & VALID) != 0) << x


@inlined
def _note(word: int, y: int, shape: int, words: I64, ys: I32, shapes: I32, count: int) -> int:
    """Add a word to a list if it has bits; returns the list's length."""
    words[count], ys[count], shapes[count] = word, y, shape
    return count + (word != 0)


@serial
def list_triangles(
    splits: I64, bits: I64, parity: int, columns: int, rows: int, whole: bool, found: TriangleList
) -> int:
    """List a block's triangles as words; returns the number of words.

    columns and rows: of the block's vertices that lie in the picture. With `whole` there are no half quads at all in
    quads that a depth edge crosses.
    """
    n = _list_squares(splits, bits, parity, columns, rows, found)
    return _list_half_quads(splits, bits, columns, rows, whole, found, n)


@serial
def _list_squares(splits: I64, bits: I64, parity: int, columns: int, rows: int, found: TriangleList) -> int:
    """List the quarters and halves of squares; returns the number of words."""
    words, ys, shapes = found
    inside, n = (1 << columns) - 1, 0
    for level in range(1, _LEVELS):
        s = 1 << level - 1
        first = 4 + _A_LEVEL * (level - 1)
        for y in range(s, min(BLOCK, rows), 2 * s):
            here = ODD[s] & bits[KEPT_WORD, y]
            split, single = here & splits[y] & inside, here & ~splits[y]
            if split != 0:  # quarters: triangles round the middle, each with a side of the square
                for k, other in enumerate((splits[y - s], splits[y + s], splits[y] << s, splits[y] >> s)):
                    n = _note(split & ~other, y, first + k, words, ys, shapes, n)
            # Halves of squares: the vertex at their right angle is split, or the square is the whole block.
            root = 2 * s == BLOCK
            above, below = (-1, -1) if root else (splits[y - s], splits[y + s])
            if single != 0 and (above | below) != 0:
                falls = (y // (2 * s) + (parity if root else 0)) % 2 == 0
                falling = single & (FALLING[s] if falls else ~FALLING[s])
                rising = single & ~falling
                for k, half in enumerate(
                    (falling & (above >> s), falling & (below << s), rising & (above << s), rising & (below >> s))
                ):
                    n = _note(half, y, first + 4 + k, words, ys, shapes, n)
    return n


@serial
def _list_half_quads(
    splits: I64, bits: I64, columns: int, rows: int, whole: bool, found: TriangleList, n: int
) -> int:
    """Append the half quads to the first n words; returns the new number of words."""
    words, ys, shapes = found
    quads = (1 << (columns - 1)) - 1
    for y in range(rows - 1):
        over, under = splits[y], splits[y + 1]
        if (over | under) == 0:
            continue
        falling = EVEN[1] if y % 2 == 0 else ODD[1]  # diagonals join pixels with even x + y
        top, bottom = bits[RIGHT_WORD, y], bits[RIGHT_WORD, y + 1]
        left, right = bits[DOWN_WORD, y], bits[DOWN_WORD, y] >> 1
        if whole:
            top = bottom = left = right = top | bottom | left | right
        a, b, c, d = bits[KEPT_WORD, y], bits[KEPT_WORD, y] >> 1, bits[KEPT_WORD, y + 1], bits[KEPT_WORD, y + 1] >> 1
        for k, half in enumerate((
            falling & (over >> 1) & ~(top | right) & (a | b | d), falling & under & ~(bottom | left) & (a | c | d),
            ~falling & over & ~(top | left) & (a | b | c), ~falling & (under >> 1) & ~(bottom | right) & (b | c | d),
        )):  # fmt: skip
            n = _note(half & quads, y, k, words, ys, shapes, n)
    return n


@inlined
def _moved(word: int, columns: int) -> int:
    """A word with its bits moved `columns` to the right."""
    return word << columns if columns >= 0 else word >> -columns


@serial
def count_listed(found: TriangleList, n: int, used: I64) -> tuple[int, int]:
    """The numbers of vertices and triangles in a list of n words; used [33]: filled with words of these vertices."""
    words, ys, shapes = found
    for y in range(SIDE):
        used[y] = 0
    vertices, triangles = 0, 0
    for k in range(n):
        word, y, shape = words[k], ys[k], SHAPES[shapes[k]]
        triangles += lanes.ones(word)
        used[y + shape[1]] |= _moved(word, shape[0])
        used[y + shape[3]] |= _moved(word, shape[2])
        used[y + shape[5]] |= _moved(word, shape[4])
    for y in range(SIDE):
        vertices += lanes.ones(used[y])
    return vertices, triangles


@serial
def count_plain(splits: I64, used: I64) -> tuple[int, int]:
    """As `count_listed`, for a block that lies in the picture and has no depth edges: every split adds a triangle on
    each side."""
    vertices, triangles = 4, 2
    for y in range(SIDE):
        split = splits[y] & (_INNER if y % BLOCK == 0 else _ALL)
        used[y] = split | (_CORNERS if y % BLOCK == 0 else 0)
        vertices += lanes.ones(split)
        triangles += lanes.ones(split & _INNER) + (lanes.ones(split) if y % BLOCK != 0 else 0)
    return vertices, triangles

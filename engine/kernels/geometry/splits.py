"""The split vertices of an error-bounded triangulation: a right-triangulated irregular network of pixel centres.

The picture is divided into blocks of 32 x 32 quads. A block is halved along a diagonal, and its triangles are halved
again and again at the middle of their longest side, down to half quads. Every grid vertex is the middle of one longest
side, so the question "split here?" belongs to the vertex. Two kinds of vertices alternate: "centres" of squares of size
2s, on a diagonal, and "middles" of their sides. The diagonal of the square with corner (i, j), in units of its size,
goes down-right where i + j is even.

A block by itself needs a split at a vertex if the vertex' error is above the tolerance. The error is the vertex' own
deviation from the middle of its side, plus the largest error of the (up to four) vertices that would split the
triangles on both sides. It bounds the distance of every depth code of the block, under the triangles that meet at the
side, from their planes: it is a bound, not an estimate. A parent's error is never below its children's, so a block
alone has no T-junctions. On the border of two blocks a vertex is split if either block needs it; then its parents on
both sides are split, too.

A block's splits are words int64 [35]: bit x of word y tells whether the vertex in column x and row y is split; bit y of
the last two words tells it for the first column and for the last one (without corners).
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import I64, U8, U16
from ..base import lanes
from ..base.jit import inlined, parallel, serial
from .cuts import BROKEN, KEPT

__all__ = [
    "BLOCK",
    "EMPTY",
    "EVEN",
    "MIXED",
    "ODD",
    "PLAIN",
    "SIDE",
    "WORDS",
    "find_mixed",
    "join_blocks",
    "split_blocks",
]


BLOCK = 32
SIDE = BLOCK + 1  # vertices
WORDS = SIDE + 2
_FIRST, _LAST = SIDE, SIDE + 1  # words

# States of a block. EMPTY: no pixel is kept; PLAIN: all pixels are kept and none is broken; MIXED: anything else.
EMPTY, PLAIN, MIXED = 0, 1, 2

# Scratch rows: a block's codes, and for each vertex the error that its own pixel demands; then errors of middles and of
# centres. Round the errors there are only zeros, for children in other blocks.
_PITCH, _LEFT = 96, 16
_CODES, _LEAST, _MIDDLES, _CENTRES = 0, SIDE, 2 * SIDE, 3 * SIDE + 8
_ROWS = 4 * SIDE + 16
_PITCH_BYTES = 2 * _PITCH
_INFINITE = 65535
_COLUMNS = (1 << SIDE) - 1  # the bits of a block's vertices
_INNER = (1 << BLOCK) - 2  # of a side without the block's corners

# By s: the bits at odd and at even multiples of s.
ODD = np.array([sum(1 << x for x in range(s, SIDE, max(2 * s, 1)) if s) for s in range(SIDE)], np.int64)
EVEN = np.array([sum(1 << x for x in range(0, SIDE, max(2 * s, 1)) if s) for s in range(SIDE)], np.int64)


@serial
def _reaches_out(x: int, y: int, last_x: int, last_y: int) -> bool:
    """Whether the side that a block's vertex is the middle of ends outside the picture."""
    step_x, step_y = x & -x if x else BLOCK, y & -y if y else BLOCK
    step = min(step_x, step_y)
    beyond_x, beyond_y = x + (step if step_x <= step_y else 0), y + (step if step_y <= step_x else 0)
    return beyond_x > last_x or beyond_y > last_y


@serial
def _load_block(codes: U16, flags: U8, x0: int, y0: int, limit: int, scratch: U16) -> int:
    """Copy a block's codes, and the errors that its pixels demand, to the scratch rows; returns the block's state."""
    h, w = codes.shape
    codes_row = scratch.ctypes.data + 2 * (_LEFT + _PITCH * _CODES)
    least_row = scratch.ctypes.data + 2 * (_LEFT + _PITCH * _LEAST)
    broken, kept = 0, 0
    if x0 + BLOCK < w and y0 + BLOCK < h and (y0 + BLOCK) * w + x0 + lanes.LANES <= h * w:
        for y in range(SIDE):
            first = (y0 + y) * w + x0
            lanes.move(codes.ctypes.data + 2 * first, codes_row + _PITCH_BYTES * y)
            word = lanes.bits_of(flags.ctypes.data + first, BROKEN)
            lanes.mark(word, least_row + _PITCH_BYTES * y)
            broken |= word
            kept |= lanes.bits_of(flags.ctypes.data + first, KEPT)
        if kept & _COLUMNS == 0:
            return EMPTY
        return MIXED if broken & _COLUMNS else PLAIN  # where the mask changes, pixels are broken
    seen = 0
    for y in range(SIDE):
        for x in range(SIDE):
            py, px = min(y0 + y, h - 1), min(x0 + x, limit) % w
            flag = flags[py, px]
            is_single = flag & BROKEN or _reaches_out(x, y, limit - x0, h - 1 - y0)
            scratch[_CODES + y, _LEFT + x] = codes[py, px]
            scratch[_LEAST + y, _LEFT + x] = _INFINITE if is_single else 0
            seen |= flag
    return MIXED if seen & KEPT else EMPTY


@serial
def _split_block(scratch: U16, tolerance: int, largest: int, parity: int, splits: I64) -> None:
    """The splits that a block by itself needs, from its scratch rows; see `split_blocks`."""
    start = scratch.ctypes.data + 2 * _LEFT
    codes, least = start + _PITCH_BYTES * _CODES, start + _PITCH_BYTES * _LEAST
    middles, centres = start + _PITCH_BYTES * _MIDDLES, start + _PITCH_BYTES * _CENTRES
    for y in range(SIDE):
        splits[y] = 0
    s = 1
    while s < BLOCK:
        down, across, forced = s * _PITCH_BYTES, 2 * s, -1 if s >= largest else 0
        reach = s // 2 * 2
        for y in range(0, SIDE, s):
            along = (y // s) % 2 == 0  # sides that lie in the row
            step = across if along else down
            row = y * _PITCH_BYTES
            children = centres + row - s // 2 * _PITCH_BYTES, centres + row + s // 2 * _PITCH_BYTES
            if s == 1:
                children = centres - 8 * _PITCH_BYTES, centres - 8 * _PITCH_BYTES
            word = lanes.side_errors(
                codes + row, codes + row - step, codes + row + step, least + row, children[0], children[1], reach,
                tolerance, middles + row,
            )  # fmt: skip
            splits[y] |= (word | forced) & (ODD[s] if along else EVEN[s])
        for y in range(s, SIDE, 2 * s):
            row = y * _PITCH_BYTES
            falling = ODD[2 * s] >> s  # squares in even columns
            if (y // (2 * s) + (parity if 2 * s == BLOCK else 0)) % 2 == 1:
                falling = ~falling
            word = lanes.square_errors(
                codes + row, down, across, falling, least + row, middles + row, ODD[s], tolerance, centres + row
            )
            splits[y] |= (word | forced) & ODD[s]
        s *= 2


@inlined
def _column(splits: I64, x: int) -> int:
    """A column of a block's splits as a word, without the block's corners."""
    word = 0
    for y in range(1, BLOCK):
        word |= ((splits[y] >> x) & 1) << y
    return word


@serial
def _note_columns(splits: I64, last: int) -> None:
    """Set the last two words; `last` is the number of the last column."""
    any_split = 0
    for y in range(SIDE):
        any_split |= splits[y]
    splits[_FIRST], splits[_LAST] = (_column(splits, 0), _column(splits, last)) if any_split else (0, 0)


@inlined
def _set_column(splits: I64, x: int, word: int) -> None:
    while word != 0:
        splits[lanes.lowest(word)] |= 1 << x
        word &= word - 1


@parallel
def split_blocks(
    codes: U16, flags: U8, tolerance: int, largest: int, wraps: bool, changed: U8, splits: I64, states: U8
) -> None:
    """Fill splits [rows, columns, WORDS], with those that each block needs by itself, and states [rows, columns].

    tolerance: twice the largest distance of a code from its triangle, in codes, below 65535. largest: length of the
    longest leg of a triangle; with 1 there are two triangles per quad. Blocks with changed [rows, columns] = 0 stay as
    they are.
    """
    w = codes.shape[1]
    limit = w if wraps else w - 1  # largest x of a vertex
    last = w - (splits.shape[1] - 1) * BLOCK if wraps else BLOCK
    for row in numba.prange(splits.shape[0]):
        i = int(np.int64(row))
        scratch = np.zeros((_ROWS, _PITCH), np.uint16)
        for j in range(splits.shape[1]):
            if changed[i, j] == 0:
                continue
            states[i, j] = _load_block(codes, flags, j * BLOCK, i * BLOCK, limit, scratch)
            if states[i, j] == EMPTY:
                for y in range(splits.shape[2]):
                    splits[i, j, y] = 0
            elif largest == 1:
                for y in range(SIDE):
                    splits[i, j, y] = _COLUMNS
                splits[i, j, _FIRST] = splits[i, j, _LAST] = _INNER
            else:
                _split_block(scratch, tolerance, largest, (i + j) % 2, splits[i, j])
                _note_columns(splits[i, j], last if j == splits.shape[1] - 1 else BLOCK)


@parallel
def find_mixed(flags: U8, states: U8) -> None:
    """states [rows, columns]: MIXED if a block may have pixels at depth edges, PLAIN if it has none. This takes a small
    part of the time of `split_blocks`."""
    h, w = flags.shape
    for row in numba.prange(states.shape[0]):
        i = int(np.int64(row))
        for j in range(states.shape[1]):
            x0, y0, broken = j * BLOCK, i * BLOCK, 0
            if x0 + BLOCK < w and y0 + BLOCK < h and (y0 + BLOCK) * w + x0 + lanes.LANES <= h * w:
                for y in range(SIDE):
                    broken |= lanes.bits_of(flags.ctypes.data + (y0 + y) * w + x0, BROKEN)
                states[i, j] = MIXED if broken & _COLUMNS else PLAIN
            else:
                states[i, j] = MIXED


@serial
def _split_parents(splits: I64) -> None:
    """Split the parents of all split vertices."""
    s = 1
    while s < BLOCK:
        odd, far_odd, far_even = ODD[s], ODD[2 * s], EVEN[2 * s]
        for y in range(s, BLOCK, 2 * s):
            splits[y] |= (splits[y - s] | splits[y + s] | (splits[y] << s) | (splits[y] >> s)) & odd
        if 2 * s == BLOCK:
            return
        for y in range(0, SIDE, 2 * s):
            centres = splits[y - s] & odd if y > 0 else 0
            centres |= splits[y + s] & odd if y < BLOCK else 0
            splits[y] |= ((centres << s) | (centres >> s)) & (far_odd if y % (4 * s) == 0 else far_even)
        s *= 2


@serial
def _join_row(splits: I64, i: int, seam: int) -> bool:
    """Take over the splits of neighbouring blocks on the common sides of a row's blocks; returns whether any is new."""
    rows, columns = splits.shape[0], splits.shape[1]
    changed = False
    for j in range(columns):
        block, last = splits[i, j], seam if seam > 0 and j == columns - 1 else BLOCK
        before = j - 1 if j > 0 else (columns - 1 if seam > 0 else -1)
        behind = j + 1 if j < columns - 1 else (0 if seam > 0 else -1)
        top = splits[i - 1, j, BLOCK] & _INNER & ~block[0] if i > 0 else 0
        bottom = splits[i + 1, j, 0] & _INNER & ~block[BLOCK] if i + 1 < rows else 0
        left = splits[i, before, _LAST] & ~block[_FIRST] if before >= 0 else 0
        right = splits[i, behind, _FIRST] & ~block[_LAST] if behind >= 0 else 0
        if top | bottom | left | right:
            block[0] |= top
            block[BLOCK] |= bottom
            _set_column(block, 0, left)
            _set_column(block, last, right)
            _split_parents(block)
            _note_columns(block, last)
            changed = True
    return changed


@parallel
def join_blocks(splits: I64, seam: int) -> None:
    """Take over the splits of neighbours, and split the parents of split vertices, until nothing changes.

    seam: the column of the last blocks that is the picture's first column again; 0: the picture does not wrap. The
    result is the smallest set that fits, so it does not depend on the order in which rows are visited.
    """
    rows = splits.shape[0]
    pending = True
    while pending:
        changed = np.zeros(rows, np.uint8)
        for row in numba.prange(rows):
            i = int(np.int64(row))
            changed[i] = _join_row(splits, i, seam)
        pending = False
        for row in range(rows):
            pending = pending or changed[row] != 0

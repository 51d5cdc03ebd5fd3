"""Which blocks of a view have changed since its last frame."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import I64, U8, U16
from ..base import lanes
from ..base.jit import parallel, serial
from ..base.lanes import LANES
from .splits import BLOCK

__all__ = ["changed_blocks", "changed_flags", "kept_blocks", "note_changes", "remade_blocks"]


# Bits that tell where pixels have changed along one axis of a tile of 32 x 32: among the first three, anywhere, among
# the last two. Blocks reach one pixel beyond their tile, and depth edges depend on two more pixels on either side.
FIRST, ANY, LAST = 1, 2, 4


@serial
def _changed_columns(codes: U16, last: U16, tiles: U8) -> None:
    """Copy a row of codes to `last`; tiles [n]: set the bits where it had changed."""
    w = codes.shape[0]
    for j in range((w + LANES - 1) // LANES):
        word, x = 0, LANES * j
        if x + LANES <= w:
            old, new = last.ctypes.data + 2 * x, codes.ctypes.data + 2 * x
            word = lanes.differ(old, new)
            if word != 0:
                lanes.move(new, old)
        else:
            for k in range(w - x):
                word |= (codes[x + k] != last[x + k]) << k
                last[x + k] = codes[x + k]
        for half in range(2 if word != 0 else 0):
            part = (word >> 32 * half) & 0xFFFFFFFF
            if part != 0:
                tiles[2 * j + half] |= ANY | (FIRST if part & 7 else 0) | (LAST if part >> 30 else 0)


@parallel
def note_changes(codes: U16, last: U16, tiles: U8) -> None:
    """Copy codes to last [h, w]; tiles [ceil(h / 32), 3, ceil(w / 32)]: for the first three rows of a tile, for all,
    and for its last two, the bits of the columns that had changed."""
    h = codes.shape[0]
    for row in numba.prange(tiles.shape[0]):
        i = int(np.int64(row))
        for j in range(tiles.shape[2]):
            tiles[i, 0, j] = tiles[i, 1, j] = tiles[i, 2, j] = 0
        for y in range(BLOCK * i, min(BLOCK * (i + 1), h)):
            zone = 0 if y - BLOCK * i < 3 else (2 if y - BLOCK * i >= BLOCK - 2 else 1)
            _changed_columns(codes[y], last[y], tiles[i, zone])
        for j in range(tiles.shape[2]):
            tiles[i, 1, j] |= tiles[i, 0, j] | tiles[i, 2, j]


@serial
def changed_blocks(tiles: U8, wraps: bool, changed: U8) -> None:
    """changed [rows, columns]: 1 where a block's triangles may have changed."""
    rows, columns = changed.shape
    across = tiles.shape[2]
    for i in range(rows):
        for j in range(columns):
            changed[i, j] = 0
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    y, x = i + di, j + dj
                    beyond = x < 0 or x >= across
                    if y < 0 or y >= tiles.shape[0] or (beyond and not wraps):
                        continue
                    whole = dj == 0 or x < 0  # the tile on the other side of the seam may be narrower
                    meant = ANY if whole else (LAST if dj < 0 else FIRST)
                    changed[i, j] |= (tiles[y, (2, 1, 0)[di + 1], x % across] & meant) != 0


@serial
def changed_flags(changed: U8, wanted: U8) -> None:
    """wanted [ceil(h / 64), ceil(w / 64)]: 1 where flags of pixels may have changed (`cuts.mark_broken`)."""
    for a in range(wanted.shape[0]):
        for b in range(wanted.shape[1]):
            # The picture's last row and column may belong only to the block before.
            some = np.uint8(0)
            for i in range(max(2 * a - 1, 0), min(2 * a + 2, changed.shape[0])):
                for j in range(max(2 * b - 1, 0), min(2 * b + 2, changed.shape[1])):
                    some |= changed[i, j]
            wanted[a, b] = some != 0


@parallel
def remade_blocks(changed: U8, splits: I64, before: I64, remade: U8) -> None:
    """remade [rows, columns]: 1 where a block or its splits [rows, columns, WORDS] have changed."""
    for row in numba.prange(changed.shape[0]):
        i = int(np.int64(row))
        for j in range(changed.shape[1]):
            other = np.int64(0)
            for k in range(splits.shape[2]):
                other |= splits[i, j, k] ^ before[i, j, k]
            remade[i, j] = (changed[i, j] != 0) | (other != 0)


@parallel
def _tiles_with(keep: U8, tiles: U8) -> None:
    """tiles [ceil(h / 32), ceil(w / 32)]: 1 where one of a tile's pixels is kept."""
    h, w = keep.shape
    for row in numba.prange(tiles.shape[0]):
        i = int(np.int64(row))
        for j in range(tiles.shape[1]):
            found = np.uint8(0)
            for y in range(BLOCK * i, min(BLOCK * (i + 1), h)):
                for x in range(BLOCK * j, min(BLOCK * (j + 1), w)):
                    found |= keep[y, x]
            tiles[i, j] = found != 0


@serial
def kept_blocks(keep: U8, wraps: bool, blocks: U8) -> None:
    """blocks [rows, columns]: 1 where a block or one of its neighbours has triangles with kept pixels."""
    tiles = np.empty(((keep.shape[0] + BLOCK - 1) // BLOCK, (keep.shape[1] + BLOCK - 1) // BLOCK), np.uint8)
    _tiles_with(keep, tiles)
    rows, columns = tiles.shape
    for i in range(blocks.shape[0]):
        for j in range(blocks.shape[1]):
            blocks[i, j] = 0
            # Blocks reach one pixel into the next tiles; with their neighbours, they reach one tile farther.
            for y in range(max(i - 1, 0), min(i + 3, rows)):
                for x in range(j - 1, j + 3):
                    if wraps or 0 <= x < columns:
                        blocks[i, j] |= tiles[y, x % columns]
        if wraps:  # the last blocks reach the picture's first pixels
            blocks[i, 0] |= blocks[i, blocks.shape[1] - 1]

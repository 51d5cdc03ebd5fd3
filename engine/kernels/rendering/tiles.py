"""Tiles of a picture that tell where it has holes and silhouettes, so that other kernels can skip the rest."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, I32, U8
from ..base.jit import inlined, parallel, serial

__all__ = ["HOLE", "SILHOUETTE", "TILE", "count_holes", "list_holes", "list_rims", "mark_open_tiles", "recount_holes"]

TILE = 8  # side, pixels
SILHOUETTE, HOLE = 1, 2  # marks of tiles (`mark_open_tiles`)


@serial
def _by_tile(found: U8, tiles: U8) -> None:
    """tiles [ceil(w / TILE)]: all bits in a tile's columns of found [w]."""
    for i in range(tiles.shape[0]):
        marks = np.uint8(0)
        for x in range(TILE * i, min(TILE * (i + 1), found.shape[0])):
            marks |= found[x]
        tiles[i] = marks


@serial
def _count_row(row: F32, counts: U8) -> None:
    """Add to counts [ceil(w / TILE)] the holes of a row."""
    whole = row.shape[0] // TILE
    for i in range(whole):
        n = np.uint8(0)
        for x in range(TILE):
            n += np.uint8(row[TILE * i + x] <= np.float32(0.0))
        counts[i] += n
    for x in range(TILE * whole, row.shape[0]):
        counts[whole] += np.uint8(row[x] <= np.float32(0.0))


@parallel
def count_holes(disparity: F32, tiles: U8) -> None:
    """tiles [ceil(h / TILE), ceil(w / TILE)]: the number of holes in each tile."""
    h = disparity.shape[0]
    for row in numba.prange(tiles.shape[0]):
        j = int(np.int64(row))
        for i in range(tiles.shape[1]):
            tiles[j, i] = 0
        for y in range(TILE * j, min(TILE * (j + 1), h)):
            _count_row(disparity[y], tiles[j])


@serial
def recount_holes(disparity: F32, tiles: U8) -> None:
    """As `count_holes`, if no holes were added since: tiles without any are skipped."""
    h, w = disparity.shape
    for j in range(tiles.shape[0]):
        for i in range(tiles.shape[1]):
            if tiles[j, i]:
                n = 0
                for y in range(TILE * j, min(TILE * (j + 1), h)):
                    for x in range(TILE * i, min(TILE * (i + 1), w)):
                        n += disparity[y, x] <= np.float32(0.0)
                tiles[j, i] = n


@serial
def list_holes(disparity: F32, tiles: U8, places: I32, index: I32) -> None:
    """Lists holes in reading order: places [n, 2], their rows and columns; index [h, w], each hole's number, written
    only in holes. tiles: from `count_holes`."""
    h, w = disparity.shape
    n = 0
    for y in range(h):
        for i in range(tiles.shape[1]):
            if tiles[y // TILE, i]:
                for x in range(TILE * i, min(TILE * (i + 1), w)):
                    if disparity[y, x] <= np.float32(0.0):
                        places[n, 0], places[n, 1] = y, x
                        index[y, x] = n
                        n += 1


@inlined
def _is_deep(tiles: U8, j: int, i: int) -> bool:
    """Whether a tile and its neighbours in the picture consist of holes only."""
    if tiles[j, i] < TILE * TILE:
        return False
    for b in range(max(j - 1, 0), min(j + 2, tiles.shape[0])):
        for a in range(max(i - 1, 0), min(i + 2, tiles.shape[1])):
            if tiles[b, a] < TILE * TILE:
                return False
    return True


@serial
def list_rims(disparity: F32, tiles: U8, index: I32, rims: I32) -> int:
    """rims [n]: numbers, in `index`, of the holes that touch a drawn pixel; returns their count. tiles, index: from
    `count_holes` and `list_holes`."""
    h, w = disparity.shape
    count = 0
    for j in range(tiles.shape[0]):
        for i in range(tiles.shape[1]):
            if tiles[j, i] == 0 or _is_deep(tiles, j, i):
                continue
            for y in range(TILE * j, min(TILE * (j + 1), h)):
                for x in range(TILE * i, min(TILE * (i + 1), w)):
                    if disparity[y, x] > np.float32(0.0):
                        continue
                    touches = False
                    for v in range(max(y - 1, 0), min(y + 2, h)):
                        for u in range(max(x - 1, 0), min(x + 2, w)):
                            touches |= disparity[v, u] > np.float32(0.0)
                    if touches:
                        rims[count] = index[y, x]
                        count += 1
    return count


@serial
def _mark_open_row(above: F32, row: F32, below: F32, step: float, found: U8) -> None:
    """found [w]: HOLE where nothing was drawn, SILHOUETTE where disparities bend by more than `step`."""
    w = row.shape[0]
    left, right = row[: w - 2], row[2:]
    for x in range(w):
        bend = abs(above[x] - row[x] - row[x] + below[x])
        found[x] |= np.uint8(SILHOUETTE) if bend > step else np.uint8(0)
        found[x] |= np.uint8(HOLE) if row[x] <= np.float32(0.0) else np.uint8(0)
    for x in range(w - 2):
        bend = abs(left[x] - row[x + 1] - row[x + 1] + right[x])
        found[x + 1] |= np.uint8(SILHOUETTE) if bend > step else np.uint8(0)


@parallel
def mark_open_tiles(disparity: F32, step: float, tiles: U8) -> None:
    """tiles [ceil(h / TILE), ceil(w / TILE)]: HOLE if a tile has a pixel where nothing was drawn, SILHOUETTE if
    disparities bend by more than `step` in it, or both.

    In such tiles a triangle may show between surfaces although its corners are behind them.
    """
    h, w = disparity.shape
    least = np.float32(step)
    for row in numba.prange(tiles.shape[0]):
        j = int(np.int64(row))
        found = np.zeros(w, np.uint8)
        for y in range(TILE * j, min(TILE * (j + 1), h)):
            _mark_open_row(disparity[max(y - 1, 0)], disparity[y], disparity[min(y + 1, h - 1)], least, found)
        _by_tile(found, tiles[j])

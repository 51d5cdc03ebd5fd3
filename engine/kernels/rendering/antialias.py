"""Anti-aliasing of silhouettes only: their pixels are averaged from a canvas of twice the size.

`marks` uint8 [h, w] is 1 for these pixels; a fine plane is [2 h, 2 w] and has four samples for each pixel.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, U8
from ..base.jit import inlined, parallel

__all__ = ["average_marked", "keep_marked", "mark_silhouettes", "mark_tiles"]


@inlined
def _bends(before: float, here: float, after: float, step: float) -> bool:
    """Whether three drawn disparities bend by more than `step`; a straight slope is not a silhouette."""
    return before > 0.0 and after > 0.0 and abs(before - 2.0 * here + after) > step


@parallel
def mark_silhouettes(disparity: F32, step: float, marks: U8) -> None:
    """Mark drawn pixels at silhouettes: disparity [h, w] bends by more than `step` between the pixel and its neighbours
    left and right, or above and below."""
    h, w = disparity.shape
    for row in numba.prange(h):
        y = np.int64(row)
        for x in range(w):
            q, found = disparity[y, x], False
            if q > 0.0:
                found = 0 < x < w - 1 and _bends(disparity[y, x - 1], q, disparity[y, x + 1], step)
                found |= 0 < y < h - 1 and _bends(disparity[y - 1, x], q, disparity[y + 1, x], step)
            marks[y, x] = found


@parallel
def mark_tiles(marks: U8, side: int, tiles: U8) -> None:
    """tiles: 1 if one of a tile's side x side pixels is marked."""
    h, w = marks.shape
    for row in numba.prange(tiles.shape[0]):
        j = np.int64(row)
        tiles[j] = 0
        for y in range(side * j, min(side * (j + 1), h)):
            for x in range(w):
                if marks[y, x]:
                    tiles[j, x // side] = 1


@parallel
def keep_marked(marks: U8, fine: F32) -> None:
    """Clear the samples of a fine plane for pixels that are not marked."""
    for row in numba.prange(fine.shape[0]):
        y = np.int64(row)
        for x in range(fine.shape[1]):
            if not marks[y // 2, x // 2]:
                fine[y, x] = 0.0


@parallel
def average_marked(
    marks: U8, drawn: F32, fine_luma: F32, fine_b: F32, fine_r: F32, luma: F32, chroma_b: F32, chroma_r: F32
) -> None:
    """Sets marked pixels to the mean of those of their four samples that were drawn (disparity `drawn` > 0)."""
    h, w = marks.shape
    for row in numba.prange(h):
        j = np.int64(row)
        for i in range(w):
            if not marks[j, i]:
                continue
            n, sum_y, sum_b, sum_r = 0, 0.0, 0.0, 0.0
            for k in range(4):
                y, x = 2 * j + k // 2, 2 * i + k % 2
                if drawn[y, x] > 0.0:
                    n += 1
                    sum_y += fine_luma[y, x]
                    sum_b += fine_b[y, x]
                    sum_r += fine_r[y, x]
            if n > 0:
                luma[j, i], chroma_b[j, i], chroma_r[j, i] = sum_y / n, sum_b / n, sum_r / n

"""Disocclusion filling (paper section 3.4.3) and packing of the finished picture.

Filling uses a pyramid (push-pull): each level's cells average the known cells of the finer level, farther surfaces
weighted more; then, from the coarsest level back, missing cells are taken from the coarser one. Narrow holes get their
neighbours' colours, wide ones smooth colours, in time proportional to the picture.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, I32, U8, U16
from ..base.jit import inlined, parallel, serial

__all__ = [
    "CELL",
    "fade_into_smooth",
    "first_level",
    "next_level",
    "pack_420",
    "refine_level",
]


MIXED = 1e-3  # weight (others: 1) of a pixel whose colour may be mixed with that of the surface that hides a hole
UNKNOWN = -1.0  # weight of a cell that is unknown and not needed
CELL = 4  # side of the pyramid's finest cells, pixels


@parallel
def first_level(
    disparity: F32, luma: F32, chroma_b: F32, chroma_r: F32, near: U8, block: int, level: F32
) -> None:
    """level [ceil(h / CELL), ceil(w / CELL), 5] from the picture: weight, disparity and colour of each cell.

    near [rows, columns]: 1 for needed blocks of block x block cells; cells of the others get the weight UNKNOWN.

    disparity [h, w]: in holes, minus the disparity of the hidden surface that continues there, so that the rims of the
    surface in front count little; minus infinity where nothing hides it.

    In a cell of a single surface, only one pixel in each row and column is read, as the level only serves smooth
    colours.
    """
    h, w = disparity.shape
    for j in numba.prange(level.shape[0]):
        for i in range(level.shape[1]):
            top, left = CELL * np.int64(j), CELL * i
            if not near[np.int64(j) // block, i // block]:
                level[j, i, 0], level[j, i, 1] = UNKNOWN, np.inf
                continue
            whole = top + CELL <= h and left + CELL <= w
            if not (whole and _average(disparity, luma, chroma_b, chroma_r, top, left, level[j, i])):
                _weigh(disparity, luma, chroma_b, chroma_r, top, left, level[j, i])


@inlined
def _average(disparity: F32, luma: F32, chroma_b: F32, chroma_r: F32, top: int, left: int, cell: F32) -> bool:
    """cell [5] of one surface, from one pixel in each row and column; False if it has holes or several surfaces."""
    a, b, c, d = left + 1, left + 3, left, left + 2
    qa, qb, qc, qd = disparity[top, a], disparity[top + 1, b], disparity[top + 2, c], disparity[top + 3, d]
    farthest = min(min(qa, qb), min(qc, qd))
    if not farthest > np.float32(0.95) * max(max(qa, qb), max(qc, qd)):
        return False
    quarter = np.float32(0.25)
    cell[0], cell[1] = 1.0, farthest
    cell[2] = quarter * (luma[top, a] + luma[top + 1, b] + luma[top + 2, c] + luma[top + 3, d])
    cell[3] = quarter * (chroma_b[top, a] + chroma_b[top + 1, b] + chroma_b[top + 2, c] + chroma_b[top + 3, d])
    cell[4] = quarter * (chroma_r[top, a] + chroma_r[top + 1, b] + chroma_r[top + 2, c] + chroma_r[top + 3, d])
    return True


@inlined
def _beside_hidden(disparity: F32, y: int, x: int) -> bool:
    """Whether a pixel touches a hole that something hides: its colour may be mixed with that of the hiding surface."""
    h, w = disparity.shape
    a, b = disparity[max(y - 1, 0), x], disparity[min(y + 1, h - 1), x]
    c, d = disparity[y, max(x - 1, 0)], disparity[y, min(x + 1, w - 1)]
    return (-np.inf < a <= 0.0) or (-np.inf < b <= 0.0) or (-np.inf < c <= 0.0) or (-np.inf < d <= 0.0)


@serial
def _weigh(disparity: F32, luma: F32, chroma_b: F32, chroma_r: F32, top: int, left: int, cell: F32) -> None:
    """cell [5] from all of its pixels, farther surfaces weighted more."""
    bottom, right = min(top + CELL, disparity.shape[0]), min(left + CELL, disparity.shape[1])
    farthest = np.float32(np.inf)
    for y in range(top, bottom):
        for x in range(left, right):
            farthest = min(farthest, abs(disparity[y, x]))
    total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
    for y in range(top, bottom):
        for x in range(left, right):
            if disparity[y, x] > 0.0:
                share = _worth(disparity[y, x], farthest)
                share *= MIXED if _beside_hidden(disparity, y, x) else 1.0
                total += share
                sum_y += share * luma[y, x]
                sum_b += share * chroma_b[y, x]
                sum_r += share * chroma_r[y, x]
    _store(cell, total, farthest, sum_y, sum_b, sum_r)


@parallel
def next_level(fine: F32, level: F32) -> None:
    """The next coarser level of the pyramid."""
    h, w = fine.shape[0], fine.shape[1]
    for j in numba.prange(level.shape[0]):
        for i in range(level.shape[1]):
            farthest = np.float32(np.inf)
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    farthest = min(farthest, fine[y, x, 1])
            total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    if fine[y, x, 0] > 0.0:
                        share = fine[y, x, 0] * _worth(fine[y, x, 1], farthest)
                        total += share
                        sum_y += share * fine[y, x, 2]
                        sum_b += share * fine[y, x, 3]
                        sum_r += share * fine[y, x, 4]
            _store(level[j, i], total, farthest, sum_y, sum_b, sum_r)


@inlined
def _worth(q: float, farthest: float) -> float:
    """Weight of a surface of disparity q: farther surfaces, which continue behind nearer ones, get more."""
    ratio = farthest / q
    ratio *= ratio
    ratio *= ratio
    return ratio * ratio


@inlined
def _store(cell: F32, total: float, farthest: float, sum_y: float, sum_b: float, sum_r: float) -> None:
    inverse = 1.0 / total if total > 0.0 else 0.0
    cell[0], cell[1] = min(total, 1.0), farthest
    cell[2], cell[3], cell[4] = sum_y * inverse, sum_b * inverse, sum_r * inverse


@inlined
def _sample(coarse: F32, row: float, column: float) -> tuple[float, float, float]:
    """Colour between the four nearest cells of a level (their centres at whole numbers), farther surfaces weighted
    more."""
    j = min(max(math.floor(row), 0), max(coarse.shape[0] - 2, 0))
    i = min(max(math.floor(column), 0), max(coarse.shape[1] - 2, 0))
    nj, ni = min(j + 1, coarse.shape[0] - 1), min(i + 1, coarse.shape[1] - 1)
    fj, fi = min(max(row - j, 0.0), 1.0), min(max(column - i, 0.0), 1.0)
    qa, qb, qc, qd = coarse[j, i, 1], coarse[j, ni, 1], coarse[nj, i, 1], coarse[nj, ni, 1]
    farthest, one = min(min(qa, qb), min(qc, qd)), qa == qb and qb == qc and qc == qd
    total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        a, b = (nj if k & 1 else j), (ni if k & 2 else i)
        # Each cell gets at least a little, so that the result is defined if a single cell has a weight.
        share = (fj if k & 1 else 1.0 - fj) * (fi if k & 2 else 1.0 - fi) + 1e-6
        if not one:
            share *= max(_worth(coarse[a, b, 1], farthest), 1e-6)
        total += share
        sum_y += share * coarse[a, b, 2]
        sum_b += share * coarse[a, b, 3]
        sum_r += share * coarse[a, b, 4]
    return sum_y / total, sum_b / total, sum_r / total


@parallel
def refine_level(coarse: F32, fine: F32) -> None:
    """Complete a level from the coarser one, which is complete and supplies the weight that a cell lacks."""
    for j in numba.prange(fine.shape[0]):
        for i in range(fine.shape[1]):
            weight = fine[j, i, 0]
            if UNKNOWN < weight < 1.0:
                cy, cb, cr = _sample(coarse, 0.5 * np.int64(j) - 0.25, 0.5 * i - 0.25)
                fine[j, i, 2] = weight * fine[j, i, 2] + (1.0 - weight) * cy
                fine[j, i, 3] = weight * fine[j, i, 3] + (1.0 - weight) * cb
                fine[j, i, 4] = weight * fine[j, i, 4] + (1.0 - weight) * cr
                fine[j, i, 0] = 1.0
                if fine[j, i, 1] == np.inf:
                    fine[j, i, 1] = coarse[j // 2, i // 2, 1]


@parallel
def fade_into_smooth(
    places: I32, layer: I32, level: F32, fade: float, disparity: F32, luma: F32, chroma_b: F32, chroma_r: F32
) -> None:
    """Mix the structure that was continued into holes with the first level, which is complete.

    places [n, 2]: the holes' rows and columns. layer [h, w]: distance, in pixels from the rim, of holes with structure;
    0: none. At `fade` pixels both parts are equal. The holes' disparity becomes 0 again.
    """
    for n in numba.prange(places.shape[0]):
        y, x = np.int64(places[n, 0]), np.int64(places[n, 1])
        sum_y, sum_b, sum_r = _sample(level, (y + 0.5) / CELL - 0.5, (x + 0.5) / CELL - 0.5)
        if layer[y, x] > 0:
            share = 1.0 / (1.0 + (layer[y, x] / fade) ** 2)
            sum_y += share * (luma[y, x] - sum_y)
            sum_b += share * (chroma_b[y, x] - sum_b)
            sum_r += share * (chroma_r[y, x] - sum_r)
        disparity[y, x] = 0.0
        luma[y, x], chroma_b[y, x], chroma_r[y, x] = sum_y, sum_b, sum_r


@parallel
def pack_420(
    luma: F32, chroma_b: F32, chroma_r: F32, y_out: U16, cb_out: U16, cr_out: U16
) -> None:
    """Round to 10-bit codes, the chroma averaged over 2x2 pixels."""
    h, w = luma.shape
    for j in numba.prange((h + 1) // 2):
        y0, y1 = 2 * np.int64(j), min(2 * np.int64(j) + 1, h - 1)
        for y in range(y0, y1 + 1):
            row, out = luma[y], y_out[y]
            for x in range(w):
                out[x] = np.uint16(np.int32(row[x] + np.float32(0.5)))
        b0, b1, r0, r1 = chroma_b[y0], chroma_b[y1], chroma_r[y0], chroma_r[y1]
        for i in range(w // 2):
            x = 2 * i
            cb_out[j, i] = np.int32(np.float32(0.25) * (b0[x] + b0[x + 1] + b1[x] + b1[x + 1]) + np.float32(0.5))
            cr_out[j, i] = np.int32(np.float32(0.25) * (r0[x] + r0[x + 1] + r1[x] + r1[x + 1]) + np.float32(0.5))
        if w % 2:
            cb_out[j, w // 2] = np.int32(np.float32(0.5) * (b0[w - 1] + b1[w - 1]) + np.float32(0.5))
            cr_out[j, w // 2] = np.int32(np.float32(0.5) * (r0[w - 1] + r1[w - 1]) + np.float32(0.5))

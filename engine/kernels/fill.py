"""Disocclusion filling (paper section 3.4.3) and packing of the finished picture.

Filling goes over a pyramid: each level's cells average what is known of the finer level, farther surfaces first;
then, from the coarsest level back, what is missing is taken from the coarser one (push-pull). Narrow holes get
their neighbours' colours, wide ones something smooth, in time proportional to the picture.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

__all__ = [
    "CELL",
    "count_holes",
    "fill_holes",
    "first_level",
    "next_level",
    "next_level_serially",
    "pack_420",
    "refine_level",
    "refine_level_serially",
]

F32 = npt.NDArray[np.float32]
U16 = npt.NDArray[np.uint16]

CELL = 4  # pixels a side of the pyramid's finest cells
REACH = 32  # pixels within which a hole's rim is looked for


@numba.njit(cache=True, parallel=True, nogil=True)
def count_holes(disparity: F32, rows: npt.NDArray[np.int64]) -> None:
    """rows [h]: pixels of each row where nothing was drawn."""
    for y in numba.prange(disparity.shape[0]):
        n = 0
        for x in range(disparity.shape[1]):
            n += disparity[y, x] <= 0.0
        rows[y] = n


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def first_level(disparity: F32, luma: F32, chroma_b: F32, chroma_r: F32, level: F32) -> None:
    """level [ceil(h / CELL), ceil(w / CELL), 5] from the picture: weight, disparity and colour of each cell.

    Of a cell's pixels one in each row and column is looked at: the level only serves smooth colours.
    """
    h, w = disparity.shape
    for j in numba.prange(level.shape[0]):
        for i in range(level.shape[1]):
            farthest = np.float32(np.inf)
            for k in range(CELL):
                y, x = min(CELL * j + k, h - 1), min(CELL * i + (2 * k + 1) % (CELL + 1), w - 1)
                if disparity[y, x] > 0.0:
                    farthest = min(farthest, disparity[y, x])
            stride = 1
            if farthest == np.inf:  # in a hole: look at all of the cell's pixels
                stride = CELL
                for y in range(CELL * j, min(CELL * (j + 1), h)):
                    for x in range(CELL * i, min(CELL * (i + 1), w)):
                        if disparity[y, x] > 0.0:
                            farthest = min(farthest, disparity[y, x])
            total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
            for n in range(CELL * stride):
                if farthest == np.inf:
                    break
                k = n % CELL
                column = (2 * k + 1) % (CELL + 1) if stride == 1 else n // CELL
                y, x = min(CELL * j + k, h - 1), min(CELL * i + column, w - 1)
                if disparity[y, x] > 0.0:
                    share = _worth(disparity[y, x], farthest)
                    total += share
                    sum_y += share * luma[y, x]
                    sum_b += share * chroma_b[y, x]
                    sum_r += share * chroma_r[y, x]
            _store(level, j, i, total, farthest, sum_y, sum_b, sum_r)


def _next_level(fine: F32, level: F32) -> None:
    """The next coarser level of the pyramid."""
    h, w = fine.shape[0], fine.shape[1]
    for j in numba.prange(level.shape[0]):
        for i in range(level.shape[1]):
            farthest = np.float32(np.inf)
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    if fine[y, x, 0] > 0.0:
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
            _store(level, j, i, total, farthest, sum_y, sum_b, sum_r)


# One thread is quicker for the coarser levels.
next_level = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")(_next_level)
next_level_serially = numba.njit(cache=True, nogil=True, error_model="numpy")(_next_level)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _worth(q: float, farthest: float) -> float:
    """Weight of a surface: the farther continues behind the nearer."""
    ratio = farthest / q
    ratio *= ratio
    ratio *= ratio
    return ratio * ratio


@numba.njit(inline="always", cache=True, error_model="numpy")
def _store(
    level: F32, j: int, i: int, total: float, farthest: float, sum_y: float, sum_b: float, sum_r: float
) -> None:
    inverse = 1.0 / total if total > 0.0 else 0.0
    level[j, i, 0], level[j, i, 1] = min(total, 1.0), farthest
    level[j, i, 2], level[j, i, 3], level[j, i, 4] = sum_y * inverse, sum_b * inverse, sum_r * inverse


@numba.njit(inline="always", cache=True, error_model="numpy")
def _sample(coarse: F32, row: float, column: float) -> tuple[float, float, float, float]:
    """Colour between the four nearest cells of a level (their centres at whole numbers), farther surfaces first, and
    the farthest of their disparities."""
    j = min(max(math.floor(row), 0), max(coarse.shape[0] - 2, 0))
    i = min(max(math.floor(column), 0), max(coarse.shape[1] - 2, 0))
    nj, ni = min(j + 1, coarse.shape[0] - 1), min(i + 1, coarse.shape[1] - 1)
    fj, fi = min(max(row - j, 0.0), 1.0), min(max(column - i, 0.0), 1.0)
    farthest = min(min(coarse[j, i, 1], coarse[j, ni, 1]), min(coarse[nj, i, 1], coarse[nj, ni, 1]))
    total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        a, b = (nj if k & 1 else j), (ni if k & 2 else i)
        # A little of every cell, so that one of any disparity stands alone where its weight is all there is.
        share = (fj if k & 1 else 1.0 - fj) * (fi if k & 2 else 1.0 - fi) + 1e-6
        share *= max(_worth(coarse[a, b, 1], farthest), 1e-6)
        total += share
        sum_y += share * coarse[a, b, 2]
        sum_b += share * coarse[a, b, 3]
        sum_r += share * coarse[a, b, 4]
    return sum_y / total, sum_b / total, sum_r / total, farthest


def _refine_level(coarse: F32, fine: F32) -> None:
    """Complete a level from the coarser one, which is complete: what a cell lacks in weight comes from there."""
    for j in numba.prange(fine.shape[0]):
        for i in range(fine.shape[1]):
            weight = fine[j, i, 0]
            if weight < 1.0:
                cy, cb, cr, _ = _sample(coarse, 0.5 * np.int64(j) - 0.25, 0.5 * i - 0.25)
                fine[j, i, 2] = weight * fine[j, i, 2] + (1.0 - weight) * cy
                fine[j, i, 3] = weight * fine[j, i, 3] + (1.0 - weight) * cb
                fine[j, i, 4] = weight * fine[j, i, 4] + (1.0 - weight) * cr
                if weight == 0.0:
                    fine[j, i, 0], fine[j, i, 1] = 1.0, coarse[j // 2, i // 2, 1]


# One thread is quicker for the coarser levels.
refine_level = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")(_refine_level)
refine_level_serially = numba.njit(cache=True, nogil=True, error_model="numpy")(_refine_level)


@numba.njit(inline="always", cache=True)
def _direction(k: int) -> tuple[int, int]:
    """Step (row, column) to the left, right, up or down."""
    if k < 2:
        return 0, (-1 if k == 0 else 1)
    return (-1 if k == 2 else 1), 0


@numba.njit(inline="always", cache=True)
def _drawn_along(disparity: F32, y: int, x: int, dy: int, dx: int) -> int:
    """Steps from a hole pixel to the next drawn one in a direction, 0 where there is none within REACH."""
    h, w = disparity.shape
    for step in range(1, REACH + 1):
        y += dy
        x += dx
        if y < 0 or x < 0 or y >= h or x >= w:
            return 0
        if disparity[y, x] > 0.0:
            return step
    return 0


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def fill_holes(
    disparity: F32, level: F32, fade: float, luma: F32, chroma_b: F32, chroma_r: F32
) -> None:
    """Colour every hole pixel: near its rim from the next drawn pixels left, right, up and down (structure goes
    on), farther in from the first level, which is complete; half each at `fade` pixels."""
    h, w = disparity.shape
    for row in numba.prange(h):
        y = np.int64(row)
        for x in range(w):
            if disparity[y, x] > 0.0:
                continue
            farthest, nearest = np.inf, REACH + 1
            for k in range(4):
                dy, dx = _direction(k)
                step = _drawn_along(disparity, y, x, dy, dx)
                if step > 0:
                    farthest = min(farthest, disparity[y + step * dy, x + step * dx])
                    nearest = min(nearest, step)
            sum_y, sum_b, sum_r, beyond = _sample(level, (y + 0.5) / CELL - 0.5, (x + 0.5) / CELL - 0.5)
            if farthest < np.inf:
                share, rim_y, rim_b, rim_r = 0.0, 0.0, 0.0, 0.0
                for k in range(4):
                    dy, dx = _direction(k)
                    step = _drawn_along(disparity, y, x, dy, dx)
                    if step > 0:
                        ny, nx = y + step * dy, x + step * dx
                        weight = _worth(disparity[ny, nx], farthest) / (step * step)
                        share += weight
                        rim_y += weight * luma[ny, nx]
                        rim_b += weight * chroma_b[ny, nx]
                        rim_r += weight * chroma_r[ny, nx]
                # A rim that is nearer than what lies about is the edge of what hides it.
                own = _worth(farthest, min(farthest, beyond))
                smooth = (nearest / fade) ** 2
                rim, smooth = own / ((own + smooth) * share), smooth / (own + smooth)
                sum_y = smooth * sum_y + rim * rim_y
                sum_b = smooth * sum_b + rim * rim_b
                sum_r = smooth * sum_r + rim * rim_r
            luma[y, x], chroma_b[y, x], chroma_r[y, x] = sum_y, sum_b, sum_r


@numba.njit(cache=True, parallel=True, nogil=True)
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

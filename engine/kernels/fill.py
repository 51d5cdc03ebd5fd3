"""Disocclusion filling (paper section 3.4.3) and packing of the finished picture.

Filling goes over a pyramid: each level's cells average what is known of the finer level, farther surfaces first;
then, from the coarsest level back, what is missing is taken from the coarser one (push-pull). Narrow holes get
their neighbours' colours, wide ones something smooth, in time proportional to the picture.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["count_holes", "fill_holes", "first_level", "nearest_in_columns", "next_level", "pack_420", "refine_level"]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
U16 = npt.NDArray[np.uint16]


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
    """level [ceil(h / 2), ceil(w / 2), 5] from the picture: weight, disparity and colour of each 2x2 cell."""
    h, w = disparity.shape
    for j in numba.prange(level.shape[0]):
        for i in range(level.shape[1]):
            farthest = np.float32(np.inf)
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    if disparity[y, x] > 0.0:
                        farthest = min(farthest, disparity[y, x])
            total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    if disparity[y, x] > 0.0:
                        share = _worth(disparity[y, x], farthest)
                        total += share
                        sum_y += share * luma[y, x]
                        sum_b += share * chroma_b[y, x]
                        sum_r += share * chroma_r[y, x]
            _store(level, j, i, total, farthest, sum_y, sum_b, sum_r)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def next_level(fine: F32, level: F32) -> None:
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
def _sample(coarse: F32, y: int, x: int) -> tuple[float, float, float]:
    """Colour between the four nearest cells of a coarser level, farther surfaces first."""
    j, i = y // 2, x // 2
    nj = min(max(j + (1 if y % 2 else -1), 0), coarse.shape[0] - 1)
    ni = min(max(i + (1 if x % 2 else -1), 0), coarse.shape[1] - 1)
    farthest = min(min(coarse[j, i, 1], coarse[j, ni, 1]), min(coarse[nj, i, 1], coarse[nj, ni, 1]))
    total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        a, b = (nj if k & 1 else j), (ni if k & 2 else i)
        if coarse[a, b, 0] > 0.0:
            share = (0.25 if k & 1 else 0.75) * (0.25 if k & 2 else 0.75) * _worth(coarse[a, b, 1], farthest)
            total += share
            sum_y += share * coarse[a, b, 2]
            sum_b += share * coarse[a, b, 3]
            sum_r += share * coarse[a, b, 4]
    return sum_y / total, sum_b / total, sum_r / total


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def refine_level(coarse: F32, fine: F32) -> None:
    """Complete a level from the coarser one, which is complete: what a cell lacks in weight comes from there."""
    for j in numba.prange(fine.shape[0]):
        for i in range(fine.shape[1]):
            weight = fine[j, i, 0]
            if weight < 1.0:
                cy, cb, cr = _sample(coarse, j, i)
                fine[j, i, 2] = weight * fine[j, i, 2] + (1.0 - weight) * cy
                fine[j, i, 3] = weight * fine[j, i, 3] + (1.0 - weight) * cb
                fine[j, i, 4] = weight * fine[j, i, 4] + (1.0 - weight) * cr
                if weight == 0.0:
                    fine[j, i, 0], fine[j, i, 1] = 1.0, coarse[j // 2, i // 2, 1]


@numba.njit(cache=True, parallel=True, nogil=True)
def nearest_in_columns(disparity: F32, above: I32, below: I32) -> None:
    """above, below [h, w]: the row of the next drawn pixel up and down each column, -1 where there is none."""
    h, w = disparity.shape
    strips = 16
    for strip in numba.prange(strips):
        x0, x1 = strip * w // strips, (strip + 1) * w // strips
        for y in range(h):
            for x in range(x0, x1):
                above[y, x] = y if disparity[y, x] > 0.0 else (above[y - 1, x] if y > 0 else -1)
        for y in range(h - 1, -1, -1):
            for x in range(x0, x1):
                below[y, x] = y if disparity[y, x] > 0.0 else (below[y + 1, x] if y + 1 < h else -1)


@numba.njit(inline="always", cache=True)
def _neighbour(k: int, x: int, y: int, left: int, right: int, up: int, down: int) -> tuple[int, int]:
    """Row and column of the k-th neighbour: left, right, up, down."""
    if k < 2:
        return y, (left if k == 0 else right)
    return (up if k == 2 else down), x


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def fill_holes(
    disparity: F32, above: I32, below: I32, level: F32, reach: float, luma: F32, chroma_b: F32, chroma_r: F32
) -> None:
    """Colour every hole pixel: near its rim from the next drawn pixels left, right, up and down (structure goes
    on), farther in from the first level, which is complete; half each at `reach` pixels."""
    h, w = disparity.shape
    for row in numba.prange(h):
        y = np.int64(row)
        left, right = np.int64(-1), np.int64(-1)
        for x in range(w):
            if disparity[y, x] > 0.0:
                left = x
                continue
            if right <= x:
                right = x + 1
                while right < w and disparity[y, right] <= 0.0:
                    right += 1
            up, down = np.int64(above[y, x]), np.int64(below[y, x])
            farthest, nearest = np.inf, 1 << 30
            for k in range(4):
                ny, nx = _neighbour(k, x, y, left, right, up, down)
                if 0 <= nx < w and ny >= 0:
                    farthest = min(farthest, disparity[ny, nx])
                    nearest = min(nearest, abs(ny - y) + abs(nx - x))
            sum_y, sum_b, sum_r = _sample(level, y, x)
            total = (nearest / reach) ** 2
            sum_y, sum_b, sum_r = sum_y * total, sum_b * total, sum_r * total
            if farthest < np.inf:
                share = 0.0
                streak_y, streak_b, streak_r = 0.0, 0.0, 0.0
                for k in range(4):
                    ny, nx = _neighbour(k, x, y, left, right, up, down)
                    if 0 <= nx < w and ny >= 0:
                        distance = abs(ny - y) + abs(nx - x)
                        weight = _worth(disparity[ny, nx], farthest) / (distance * distance)
                        share += weight
                        streak_y += weight * luma[ny, nx]
                        streak_b += weight * chroma_b[ny, nx]
                        streak_r += weight * chroma_r[ny, nx]
                sum_y += streak_y / share
                sum_b += streak_b / share
                sum_r += streak_r / share
                total += 1.0
            luma[y, x], chroma_b[y, x], chroma_r[y, x] = sum_y / total, sum_b / total, sum_r / total


@numba.njit(cache=True, parallel=True, nogil=True)
def pack_420(
    luma: F32, chroma_b: F32, chroma_r: F32, y_out: U16, cb_out: U16, cr_out: U16
) -> None:
    """Round to 10-bit codes, the chroma averaged over 2x2 pixels."""
    h, w = luma.shape
    for j in numba.prange((h + 1) // 2):
        for i in range((w + 1) // 2):
            n, b, r = 0, 0.0, 0.0
            for y in range(2 * j, min(2 * j + 2, h)):
                for x in range(2 * i, min(2 * i + 2, w)):
                    y_out[y, x] = np.uint16(luma[y, x] + 0.5)
                    b += chroma_b[y, x]
                    r += chroma_r[y, x]
                    n += 1
            cb_out[j, i] = np.uint16(b / n + 0.5)
            cr_out[j, i] = np.uint16(r / n + 0.5)

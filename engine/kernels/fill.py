"""Disocclusion filling (paper section 3.4.3) and packing of the finished picture."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["count_holes", "fill_holes", "nearest_in_columns", "pack_420"]

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


@numba.njit(inline="always", cache=True, error_model="numpy")
def _worth(q: float, distance: int, farthest: float) -> float:
    """Weight of a neighbour: farther surfaces continue behind nearer ones, and closeness counts."""
    relative = farthest / q  # 1 for the farthest neighbour, smaller for nearer surfaces
    return relative**8 / (distance * distance)


@numba.njit(inline="always", cache=True)
def _neighbour(k: int, x: int, y: int, left: int, right: int, up: int, down: int) -> tuple[int, int]:
    """Row and column of the k-th neighbour: left, right, up, down."""
    if k < 2:
        return y, (left if k == 0 else right)
    return (up if k == 2 else down), x


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def fill_holes(
    disparity: F32, above: I32, below: I32, radius: int, luma: F32, chroma_b: F32, chroma_r: F32
) -> None:
    """Colour every hole pixel from the next drawn pixels left, right, up and down, the farther ones first.

    Neighbours beyond `radius` pixels count only where there is none within it.
    """
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
            total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
            for k in range(4):
                ny, nx = _neighbour(k, x, y, left, right, up, down)
                distance = abs(ny - y) + abs(nx - x)
                if 0 <= nx < w and ny >= 0 and distance <= max(radius, nearest):
                    weight = _worth(disparity[ny, nx], distance, farthest)
                    total += weight
                    sum_y += weight * luma[ny, nx]
                    sum_b += weight * chroma_b[ny, nx]
                    sum_r += weight * chroma_r[ny, nx]
            if total > 0.0:
                luma[y, x] = sum_y / total
                chroma_b[y, x] = sum_b / total
                chroma_r[y, x] = sum_r / total


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

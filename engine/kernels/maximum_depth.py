"""One camera's maximum depth image, updated in place by the camera's new view (section 3.3.3)."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["TILE", "farther_than", "mark_provisional", "update_maximum_depth"]

TILE = 64  # columns that are compared at once before any is written; even, for the 2x2 of the chroma planes

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
I64 = npt.NDArray[np.int64]


@numba.njit(inline="always", cache=True, error_model="numpy")
def farther_than(
    code: int, offset: float, step: float, has_invalid: bool, margin_m: float, margin_disparity: float
) -> float:
    """The code below which a surface is farther than `code` by a nontrivial amount: both margins are exceeded."""
    if has_invalid and code == 0:
        return np.float32(math.inf)
    disparity = offset + step * np.float32(code)
    limit = min(disparity / (np.float32(1.0) + margin_m * disparity), disparity - margin_disparity)
    return (limit - offset) / step


@numba.njit(inline="always", cache=True)
def _beside_nearer(codes: U16, row: int, x: int, edge: int) -> bool:
    """Whether one of the eight neighbours is nearer by more than a depth edge: colours mix there."""
    limit = int(codes[row, x]) + edge
    for y in range(max(row - 1, 0), min(row + 2, codes.shape[0])):
        for u in range(max(x - 1, 0), min(x + 2, codes.shape[1])):
            if codes[y, u] > limit:
                return True
    return False


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_provisional(codes: U16, edge: int, provisional: U8) -> None:
    """Sets provisional [h, w] to 1 where a pixel's colour may be mixed with that of something nearer, else 0."""
    for row in numba.prange(codes.shape[0]):
        for x in range(codes.shape[1]):
            provisional[row, x] = _beside_nearer(codes, row, x, edge)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def update_maximum_depth(
    new_codes: U16, new_y: U16, new_cb: U16, new_cr: U16,
    codes: U16, y: U16, cb: U16, cr: U16, updated: U8, provisional: U8, counts: I64,
    offset: float, step: float, has_invalid: bool, margin_m: float, margin_disparity: float, edge: int,
) -> None:  # fmt: skip
    """Takes over depth and colour where the new view is farther by a nontrivial amount, or sees something first.

    codes, y, updated, provisional [h, w]; cb, cr [(h + 1) // 2, (w + 1) // 2]; counts [(h + 1) // 2]: pixels
    updated per pair of rows. `updated` is set to 1 there and never cleared. A provisional colour is replaced as
    soon as the same surface is seen away from depth edges (steps of more than `edge` codes).
    """
    h, w = codes.shape
    lowest = 1 if has_invalid else 0
    offset_, step_ = np.float32(offset), np.float32(step)
    metres, disparity = np.float32(margin_m), np.float32(margin_disparity)
    for pair in numba.prange((h + 1) // 2):
        count = 0
        for x0 in range(0, w, TILE):
            x1 = min(x0 + TILE, w)
            found = 0
            for row in range(2 * pair, min(2 * pair + 2, h)):
                for x in range(x0, x1):  # no branches: this loop is vectorised, and is all that most tiles need
                    limit = farther_than(codes[row, x], offset_, step_, has_invalid, metres, disparity)
                    found |= (np.float32(new_codes[row, x]) < limit) & (new_codes[row, x] >= lowest)
                    found |= provisional[row, x] != 0
            if found:
                for x in range(x0, x1, 2):
                    count += _update_quad(
                        pair, x, new_codes, new_y, new_cb, new_cr, codes, y, cb, cr, updated, provisional,
                        offset_, step_, has_invalid, lowest, metres, disparity, edge,
                    )  # fmt: skip
        counts[pair] = count


@numba.njit(inline="always", cache=True, error_model="numpy")
def _update_quad(
    pair: int, x0: int, new_codes: U16, new_y: U16, new_cb: U16, new_cr: U16,
    codes: U16, y: U16, cb: U16, cr: U16, updated: U8, provisional: U8,
    offset: float, step: float, has_invalid: bool, lowest: int, metres: float, disparity: float, edge: int,
) -> int:  # fmt: skip
    """The 2x2 pixels that share one chroma sample; returns how many of them were updated."""
    h, w = codes.shape
    count, coloured, foreground = 0, 0, 0
    for row in range(2 * pair, min(2 * pair + 2, h)):
        for x in range(x0, min(x0 + 2, w)):
            new, old = new_codes[row, x], codes[row, x]
            if new < lowest:
                continue
            if new < farther_than(old, offset, step, has_invalid, metres, disparity):
                codes[row, x] = new
                y[row, x] = new_y[row, x]
                updated[row, x] = 1
                provisional[row, x] = _beside_nearer(new_codes, row, x, edge)
                count += 1
                coloured += 1
            elif old < farther_than(new, offset, step, has_invalid, metres, disparity):
                foreground += 1
            elif provisional[row, x] != 0 and not _beside_nearer(new_codes, row, x, edge):
                y[row, x] = new_y[row, x]
                provisional[row, x] = 0
                coloured += 1
    # A sample that is partly of something nearer waits until that has moved on too.
    if coloured > 0 and foreground == 0:
        cb[pair, x0 // 2] = new_cb[pair, x0 // 2]
        cr[pair, x0 // 2] = new_cr[pair, x0 // 2]
    return count

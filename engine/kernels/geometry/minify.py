"""Minification: a view at half its size, in which each texel is the mean over one surface.

Of every 2x2 texels, those are averaged that are connected with the nearest one without a cut between. So a surface in
front keeps its width and its colour, and a surface behind keeps the texels that are its own. A mask has a bit for each
averaged texel: 1 and 2 for the upper two, 4 and 8 for the lower two.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import U8, U16
from ..base.jit import inlined, parallel, serial
from .cuts import CUT_DOWN, CUT_RIGHT

__all__ = ["ALL", "halve_codes", "halve_plane"]

ALL = 15  # the mask of four texels of one surface


@serial
def _connected(mask: int, top: int, bottom: int, left: int, right: int) -> int:
    """The mask of the texels that are connected with those of a mask; top, bottom, left and right: whether these sides
    of the square of texel centres are cut."""
    for _ in range(2):  # the farthest texel is two sides away
        mask |= 0 if top else ((mask & 1) << 1) | ((mask & 2) >> 1)
        mask |= 0 if bottom else ((mask & 4) << 1) | ((mask & 8) >> 1)
        mask |= 0 if left else ((mask & 1) << 2) | ((mask & 4) >> 2)
        mask |= 0 if right else ((mask & 2) << 2) | ((mask & 8) >> 2)
    return mask


@serial
def _of_nearest(codes: U16, cuts: U8, y: int, x: int) -> int:
    """The mask of the texels connected with the nearest of the 2x2 texels at (y, x)."""
    a, b, c, d = codes[y, x], codes[y, x + 1], codes[y + 1, x], codes[y + 1, x + 1]
    nearest = max(max(a, b), max(c, d))
    first = 1 if a == nearest else 2 if b == nearest else 4 if c == nearest else 8
    top, bottom = cuts[y, x] & CUT_RIGHT, cuts[y + 1, x] & CUT_RIGHT
    left, right = cuts[y, x] & CUT_DOWN, cuts[y, x + 1] & CUT_DOWN
    return _connected(first, top, bottom, left, right)


@inlined
def _mean(a: int, b: int, c: int, d: int, mask: int) -> int:
    i, j, k, m = mask & 1, (mask >> 1) & 1, (mask >> 2) & 1, mask >> 3
    count = i + j + k + m
    return (i * a + j * b + k * c + m * d + (count >> 1)) // count


@parallel
def halve_plane(plane: U16, masks: U8, out: U16) -> None:
    """Fill out [h, w] with the means of the samples of a plane [2 h, 2 w] that are in the masks [h, w]."""
    h, w = out.shape
    for row in numba.prange(h):
        y = 2 * int(np.int64(row))
        for x in range(w):  # vectorises; texels over several surfaces are corrected after it
            a, b = np.int32(plane[y, 2 * x]), np.int32(plane[y, 2 * x + 1])
            c, d = np.int32(plane[y + 1, 2 * x]), np.int32(plane[y + 1, 2 * x + 1])
            out[row, x] = (a + b + c + d + np.int32(2)) >> np.int32(2)
        for x in range(w):
            if masks[row, x] != ALL:
                out[row, x] = _mean(
                    np.int64(plane[y, 2 * x]), np.int64(plane[y, 2 * x + 1]),
                    np.int64(plane[y + 1, 2 * x]), np.int64(plane[y + 1, 2 * x + 1]), np.int64(masks[row, x]),
                )  # fmt: skip


@parallel
def halve_codes(codes: U16, cuts: U8, out: U16, masks: U8) -> None:
    """Fill out and masks [h, w] from depth codes and cuts [2 h, 2 w] (flags of `cuts.mark_broken`).

    A code is the mean over the texels of the mask, because disparity is linear over a plane. Four texels without depth
    result in one without.
    """
    h, w = out.shape
    for row in numba.prange(h):
        y = 2 * int(np.int64(row))
        for x in range(w):
            left, right, below = cuts[y, 2 * x], cuts[y, 2 * x + 1], cuts[y + 1, 2 * x]
            whole = ((left & (CUT_RIGHT | CUT_DOWN)) | (right & CUT_DOWN) | (below & CUT_RIGHT)) == 0
            masks[row, x] = ALL if whole else _of_nearest(codes, cuts, y, 2 * x)
    halve_plane(codes, masks, out)

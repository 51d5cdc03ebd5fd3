"""Tone: an affine change of colour codes, luma by itself and each chroma with some of the luma.

A packed tone is float64 [TONE_SIZE] over 10-bit codes:
y' = t[0] y + t[1], cb' = t[2] cb + t[3] y + t[4], cr' = t[5] cr + t[6] y + t[7].
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, U16
from .jit import inlined, parallel

__all__ = ["IDENTITY", "LARGEST", "TONE_SIZE", "mean_luma", "tone_picture", "toned", "toned_code"]

TONE_SIZE = 8
IDENTITY = (1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
LARGEST = 1023.0  # code


@inlined
def toned(tone: F64, y: float, cb: float, cr: float) -> tuple[float, float, float]:
    """A colour in another tone, not limited to what codes can hold."""
    return tone[0] * y + tone[1], tone[2] * cb + tone[3] * y + tone[4], tone[5] * cr + tone[6] * y + tone[7]


@inlined
def toned_code(gain: float, code: float, offset: float) -> int:
    """gain * code + offset as the nearest code."""
    return int(min(max(gain * code + offset, 0.0), LARGEST) + 0.5)


@inlined
def mean_luma(y: U16, row: int, x: int) -> float:
    """Mean of the 2x2 pixels at an even row and column, which share a chroma sample."""
    below, right = min(row + 1, y.shape[0] - 1), min(x + 1, y.shape[1] - 1)
    return 0.25 * (int(y[row, x]) + int(y[row, right]) + int(y[below, x]) + int(y[below, right]))


@parallel
def tone_picture(tone: F64, y: U16, cb: U16, cr: U16, out_y: U16, out_cb: U16, out_cr: U16) -> None:
    """Write a 4:2:0 picture in another tone; the luma of a chroma sample is the mean of its pixels."""
    h, w = y.shape
    for pair in numba.prange((h + 1) // 2):
        for x in range((w + 1) // 2):
            luma = mean_luma(y, 2 * np.int64(pair), 2 * x)
            out_cb[pair, x] = toned_code(tone[2], cb[pair, x], tone[3] * luma + tone[4])
            out_cr[pair, x] = toned_code(tone[5], cr[pair, x], tone[6] * luma + tone[7])
        for row in range(2 * np.int64(pair), min(2 * np.int64(pair) + 2, h)):
            for x in range(w):
                out_y[row, x] = toned_code(tone[0], y[row, x], tone[1])

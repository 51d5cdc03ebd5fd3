"""Tone: an affine map of colour codes. Luma is mapped by itself; each chroma gets a share of the luma.

A packed tone is float64 [TONE_SIZE] over 10-bit codes:
y' = Y_GAIN y + Y_OFFSET, cb' = CB_GAIN cb + CB_FROM_Y y + CB_OFFSET, cr' = CR_GAIN cr + CR_FROM_Y y + CR_OFFSET.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, U16
from .jit import inlined, parallel

__all__ = [
    "CB_FROM_Y",
    "CB_GAIN",
    "CB_OFFSET",
    "CR_FROM_Y",
    "CR_GAIN",
    "CR_OFFSET",
    "IDENTITY",
    "LARGEST",
    "TONE_SIZE",
    "Y_GAIN",
    "Y_OFFSET",
    "mean_luma",
    "tone_picture",
    "toned",
    "toned_code",
]

Y_GAIN, Y_OFFSET, CB_GAIN, CB_FROM_Y, CB_OFFSET, CR_GAIN, CR_FROM_Y, CR_OFFSET = range(8)
TONE_SIZE = 8
IDENTITY = (1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
LARGEST = 1023.0  # code


@inlined
def toned(tone: F64, y: float, cb: float, cr: float) -> tuple[float, float, float]:
    """A colour with a tone applied, not clipped to the range of codes."""
    return (
        tone[Y_GAIN] * y + tone[Y_OFFSET],
        tone[CB_GAIN] * cb + tone[CB_FROM_Y] * y + tone[CB_OFFSET],
        tone[CR_GAIN] * cr + tone[CR_FROM_Y] * y + tone[CR_OFFSET],
    )


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
    """Write a 4:2:0 picture with a tone applied; the luma for a chroma sample is the mean of its pixels."""
    h, w = y.shape
    for pair in numba.prange((h + 1) // 2):
        for x in range((w + 1) // 2):
            luma = mean_luma(y, 2 * np.int64(pair), 2 * x)
            out_cb[pair, x] = toned_code(tone[CB_GAIN], cb[pair, x], tone[CB_FROM_Y] * luma + tone[CB_OFFSET])
            out_cr[pair, x] = toned_code(tone[CR_GAIN], cr[pair, x], tone[CR_FROM_Y] * luma + tone[CR_OFFSET])
        for row in range(2 * np.int64(pair), min(2 * np.int64(pair) + 2, h)):
            for x in range(w):
                out_y[row, x] = toned_code(tone[Y_GAIN], y[row, x], tone[Y_OFFSET])

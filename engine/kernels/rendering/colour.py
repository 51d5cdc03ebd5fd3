"""Colour: BT.709 limited-range 10-bit Y'CbCr 4:2:0 to and from 8-bit RGB, and to the planes for JPEG."""

from __future__ import annotations

import numpy as np

from ...support.array_types import U8, U16
from ..base.jit import inlined, serial

__all__ = ["jpeg_planes", "rgb_from_ycbcr", "ycbcr_from_rgb"]


LUMA_709 = (0.2126, 0.7152, 0.0722)
LUMA_601 = (0.299, 0.587, 0.114)
BLACK, WHITE, GREY, SWING = 64, 940, 512, 896  # 10-bit limited range

# Chroma (in units where 1 is the full swing) to the colour differences R - Y and B - Y.
RED_709 = 2.0 * (1.0 - LUMA_709[0])
BLUE_709 = 2.0 * (1.0 - LUMA_709[2])
GREEN_CB = -BLUE_709 * LUMA_709[2] / LUMA_709[1]
GREEN_CR = -RED_709 * LUMA_709[0] / LUMA_709[1]

# BT.601 luma of a BT.709 chroma pair: grey has none, so only the differences count.
LUMA_CB = LUMA_601[1] * GREEN_CB + LUMA_601[2] * BLUE_709
LUMA_CR = LUMA_601[0] * RED_709 + LUMA_601[1] * GREEN_CR
CB_CB = (BLUE_709 - LUMA_CB) / (2.0 * (1.0 - LUMA_601[2]))
CB_CR = -LUMA_CR / (2.0 * (1.0 - LUMA_601[2]))
CR_CB = -LUMA_CB / (2.0 * (1.0 - LUMA_601[0]))
CR_CR = (RED_709 - LUMA_CR) / (2.0 * (1.0 - LUMA_601[0]))


SHIFT = 18  # bits of fixed point: integers are vectorised, clipped conversions of floats are not
HALF = 1 << (SHIFT - 1)
_SCALE_Y = round(255.0 / (WHITE - BLACK) * (1 << SHIFT))
_SCALE_C = 255.0 / SWING * (1 << SHIFT)
_RGB = (
    round(RED_709 * _SCALE_C),
    round(GREEN_CB * _SCALE_C),
    round(GREEN_CR * _SCALE_C),
    round(BLUE_709 * _SCALE_C),
)
_JPEG_LUMA = (round(LUMA_CB * _SCALE_C), round(LUMA_CR * _SCALE_C))
_JPEG_CHROMA = tuple(round(c * _SCALE_C) for c in (CB_CB, CB_CR, CR_CB, CR_CR))


@inlined
def _byte(fixed: np.int32) -> np.uint8:
    return np.uint8(min(max(fixed >> np.int32(SHIFT), np.int32(0)), np.int32(255)))


@inlined
def _weighted(cb: np.uint16, cr: np.uint16, weight_b: int, weight_r: int) -> np.int32:
    return np.int32(weight_b) * (np.int32(cb) - np.int32(GREY)) + np.int32(weight_r) * (
        np.int32(cr) - np.int32(GREY)
    )


@inlined
def _luma(y: np.uint16) -> np.int32:
    return np.int32(_SCALE_Y) * (np.int32(y) - np.int32(BLACK)) + np.int32(HALF)


@serial
def rgb_from_ycbcr(y: U16, cb: U16, cr: U16, rgb: U8) -> None:
    """Write 8-bit R'G'B' [h, w, 3]; every chroma sample covers its 2x2 pixels."""
    h, w = y.shape
    for v in range(h):
        for half in range(cb.shape[1]):
            b, r = cb[v >> 1, half], cr[v >> 1, half]
            red = _weighted(b, r, 0, _RGB[0])
            green = _weighted(b, r, _RGB[1], _RGB[2])
            blue = _weighted(b, r, _RGB[3], 0)
            for u in range(2 * half, min(2 * half + 2, w)):
                luma = _luma(y[v, u])
                rgb[v, u, 0] = _byte(luma + red)
                rgb[v, u, 1] = _byte(luma + green)
                rgb[v, u, 2] = _byte(luma + blue)


@serial
def ycbcr_from_rgb(rgb: U8, y: U16, cb: U16, cr: U16) -> None:
    """Write 10-bit planes from 8-bit R'G'B' [h, w, 3]; a chroma sample is the mean of its 2x2 pixels."""
    h, w = y.shape
    scale_y, scale_c = (WHITE - BLACK) / 255.0, SWING / 255.0
    for block_v in range(cb.shape[0]):
        for block_u in range(cb.shape[1]):
            blue, red, count = 0.0, 0.0, 0
            for v in range(2 * block_v, min(2 * block_v + 2, h)):
                for u in range(2 * block_u, min(2 * block_u + 2, w)):
                    r, g, b = float(rgb[v, u, 0]), float(rgb[v, u, 1]), float(rgb[v, u, 2])
                    luma = LUMA_709[0] * r + LUMA_709[1] * g + LUMA_709[2] * b
                    y[v, u] = int(BLACK + scale_y * luma + 0.5)
                    blue += b - luma
                    red += r - luma
                    count += 1
            cb[block_v, block_u] = int(GREY + scale_c * blue / (BLUE_709 * count) + 0.5)
            cr[block_v, block_u] = int(GREY + scale_c * red / (RED_709 * count) + 0.5)


@serial
def jpeg_planes(y: U16, cb: U16, cr: U16, out_y: U8, out_cb: U8, out_cr: U8) -> None:
    """Write full-range 8-bit BT.601 planes (JFIF) by a linear map, without RGB in between.

    out_cb, out_cr: as large as cb; out_y: twice that in each direction, its last row and column repeated if h or w is
    odd.
    """
    h, w = y.shape
    differences = np.empty(w, np.int32)
    middle = np.int32((128 << SHIFT) + HALF)
    for row in range(cb.shape[0]):
        for half in range(cb.shape[1]):
            b, r = cb[row, half], cr[row, half]
            out_cb[row, half] = _byte(middle + _weighted(b, r, _JPEG_CHROMA[0], _JPEG_CHROMA[1]))
            out_cr[row, half] = _byte(middle + _weighted(b, r, _JPEG_CHROMA[2], _JPEG_CHROMA[3]))
            difference = _weighted(b, r, _JPEG_LUMA[0], _JPEG_LUMA[1])
            for u in range(2 * half, min(2 * half + 2, w)):
                differences[u] = difference
        for v in range(2 * row, 2 * row + 2):
            line = y[min(v, h - 1)]
            for u in range(w):
                out_y[v, u] = _byte(_luma(line[u]) + differences[u])
            for u in range(w, out_y.shape[1]):
                out_y[v, u] = out_y[v, w - 1]

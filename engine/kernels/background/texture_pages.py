"""Parts of captures' pictures in R'G'B', for the textures of exported meshes."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import I64, U8
from ..base.jit import inlined, parallel
from ..base.memory import load_u16
from .captures import HEIGHT, WIDTH, WRAPS, Y, chroma_at

__all__ = ["copy_part"]

_BLACK, _LUMA, _GREY, _CHROMA = 64.0, 876.0, 512.0, 896.0  # 10-bit limited range
_RED_CR, _GREEN_CB, _GREEN_CR, _BLUE_CB = 1.5748, 0.1873, 0.4681, 1.8556  # BT.709


@inlined
def _byte(value: float) -> np.uint8:
    return np.uint8(255.0 * min(max(value, 0.0), 1.0) + 0.5)


@parallel
def copy_part(capture: I64, left: int, top: int, rgb: U8) -> None:
    """Writes the pixels of a capture's picture (a row of the table of captures) from column `left` and row `top` on to
    rgb uint8 [h, w, 3]; chroma is interpolated. Beyond a border lies the nearest pixel, or, at the sides of a picture
    that wraps, the other side's."""
    width, height, wraps = capture[WIDTH], capture[HEIGHT], capture[WRAPS] != 0
    for row in numba.prange(rgb.shape[0]):
        y = min(max(top + row, 0), height - 1)
        for column in range(rgb.shape[1]):
            x = left + column
            x = x % width if wraps else min(max(x, 0), width - 1)
            luma = (load_u16(capture[Y], y * width + x) - _BLACK) / _LUMA
            cb, cr = chroma_at(capture, x + 0.5, y + 0.5)
            cb, cr = (cb - _GREY) / _CHROMA, (cr - _GREY) / _CHROMA
            rgb[row, column, 0] = _byte(luma + _RED_CR * cr)
            rgb[row, column, 1] = _byte(luma - _GREEN_CB * cb - _GREEN_CR * cr)
            rgb[row, column, 2] = _byte(luma + _BLUE_CB * cb)

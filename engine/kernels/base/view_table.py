"""Views as kernels read them: a table of their parameters, and the addresses of their pictures.

A view table is float64 [n, TABLE_SIZE] (packed camera, then the fields below) and int64 [n, PLANE_COUNT], the addresses
of the C-contiguous arrays of each view: codes, y, cb, cr (uint16) and, for views that are drawn, where their surface is
cut (uint8, the flags of `kernels.geometry.cuts`). Chroma is 4:2:0 or has the size of the luma. The caller keeps the
arrays alive.
"""

from __future__ import annotations

from typing import NamedTuple

from ...support.array_types import F64, I64
from ...support.packed import CAMERA_SIZE
from .tone import TONE_SIZE

__all__ = [
    "CB",
    "CODES",
    "COLUMNS",
    "CR",
    "CUTS",
    "EDGE",
    "INVALID",
    "OFFSET",
    "PIXEL",
    "PLANE_COUNT",
    "ROWS",
    "ROW_OF_ADDRESSES",
    "SHARPNESS",
    "STEP",
    "SUBSAMPLED",
    "TABLE_SIZE",
    "TOLERANCE",
    "TONE",
    "Views",
    "Y",
]

OFFSET = CAMERA_SIZE  # disparity of code 0
STEP = CAMERA_SIZE + 1  # disparity of a code step
INVALID = CAMERA_SIZE + 2  # 1 where code 0 means "no depth"
TOLERANCE = CAMERA_SIZE + 3  # a view agrees on a surface within this number of codes
EDGE = CAMERA_SIZE + 4  # code step between texels that is a depth edge
SHARPNESS = CAMERA_SIZE + 5  # pixels per radian, relative to the target's
COLUMNS = CAMERA_SIZE + 6  # columns per radian (equirectangular)
ROWS = CAMERA_SIZE + 7
PIXEL = CAMERA_SIZE + 8  # radians per pixel
SUBSAMPLED = CAMERA_SIZE + 9  # 1 where chroma is 4:2:0, 0 where it has the size of the luma
TONE = CAMERA_SIZE + 10  # a packed tone that is applied to the view's colours
TABLE_SIZE = TONE + TONE_SIZE

CODES, Y, CB, CR, CUTS = range(5)  # columns of the addresses
PLANE_COUNT = 5
ROW_OF_ADDRESSES = 8 * PLANE_COUNT  # bytes from one view's addresses to the next one's


class Views(NamedTuple):
    """Views as kernels read them."""

    table: F64  # [n, TABLE_SIZE]
    addresses: I64  # [n, PLANE_COUNT]

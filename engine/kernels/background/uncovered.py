"""Where the drawn views may leave holes for an eye whose place is known roughly: only there a background is needed.

When the eye moves a little, a view's surface can leave holes only near its cuts and near the border of its picture;
elsewhere it still hides everything behind it. Views are processed in blocks, and the picture of the background in
cells, one view after the other.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8
from ...support.packed import (
    CX,
    CY,
    FX,
    FY,
    HEIGHT,
    KIND,
    PERSPECTIVE,
    RADIANS_A_COLUMN,
    RADIANS_A_ROW,
    THETA_MAX,
    WIDTH,
    WRAPS,
)
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_eight_u8, load_u8, load_u16
from ..base.project import project_pixels
from ..base.view_table import INVALID, OFFSET, STEP
from ..geometry.cuts import BROKEN

__all__ = ["BLOCK", "CELL", "mark_uncovered"]

BLOCK = 16  # side, pixels of a view
CELL = 4  # side, pixels of the background's picture
_CODES, _CUTS = 0, 4  # columns of the addresses of views
_COVERED, _CUT = 1, 2  # bits of a cell
_FARTHEST = 6  # cells: a surface that the eye's motion may shift by more does not count as covering
_WIDEST = 40  # cells: blocks with larger images do not count as covering
_WORD_BROKEN = BROKEN * 0x0101010101010101


@serial
def _look_at_corners(view: F64, codes: int, camera: F64, row: int, pixels: F64, images: F64) -> None:
    """images [3, columns + 1]: u, v and depth, in the background's picture, of the corners of a row of blocks; depth 0
    for corners without depth. Corners are the pixels of every sixteenth row and column, and of the last ones. pixels:
    scratch memory."""
    w, y, count = int(view[WIDTH]), min(BLOCK * row, int(view[HEIGHT]) - 1), images.shape[1]
    for i in range(count):
        x = min(BLOCK * i, w - 1)
        code = load_u16(codes, y * w + x)
        disparity = view[OFFSET] + view[STEP] * code
        pixels[0, i], pixels[1, i] = x + 0.5, y + 0.5
        pixels[2, i] = disparity if (code > 0 or view[INVALID] == 0.0) and disparity > 0.0 else -1.0
    project_pixels(view, camera, pixels, images, count)
    for i in range(count):
        images[2, i] = images[2, i] if pixels[2, i] > 0.0 else 0.0


@inlined
def _any_cut(flags: int, w: int, top: int, bottom: int, left: int, right: int) -> bool:
    """Whether a cut touches one of a block's pixels, including its last row and column."""
    found, last = 0, right - 7
    for y in range(top, bottom + 1):
        line = flags + y * w
        x = left
        while x <= last:
            found |= load_eight_u8(line, x)
            x += 8
        while x <= right:
            found |= load_u8(line, x)
            x += 1
    return found & _WORD_BROKEN != 0


@inlined
def _mark(cells: U8, nearest: F32, bit: int, box: tuple[float, float, float, float], depth: float) -> None:
    """Sets a bit of the cells that a box (u, v, u, v) of the picture touches, and keeps their nearest depth."""
    rows, columns = cells.shape
    left, right = max(math.floor(box[0] / CELL), 0), min(math.floor(box[2] / CELL), columns - 1)
    top, bottom = max(math.floor(box[1] / CELL), 0), min(math.floor(box[3] / CELL), rows - 1)
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            cells[y, x] |= bit
            nearest[y, x] = min(nearest[y, x], depth)


@serial
def _mark_view(view: F64, codes: int, flags: int, camera: F64, cells: U8, nearest: F32) -> None:
    """Marks the cells with a view's surface as _COVERED, and those with its cuts and its border as _CUT."""
    for y in range(cells.shape[0]):
        for x in range(cells.shape[1]):
            cells[y, x], nearest[y, x] = 0, np.inf
    w, h = int(view[WIDTH]), int(view[HEIGHT])
    rows, columns = max(1, (h - 2) // BLOCK + 1), max(1, (w - 2) // BLOCK + 1)
    border = view[WRAPS] == 0.0
    corners, room = np.empty((2, 3, columns + 1)), np.empty((3, columns + 1))
    _look_at_corners(view, codes, camera, 0, room, corners[1])
    for row in range(rows):
        for i in range(columns + 1):  # to copy an array as a whole takes long to compile
            for k in range(3):
                corners[0, k, i] = corners[1, k, i]
        _look_at_corners(view, codes, camera, row + 1, room, corners[1])
        for column in range(columns):
            u_low, v_low, u_high, v_high, depth, count = math.inf, math.inf, -math.inf, -math.inf, math.inf, 0
            for k in range(4):
                u, v, d = corners[k >> 1, :, column + (k & 1)]
                if d > 0.0:
                    u_low, u_high, v_low, v_high = min(u_low, u), max(u_high, u), min(v_low, v), max(v_high, v)
                    depth, count = min(depth, d), count + 1
            if count == 0 or u_high < 0.0 or v_high < 0.0 or u_low > camera[WIDTH] or v_low > camera[HEIGHT]:
                continue
            box = u_low, v_low, u_high, v_high
            wide = max(u_high - u_low, v_high - v_low) > _WIDEST * CELL
            outer = row == 0 or row + 1 == rows or (border and (column == 0 or column + 1 == columns))
            if count == 4 and not wide and not outer:
                bottom, right = min(BLOCK * (row + 1), h - 1), min(BLOCK * (column + 1), w - 1)
                if not _any_cut(flags, w, BLOCK * row, bottom, BLOCK * column, right):
                    _mark(cells, nearest, _COVERED, box, depth)
                    continue
            if not wide:
                _mark(cells, nearest, _CUT, box, depth)
                continue
            for k in range(4):
                u, v, d = corners[k >> 1, :, column + (k & 1)]
                if d > 0.0:
                    _mark(cells, nearest, _CUT, (u, v, u, v), d)


@inlined
def _pixels_a_radian(camera: F64, u: float, v: float) -> float:
    """The largest motion of a point at depth 1 in a picture, pixels, per unit of the camera's motion."""
    if camera[KIND] == PERSPECTIVE:
        y, z = (camera[CX] - u) / camera[FX], (camera[CY] - v) / camera[FY]
        return max(abs(camera[FX]), abs(camera[FY])) * math.sqrt(1.0 + y * y + z * z)
    elevation = camera[THETA_MAX] - v * camera[RADIANS_A_ROW]
    return 1.0 / min(camera[RADIANS_A_COLUMN] * max(math.cos(elevation), 1e-3), camera[RADIANS_A_ROW])


@inlined
def _safe(cells: U8, y: int, x: int, reach: int) -> bool:
    """Whether all cells up to `reach` cells away are covered, and none is cut."""
    rows, columns = cells.shape
    for j in range(max(y - reach, 0), min(y + reach, rows - 1) + 1):
        for i in range(max(x - reach, 0), min(x + reach, columns - 1) + 1):
            if cells[j, i] != _COVERED:
                return False
    return True


@parallel
def mark_uncovered(table: F64, addresses: I64, camera: F64, reach_m: float, wanted: U8) -> None:
    """wanted [ceil(h / CELL), ceil(w / CELL)] of a camera's picture: 1 where an eye up to `reach_m` metres away from
    the camera may see past the surfaces of all views, else 0.

    table, addresses: the views, see `kernels.base.view_table`, with cuts.
    """
    rows, columns = wanted.shape
    views = table.shape[0]
    cells, nearest = np.empty((views, rows, columns), np.uint8), np.empty((views, rows, columns), np.float32)
    for k in numba.prange(views):
        _mark_view(table[k], addresses[k, _CODES], addresses[k, _CUTS], camera, cells[k], nearest[k])
    for row in numba.prange(rows):
        for x in range(columns):
            found, shift = False, reach_m * _pixels_a_radian(camera, CELL * (x + 0.5), CELL * (row + 0.5)) / CELL
            for k in range(views):
                if cells[k, row, x] == _COVERED and not found:
                    reach = shift / nearest[k, row, x]
                    found = reach <= _FARTHEST and _safe(cells[k], row, x, int(reach) + 1)
            wanted[row, x] = not found

"""The farther-only test: which pixels of a view show something farther than an earlier view does (section 3.3.2).

Views are divided into blocks. Where both pictures show smooth surfaces, the test of a block's corners in an earlier
view holds for the whole block. Only the other blocks, a few percent, are tested pixel by pixel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8, U16
from ...support.packed import HEIGHT, WIDTH, WRAPS, Coding
from ..base.jit import inlined, parallel, serial
from ..base.project import project_pixels
from ..base.tolerance import Delta, delta_at

__all__ = ["BLOCK", "DepthView", "depth_of_code", "keep_farther", "mark_smooth"]

BLOCK = 8  # pixels; blocks share their corners: the pixels of every eighth row and column, and of the last ones
_REACH = 4  # largest size, in blocks of an earlier picture in each direction, of the image of a block
_SMOOTH = 0.25  # share of delta that a smooth block's depths may differ from the interpolation of its corners
# The side on which a point is outside a picture.
_LEFT, _RIGHT, _ABOVE, _BELOW, _UNKNOWN = 1, 2, 4, 8, 16
_UNCLEAR, _KEPT, _CLEARED = range(3)  # result for a block


class DepthView(NamedTuple):
    """The depth of a reference view, for this module."""

    codes: U16  # [h, w]
    camera: F64  # packed
    smooth: U8  # [ceil((h - 1) / BLOCK), ceil((w - 1) / BLOCK)], as `mark_smooth` says


@inlined
def _disparity(code: float, coding: Coding) -> float:
    return coding.offset + coding.step * max(float(code), float(coding.min_code))


@inlined
def depth_of_code(code: float, coding: Coding) -> float:
    """The depth of a code, metres; the smallest valid code stands for those below it."""
    return 1.0 / _disparity(code, coding)


@serial
def _interpolate(line: U16, between: F32) -> None:
    """Between [w]: linear between the corners of blocks along a row of codes."""
    last = line.shape[0] - 1
    for left in range(0, max(last, 1), BLOCK):
        width = max(min(BLOCK, last - left), 1)
        start = np.float32(line[left])
        slope = (np.float32(line[min(left + width, last)]) - start) / np.float32(width)
        for x in range(min(width + 1, last + 1)):
            between[left + x] = start + np.float32(x) * slope


@serial(fastmath={"nnan", "nsz", "contract"})
def _keep_worst(line: U16, upper: F32, lower: F32, share: float, worst: F32) -> None:
    """Raises worst [w] to the difference of each column's code from the interpolation between two rows."""
    for x in range(line.shape[0]):
        worst[x] = max(worst[x], abs(np.float32(line[x]) - (upper[x] + share * (lower[x] - upper[x]))))


@parallel
def mark_smooth(codes: U16, coding: Coding, delta: Delta, smooth: U8) -> None:
    """Sets smooth [ceil((h - 1) / BLOCK), ceil((w - 1) / BLOCK)] to 1 for smooth blocks, else 0.

    A block is smooth if all of its depths are valid and, within a share of delta, equal to the bilinear interpolation
    of its corners.
    """
    h, w = codes.shape
    for row in numba.prange(smooth.shape[0]):
        top = BLOCK * row
        height = min(BLOCK, h - 1 - top)
        upper, lower, worst = np.empty(w, np.float32), np.empty(w, np.float32), np.zeros(w, np.float32)
        _interpolate(codes[top], upper)
        _interpolate(codes[top + height], lower)
        for y in range(1, height):
            _keep_worst(codes[top + y], upper, lower, np.float32(y / height), worst)
        _keep_worst(codes[top], upper, upper, np.float32(0.0), worst)
        _keep_worst(codes[top + height], lower, lower, np.float32(0.0), worst)
        for column in range(smooth.shape[1]):
            left, right = BLOCK * column, min(BLOCK * (column + 1), w - 1)
            lowest = min(min(upper[left], upper[right]), min(lower[left], lower[right]))
            depth = depth_of_code(lowest, coding)
            limit = _SMOOTH * delta_at(delta, depth) / (depth * depth * coding.step)
            largest = np.float32(0.0)
            for x in range(left, right + 1):
                largest = max(largest, worst[x])
            smooth[row, column] = lowest >= coding.least and largest <= limit


@inlined
def _farther(codes: U16, coding: Coding, wraps: bool, edge: float, u: float, v: float, limit: float) -> float:
    """How much farther than `limit` a view's surface at (u, v) is, metres: the mean of the four pixels round it if they
    are one surface, else the nearest pixel. -inf if one of the four has no depth."""
    h, w = codes.shape
    x0, y0 = math.floor(u - 0.5), math.floor(v - 0.5)
    inside = y0 >= 0 and y0 + 1 < h and (wraps or (x0 >= 0 and x0 + 1 < w))
    left, right = x0 if x0 >= 0 else x0 + w, x0 + 1 if x0 + 1 < w else x0 + 1 - w
    top = y0
    if not inside:
        left, right, top = 0, 0, 0
    bottom = min(top + 1, h - 1)
    a, b = float(codes[top, left]), float(codes[top, right])
    c, d = float(codes[bottom, left]), float(codes[bottom, right])
    lowest, highest = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    fx, fy = u - 0.5 - x0, v - 0.5 - y0
    upper, lower = a + fx * (b - a), c + fx * (d - c)
    seen = depth_of_code(highest if highest - lowest > edge else upper + fy * (lower - upper), coding)
    return seen - limit if inside and lowest >= coding.least else -math.inf


@serial
def _look_at_corners(
    view: DepthView, coding: Coding, earlier: DepthView, earlier_coding: Coding, edge: float, delta: Delta, row: int,
    pixels: F64, images: F64, outside: I64,
) -> None:  # fmt: skip
    """Projects a row of blocks' corners into an earlier view. images [3, columns + 1]: u, v, and how much farther than
    the limit it sees there, in units of delta; outside [columns + 1]: the sides on which they are outside its picture,
    or _UNKNOWN. pixels: scratch memory as large as images."""
    codes, camera = view.codes, earlier.camera
    h, w = codes.shape
    y = min(BLOCK * row, h - 1)
    count = images.shape[1]
    for i in range(count):
        x = min(BLOCK * i, w - 1)
        pixels[0, i], pixels[1, i], pixels[2, i] = x + 0.5, y + 0.5, _disparity(codes[y, x], coding)
    project_pixels(view.camera, camera, pixels, images, count)
    for i in range(count):
        u, v, there = images[0, i], images[1, i], images[2, i]
        side = (u < 0.0) * _LEFT + (u >= camera[WIDTH]) * _RIGHT
        side += (v < 0.0) * _ABOVE + (v >= camera[HEIGHT]) * _BELOW
        outside[i] = side if there > 0.0 else _UNKNOWN
        allowed = delta_at(delta, there)
        images[2, i] = _farther(
            earlier.codes, earlier_coding, camera[WRAPS] != 0.0, edge, u, v, there - allowed
        ) / allowed if outside[i] == 0 else 0.0  # fmt: skip


@inlined
def _smooth_around(smooth: U8, images: F64, below: F64, column: int) -> bool:
    """Whether an earlier view is smooth round the image of a block, and the image has a moderate size."""
    u_low = min(min(images[0, column], images[0, column + 1]), min(below[0, column], below[0, column + 1]))
    u_high = max(max(images[0, column], images[0, column + 1]), max(below[0, column], below[0, column + 1]))
    v_low = min(min(images[1, column], images[1, column + 1]), min(below[1, column], below[1, column + 1]))
    v_high = max(max(images[1, column], images[1, column + 1]), max(below[1, column], below[1, column + 1]))
    if u_high - u_low > (_REACH - 1) * BLOCK or v_high - v_low > (_REACH - 1) * BLOCK:
        return False
    left, top = max(int(u_low - 1.5) // BLOCK, 0), max(int(v_low - 1.5) // BLOCK, 0)
    right = min(int(u_high + 0.5) // BLOCK, smooth.shape[1] - 1)
    bottom = min(int(v_high + 0.5) // BLOCK, smooth.shape[0] - 1)
    found = True
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            found &= smooth[y, x] != 0
    return found


@serial
def _clear(keep: U8, top: int, bottom: int, left: int, right: int) -> None:
    for y in range(top, bottom):
        for x in range(left, right):
            keep[y, x] = 0


@serial
def _look_at_pixels(
    view: DepthView, coding: Coding, earlier: DepthView, earlier_coding: Coding, edge: float, delta: Delta,
    box: tuple[int, int, int, int], room: F64, keep: U8,
) -> int:  # fmt: skip
    """`keep_farther` for one block, pixel by pixel. box: its first row, the row after its last, and the same of its
    columns; room [2, 3, pixels of a block]: scratch memory. Returns the number of pixels that were not cleared before.
    """
    codes, camera = view.codes, earlier.camera
    top, bottom, left, right = box
    pixels, images, count = room[0], room[1], 0
    for y in range(top, bottom):
        for x in range(left, right):
            if keep[y, x] != 0 and codes[y, x] >= coding.least:
                pixels[0, count], pixels[1, count] = x + 0.5, y + 0.5
                pixels[2, count] = _disparity(codes[y, x], coding)
                count += 1
    project_pixels(view.camera, camera, pixels, images, count)
    for i in range(count):
        u, v, there = images[0, i], images[1, i], images[2, i]
        if there > 0.0 and u >= 0.0 and v >= 0.0 and u < camera[WIDTH] and v < camera[HEIGHT]:
            wraps, limit = camera[WRAPS] != 0.0, there - delta_at(delta, there)
            if _farther(earlier.codes, earlier_coding, wraps, edge, u, v, limit) >= 0.0:
                keep[int(pixels[1, i]), int(pixels[0, i])] = 0
    return count


@inlined
def _whole_block(smooth: U8, above: F64, below: F64, out_above: I64, out_below: I64, column: int) -> int:
    """The result for a whole smooth block from its corners: _KEPT if it is outside an earlier picture or behind the
    surfaces in it, _CLEARED if it is not, or _UNCLEAR if the corners do not tell."""
    a, b, c, d = out_above[column], out_above[column + 1], out_below[column], out_below[column + 1]
    if a & b & c & d:
        return _KEPT
    low = min(min(above[2, column], above[2, column + 1]), min(below[2, column], below[2, column + 1]))
    high = max(max(above[2, column], above[2, column + 1]), max(below[2, column], below[2, column + 1]))
    margin = 2.0 * _SMOOTH
    if (a | b | c | d) != 0 or not (low > margin or high < -margin):
        return _UNCLEAR
    if not _smooth_around(smooth, above, below, column):
        return _UNCLEAR
    return _CLEARED if low > margin else _KEPT


@parallel
def keep_farther(
    view: DepthView, coding: Coding, earlier: DepthView, earlier_coding: Coding, edge: float, delta: Delta, keep: U8
) -> int:
    """Clears keep [h, w] where an earlier view sees the pixel's point, or a surface about as far or farther.

    `edge`: a depth edge's step in codes of the earlier view. Returns the number of pixels that were tested one by one.
    """
    h, w = keep.shape
    rows, columns = view.smooth.shape
    single = 0
    for row in numba.prange(rows):
        above, below = np.empty((3, columns + 1)), np.empty((3, columns + 1))
        room, block = np.empty((3, columns + 1)), np.empty((2, 3, (BLOCK + 1) ** 2))
        out_above, out_below = np.empty(columns + 1, np.int64), np.empty(columns + 1, np.int64)
        for k in range(2):
            _look_at_corners(
                view, coding, earlier, earlier_coding, edge, delta, row + k, room, below if k else above,
                out_below if k else out_above,
            )  # fmt: skip
        # The last row and column of blocks include the last pixels; last pixels of other blocks belong to the next one.
        bottom = h if row + 1 == rows else BLOCK * (row + 1)
        for column in range(columns):
            left, right, found = BLOCK * column, w if column + 1 == columns else BLOCK * (column + 1), _UNCLEAR
            if view.smooth[row, column]:
                found = _whole_block(earlier.smooth, above, below, out_above, out_below, column)
            if found == _CLEARED:
                _clear(keep, BLOCK * row, bottom, left, right)
            elif found == _UNCLEAR:
                box = BLOCK * row, bottom, left, right
                single += _look_at_pixels(view, coding, earlier, earlier_coding, edge, delta, box, block, keep)
    return single

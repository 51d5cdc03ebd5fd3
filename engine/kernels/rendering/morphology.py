"""Morphological anti-aliasing (Reshetov 2009) along the silhouettes in a disparity picture.

A silhouette between pixels is a staircase. If a run of it between two rows ends with a step up or down, the real
outline crosses the rows: it is approximated by a straight line from half a pixel away at that end to the run's middle.
The part of a pixel that the line cuts off takes the colour of the pixel on the other side of the silhouette. Nothing is
drawn again.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, U8, U16
from ..base.jit import inlined, parallel, serial

__all__ = ["SPAN", "blend_steps", "mark_steps"]

Planes = tuple[U16, U16, U16]

SPAN = 64  # pixels of a row that are skipped together if there is no silhouette
RIGHT = 1  # a silhouette runs between this pixel and its right neighbour
DOWN = 2
_SLOPE = np.float32(1.5)  # steps up to this times the smaller slope next to them belong to a surface


@serial(fastmath={"nnan"})
def _mark_row(before: F32, a: F32, b: F32, after: F32, least: float, bit: int, out: U8) -> None:
    """Set a bit of out [n] where the step between a and b, the middle two of four pixels in line, is more than `least`
    and more than the slopes next to it explain."""
    for x in range(out.shape[0]):
        excess = abs(a[x] - b[x]) - least
        slope_a, slope_b = _SLOPE * abs(before[x] - a[x]), _SLOPE * abs(b[x] - after[x])
        out[x] |= bit if (excess > slope_a) | (excess > slope_b) else np.uint8(0)


@parallel
def mark_steps(disparity: F32, step: float, marks: U8, found: U8) -> None:
    """Fill marks [h, w] with RIGHT and DOWN where disparity [h, w] has a step of more than `step`, and of more than
    slopes explain.

    Holes (0) count as infinitely far. found [h, ceil(w / SPAN)]: whether a span of a row has any marks.
    """
    h, w = disparity.shape
    least, right, down = np.float32(step), np.uint8(RIGHT), np.uint8(DOWN)
    for row in numba.prange(h):
        y = int(np.int64(row))
        q, out = disparity[y], marks[y]
        for x in range(w):
            out[x] = 0
        if y < h - 1:
            above, after = disparity[max(y - 1, 0)], disparity[min(y + 2, h - 1)]
            _mark_row(above, q, disparity[y + 1], after, least, down, out)
        if w > 3:
            _mark_row(q[:-3], q[1:-2], q[2:-1], q[3:], least, right, out[1:-2])
        for column in (0, w - 2):  # next to the borders
            x = int(column)
            if 0 <= x < w - 1 and (x == 0 or w > 2):
                before, beyond = q[max(x - 1, 0) :], q[min(x + 2, w - 1) :]
                _mark_row(before, q[x:], q[x + 1 :], beyond, least, right, out[x : x + 1])
        for j in range(found.shape[1]):
            marked = np.uint8(0)
            for x in range(j * SPAN, min((j + 1) * SPAN, w)):
                marked |= out[x]
            found[y, j] = marked


@inlined
def _cut_off(k: int, length: int, end: int) -> float:
    """Area that the line, from half a pixel away at a run's end to its middle, cuts off the k-th pixel from the end."""
    if end == 0:
        return 0.0
    half = 0.5 * length
    a, b = float(k), min(float(k + 1), half)
    return 0.5 * ((b - a) - (b * b - a * a) / (2.0 * half)) if b > a else 0.0


@inlined
def _turn(before: int, after: int) -> int:
    """The turn of a silhouette at a run's end: -1 to the side of the first line, 1 to the other, 0 to neither or both.
    """
    return (1 if after else 0) - (1 if before else 0)


@inlined
def _mix(source: U16, out: U16, y: int, x: int, other_y: int, other_x: int, share: float) -> None:
    change = share * (float(source[other_y, other_x]) - float(source[y, x]))
    out[y, x] = np.uint16(min(max(float(out[y, x]) + change + 0.5, 0.0), 65535.0))


@serial
def _blend_run(
    start: int, length: int, line: int, first: int, last: int, upright: bool, sources: Planes, outs: Planes
) -> None:
    """Blend across a run of the silhouette between a line of pixels (a row; a column, if upright) and the next one.

    first, last: its turns (`_turn`) at both ends.
    """
    for k in range(length):
        ahead, behind = _cut_off(k, length, first), _cut_off(length - 1 - k, length, last)
        # If the outline bends to the first line's side, the first line takes colour from the second, and vice versa.
        near = (ahead if first < 0 else 0.0) + (behind if last < 0 else 0.0)
        far = (ahead if first > 0 else 0.0) + (behind if last > 0 else 0.0)
        for share, a, b in ((near, line, line + 1), (far, line + 1, line)):
            if share <= 0.0:
                continue
            y, x, other_y, other_x = (start + k, a, start + k, b) if upright else (a, start + k, b, start + k)
            _mix(sources[0], outs[0], y, x, other_y, other_x, share)
            if (a ^ b) >> 1:  # a sample of chroma covers four pixels, of which this is one
                for c in range(1, 3):
                    _mix(sources[c], outs[c], y >> 1, x >> 1, other_y >> 1, other_x >> 1, 0.25 * share)


@serial
def blend_steps(marks: U8, found: U8, sources: Planes, outs: Planes) -> None:
    """Blend the planes of a 4:2:0 picture, `outs`, which hold copies of `sources`, along marked silhouettes.

    marks [h, w] and found: from `mark_steps`; planes are luma [h, w] and both chroma [(h+1)//2, (w+1)//2].
    """
    h, w = marks.shape
    for y in range(h):
        for j in range(found.shape[1]):
            if not found[y, j]:
                continue
            for x in range(j * SPAN, min((j + 1) * SPAN, w)):
                mark = marks[y, x]
                # A run is processed at its end: where the next pixel along it has no mark.
                if mark & DOWN and (x == w - 1 or not marks[y, x + 1] & DOWN):
                    start = x
                    while start > 0 and marks[y, start - 1] & DOWN:
                        start -= 1
                    first = _turn(marks[y, start - 1] & RIGHT, marks[y + 1, start - 1] & RIGHT) if start > 0 else 0
                    last = _turn(mark & RIGHT, marks[y + 1, x] & RIGHT)
                    if first != 0 or last != 0:
                        _blend_run(start, x + 1 - start, y, first, last, False, sources, outs)
                if mark & RIGHT and (y == h - 1 or not marks[y + 1, x] & RIGHT):
                    top = y
                    while top > 0 and marks[top - 1, x] & RIGHT:
                        top -= 1
                    first = _turn(marks[top - 1, x] & DOWN, marks[top - 1, x + 1] & DOWN) if top > 0 else 0
                    last = _turn(mark & DOWN, marks[y, x + 1] & DOWN)
                    if first != 0 or last != 0:
                        _blend_run(top, y + 1 - top, x, first, last, True, sources, outs)

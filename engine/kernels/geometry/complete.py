"""Completing a depth map: pull-push over a pyramid of depth codes, guided by colour.

Codes are linear in disparity, and the disparity of a plane is affine in a perspective picture. The result approximates
a membrane that is held by the measured pixels, with springs that are weak where colours differ. On the way to coarser
levels (pull), a cell is measured if one of its children is. On the way back (push), the other cells start from the
coarser level, weighted by distance and colour, and relax towards their neighbours' weighted mean (Gortler et al., "The
Lumigraph", SIGGRAPH 1996; colour as in Levin et al., "Colorization using optimization", SIGGRAPH 2004). A pixel between
two measured pixels of one surface takes their mean, so cracks are closed with the slope of the surface.

A level is float32 [rows, columns, 5]: confidence (1: measured, 0: unknown), depth code, y, cb, cr. A cell covers 2x2
cells of the finer level; a cell of the first level covers 2x2 pixels, which share a chroma sample.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, U8, U16
from ..base.jit import inlined, parallel, serial

__all__ = ["MEASURED", "drop_mixed", "first_level", "next_level", "push_level", "push_pixels"]

MEASURED = 255  # confidence of a measured pixel

_COLOUR = 32.0  # difference of 10-bit codes (y + cb + cr) that weakens a spring to half
_DECAY = 0.8  # factor of the confidence of cells that are taken from the coarser level
_FAINT = 1e-3  # weight of cells without confidence, which count only where there are no others


@inlined
def _spring(cell: F32, y: float, cb: float, cr: float) -> float:
    """Strength of the bond between a cell and a colour: a Lorentzian, never 0."""
    d = (abs(y - cell[2]) + abs(cb - cell[3]) + abs(cr - cell[4])) * np.float32(1.0 / _COLOUR)
    return np.float32(1.0) / (np.float32(1.0) + d * d)


@serial
def _mixed(far_a: int, a: int, code: int, b: int, far_b: int) -> bool:
    """Whether the middle one of five codes in line lies between two surfaces, on neither of them nor on a slope."""
    low, high = np.int32(min(a, b)), np.int32(max(a, b))
    if not 0 < low < code < high:
        return False
    slope_a = abs(np.int32(a) - np.int32(far_a)) if far_a > 0 else 0
    slope_b = abs(np.int32(b) - np.int32(far_b)) if far_b > 0 else 0
    step, off = high - low, min(high - code, code - low)
    return bool(4 * off > step > 4 * max(slope_a, slope_b))


@parallel
def drop_mixed(codes: U16, edge: float, out: U16) -> None:
    """out [h, w]: the codes, or 0 where a code lies half way between surfaces more than `edge` codes apart, because the
    sensor saw both in one pixel."""
    h, w = codes.shape
    limit = np.float32(edge)
    for row in numba.prange(h):
        y = np.int64(row)
        here, above, below = codes[y], codes[max(y - 1, np.int64(0))], codes[min(y + 1, h - 1)]
        out[y] = here
        for x in range(w):
            step = np.float32(abs(np.int32(above[x]) - np.int32(below[x])))
            inside = 2 <= y < h - 2
            if inside and step > limit and _mixed(codes[y - 2, x], above[x], here[x], below[x], codes[y + 2, x]):
                out[y, x] = 0
        for x in range(2, w - 2):
            step = np.float32(abs(np.int32(here[x - 1]) - np.int32(here[x + 1])))
            if step > limit and _mixed(here[x - 2], here[x - 1], here[x], here[x + 1], here[x + 2]):
                out[y, x] = 0


@parallel
def first_level(codes: U16, y: U16, cb: U16, cr: U16, level: F32) -> None:
    """Fill the level of 2x2 pixels; a code of 0 is not measured."""
    h, w = codes.shape
    for row in numba.prange(level.shape[0]):
        j = np.int64(row)
        upper, lower = codes[2 * j], codes[min(2 * j + 1, h - 1)]
        light, lights = y[2 * j], y[min(2 * j + 1, h - 1)]
        for i in range(level.shape[1]):
            left, right = 2 * i, min(2 * i + 1, w - 1)
            a, b = np.int32(upper[left]), np.int32(upper[right])
            c, d = np.int32(lower[left]), np.int32(lower[right])
            count = np.int32(a > 0) + np.int32(b > 0) + np.int32(c > 0) + np.int32(d > 0)
            luma = np.int32(light[left]) + np.int32(light[right]) + np.int32(lights[left]) + np.int32(lights[right])
            cell = level[j, i]
            cell[0] = np.float32(count > 0)
            cell[1] = np.float32(a + b + c + d) / np.float32(count if count > 0 else 1)
            cell[2] = np.float32(0.25) * np.float32(luma)
            cell[3], cell[4] = np.float32(cb[j, i]), np.float32(cr[j, i])


@parallel
def next_level(fine: F32, coarse: F32) -> None:
    """Fill a coarser level: the mean code of measured cells, the mean colour of all."""
    h, w = fine.shape[0], fine.shape[1]
    for row in numba.prange(coarse.shape[0]):
        j = np.int64(row)
        upper, lower = fine[2 * j], fine[min(2 * j + 1, h - 1)]
        for i in range(coarse.shape[1]):
            right = min(2 * i + 1, w - 1)
            a, b, c, d = upper[2 * i], upper[right], lower[2 * i], lower[right]
            count = a[0] + b[0] + c[0] + d[0]
            cell = coarse[j, i]
            cell[0] = np.float32(count > 0.0)
            cell[1] = (a[0] * a[1] + b[0] * b[1] + c[0] * c[1] + d[0] * d[1]) / max(count, np.float32(1.0))
            for k in range(2, 5):
                cell[k] = np.float32(0.25) * (a[k] + b[k] + c[k] + d[k])


@inlined
def _from_coarse(coarse: F32, j: int, i: int, y: float, cb: float, cr: float) -> tuple[float, float]:
    """Confidence and code for cell (j, i) of the finer level, from the four coarse cells round it by distance and
    colour."""
    y0, x0 = j >> 1, i >> 1
    y1 = min(max(y0 + 2 * (j & 1) - 1, 0), coarse.shape[0] - 1)
    x1 = min(max(x0 + 2 * (i & 1) - 1, 0), coarse.shape[1] - 1)
    a, b, c, d = coarse[y0, x0], coarse[y0, x1], coarse[y1, x0], coarse[y1, x1]
    wa = np.float32(9 / 16) * _spring(a, y, cb, cr)
    wb = np.float32(3 / 16) * _spring(b, y, cb, cr)
    wc = np.float32(3 / 16) * _spring(c, y, cb, cr)
    wd = np.float32(1 / 16) * _spring(d, y, cb, cr)
    trust = wa * a[0] + wb * b[0] + wc * c[0] + wd * d[0]
    wa, wb = wa * (a[0] + np.float32(_FAINT)), wb * (b[0] + np.float32(_FAINT))
    wc, wd = wc * (c[0] + np.float32(_FAINT)), wd * (d[0] + np.float32(_FAINT))
    return np.float32(_DECAY) * trust, (wa * a[1] + wb * b[1] + wc * c[1] + wd * d[1]) / (wa + wb + wc + wd)


@inlined
def _relaxed(fine: F32, j: int, i: int) -> float:
    """The mean of a cell's four neighbours' codes, weighted by colour."""
    cell = fine[j, i]
    a, b = fine[max(j - 1, 0), i], fine[min(j + 1, fine.shape[0] - 1), i]
    c, d = fine[j, max(i - 1, 0)], fine[j, min(i + 1, fine.shape[1] - 1)]
    wa, wb = _spring(a, cell[2], cell[3], cell[4]), _spring(b, cell[2], cell[3], cell[4])
    wc, wd = _spring(c, cell[2], cell[3], cell[4]), _spring(d, cell[2], cell[3], cell[4])
    return (wa * a[1] + wb * b[1] + wc * c[1] + wd * d[1]) / (wa + wb + wc + wd)


@parallel
def push_level(coarse: F32, fine: F32) -> None:
    """Gives the unmeasured cells of a level their confidence and code; the coarser level is complete."""
    h, w = fine.shape[0], fine.shape[1]
    for row in numba.prange(h):
        j = np.int64(row)
        for i in range(w):
            cell = fine[j, i]
            if cell[0] < 1.0:
                cell[0], cell[1] = _from_coarse(coarse, j, i, cell[2], cell[3], cell[4])
    for colour in range(2):  # as on a chess board, so that threads do not read each other's changes
        for row in numba.prange(h):
            j = np.int64(row)
            for i in range((j + colour) & 1, w, 2):
                if fine[j, i, 0] < 1.0:
                    fine[j, i, 1] = _relaxed(fine, j, i)


@inlined
def _bridged(a: int, b: int, edge: float) -> bool:
    """Whether two codes were measured on one surface."""
    return bool((a > 0) & (b > 0) & (np.float32(abs(a - b)) <= edge))


@parallel
def push_pixels(codes: U16, y: U16, cb: U16, cr: U16, level: F32, edge: float, out: U16, confidence: U8) -> None:
    """The last step: out and confidence [h, w] of pixels; measured ones are unchanged.

    `edge`: difference of codes between two pixels that is a depth edge.
    """
    h, w = codes.shape
    limit = np.float32(edge)
    for row in numba.prange(h):
        j = np.int64(row)
        above, here, below = codes[max(j - 1, np.int64(0))], codes[j], codes[min(j + 1, h - 1)]
        for i in range(w):
            if here[i] > 0:
                out[j, i], confidence[j, i] = here[i], MEASURED
                continue
            a, b = np.int32(above[i]), np.int32(below[i])
            c, d = np.int32(here[max(i - 1, 0)]), np.int32(here[min(i + 1, w - 1)])
            upright, level_ = _bridged(a, b, limit), _bridged(c, d, limit)
            if upright | level_:
                total = (a + b if upright else 0) + (c + d if level_ else 0)
                count = np.int32(4 if upright & level_ else 2)
                out[j, i], confidence[j, i] = (total + count // 2) // count, MEASURED - 1
                continue
            blue, red = np.float32(cb[j >> 1, i >> 1]), np.float32(cr[j >> 1, i >> 1])
            trust, code = _from_coarse(level, j, i, np.float32(y[j, i]), blue, red)
            out[j, i] = max(np.int32(code + np.float32(0.5)), np.int32(1))
            confidence[j, i] = np.int32(trust * np.float32(MEASURED - 1))

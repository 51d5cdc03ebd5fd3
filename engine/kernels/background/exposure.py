"""Exposure: samples of surfaces that two views see, and the tones of views that follow from them.

A tone here is float64 [3, 3]: for each of luma, cb and cr, relative to black and grey (64, 512, 512), the gain, offset
and tint (share of the luma; 0 for luma itself) with which a view renders the common luma and chroma.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, F64, I64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16
from ..base.project import project_point, unproject_point
from ..base.view_table import EDGE, INVALID, OFFSET, STEP, TOLERANCE

__all__ = ["gather_samples", "weigh_samples"]

BLACK, GREY = 64.0, 512.0
_CODES, _Y, _CB, _CR = range(4)  # columns of the addresses of views
_DARKEST, _BRIGHTEST = 72, 920  # luma codes within which a sensor is neither blocked up nor clipped
_REACH = 2  # distance of samples from depth edges and from the border of the picture, pixels
_LEAST_SCALE = 1.0  # least scale of residuals, codes
_SCALES = 2.0  # residual, in robust standard deviations, at which a sample has lost three quarters of its weight


@serial
def _surface(row: F64, codes: int, u: float, v: float) -> float:
    """Depth code at (u, v); -1 near a depth edge, a pixel without depth, or the border of the picture."""
    width, height = int(row[WIDTH]), int(row[HEIGHT])
    x, y = int(u), int(v)
    if not (x >= _REACH and y >= _REACH and x < width - _REACH and y < height - _REACH):
        return -1.0
    total, low, high = 0, 65535, 0
    for k in range(4):
        dx, dy = (-_REACH, _REACH - 1)[k & 1], (-_REACH, _REACH - 1)[k >> 1]
        code = load_u16(codes, (y + dy) * width + x + dx)
        total, low, high = total + code, min(low, code), max(high, code)
    if high - low > row[EDGE] or (low == 0 and row[INVALID] > 0.0):
        return -1.0
    return 0.25 * total


@inlined
def _bilinear(plane: int, width: int, height: int, u: float, v: float) -> float:
    x, y = min(max(u - 0.5, 0.0), width - 1.0), min(max(v - 0.5, 0.0), height - 1.0)
    x0, y0 = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    right, below = min(1, width - 1), width if height > 1 else 0
    index = y0 * width + x0
    top = load_u16(plane, index) + (x - x0) * (load_u16(plane, index + right) - load_u16(plane, index))
    low: float = load_u16(plane, index + below)
    low = low + (x - x0) * (load_u16(plane, index + below + right) - low)
    return top + (y - y0) * (low - top)


@serial
def _colour(row: F64, planes: I64, u: float, v: float, out: F32) -> bool:
    """Writes luma, cb and cr at (u, v), relative to black and grey; returns False if luma is at an end of its range."""
    width, height = int(row[WIDTH]), int(row[HEIGHT])
    luma = _bilinear(planes[_Y], width, height, u, v)
    if luma < _DARKEST or luma > _BRIGHTEST:
        return False
    half_width, half_height = (width + 1) // 2, (height + 1) // 2
    out[0] = luma - BLACK
    out[1] = _bilinear(planes[_CB], half_width, half_height, 0.5 * u, 0.5 * v) - GREY
    out[2] = _bilinear(planes[_CR], half_width, half_height, 0.5 * u, 0.5 * v) - GREY
    return True


@parallel
def gather_samples(
    table: F64, addresses: I64, pairs: I64, due: I64, columns: int, rows: int, samples: F32, counts: I64
) -> None:  # fmt: skip
    """Colours of surfaces that both views of a pair see, at a grid of columns x rows of the first one's pixels.

    table and addresses: see `kernels.base.view_table`; pairs [p, 2]: rows of these; due: the pairs that are sampled.
    samples [p, columns * rows, 2, 3]: luma, cb, cr of both, relative to black and grey; the first counts[p] are filled.
    """
    for turn in numba.prange(due.shape[0]):
        p = due[turn]
        a, b = pairs[p, 0], pairs[p, 1]
        here, there = table[a], table[b]
        width, height, count = int(here[WIDTH]), int(here[HEIGHT]), 0
        for k in range(columns * rows):
            # The common corner of four pixels, in the middle of their chroma sample: their mean is the colour.
            u = 2.0 * int((k % columns + 0.5) * width / (2.0 * columns)) + 1.0
            v = 2.0 * int((k // columns + 0.5) * height / (2.0 * rows)) + 1.0
            code = _surface(here, addresses[a, _CODES], u, v)
            if code < 0.0:
                continue
            disparity = here[OFFSET] + here[STEP] * code
            if not disparity > 0.0:
                continue
            x, y, z = unproject_point(here, u, v, 1.0 / disparity)
            s, t, depth = project_point(there, x, y, z)
            if not (depth > 0.0 and s >= 0.0 and t >= 0.0 and s < there[WIDTH] and t < there[HEIGHT]):
                continue
            seen = _surface(there, addresses[b, _CODES], s, t)
            if seen < 0.0 or abs((1.0 / depth - there[OFFSET]) / there[STEP] - seen) > there[TOLERANCE]:
                continue
            if _colour(here, addresses[a], u, v, samples[p, count, 0]) and _colour(
                there, addresses[b], s, t, samples[p, count, 1]
            ):
                count += 1
        counts[p] = count


@serial
def _median(values: F64) -> float:
    """The median of some values; their order changes. By Hoare's algorithm FIND (1961): NumPy's, which tells what is no
    number apart, takes more than a second to compile."""
    k = values.shape[0] // 2
    low, high = 0, values.shape[0] - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < k < i:
            break
        low, high = (i, high) if k >= i else (low, j)
    upper = values[k]
    if values.shape[0] % 2:
        return upper
    lower = values[0]  # the largest of those before
    for i in range(1, k):
        lower = max(lower, values[i])
    return (lower + upper) / 2


@inlined
def _common_luma(tone: F64, luma: float) -> float:
    return (luma - tone[0, 1]) / tone[0, 0]


@parallel
def weigh_samples(samples: F32, counts: I64, nodes: I64, tones: F64, information: F64, evidence: F64) -> None:
    """Robust normal equations of each pair and channel, for the difference of the two tones.

    samples, counts: see `gather_samples`; nodes [p, 2]: rows of tones [n, 3, 3], the present estimate. The colours that
    two views a and b render differ by (tone_a - tone_b) . (common value, 1, common luma). The common value is the mean
    of both views' values after the present tones are removed: this is symmetric, so noise does not reduce the gains.
    information [p, 3, 3, 3] and evidence [p, 3, 3]: for each channel, the weighted sums of basis x basis and of
    basis x difference, in units of the pair's noise. Weights are Geman's and McClure's.
    """
    for p in numba.prange(nodes.shape[0]):
        for channel in range(3):  # expressions of arrays take seconds to compile
            for i in range(3):
                evidence[p, channel, i] = 0.0
                for j in range(3):
                    information[p, channel, i, j] = 0.0
        count = counts[p]
        if count == 0:
            continue
        one, two = tones[nodes[p, 0]], tones[nodes[p, 1]]
        basis, difference = np.empty((count, 3)), np.empty(count)
        residual, sizes = np.empty(count), np.empty(count)
        for channel in range(3):
            for k in range(count):
                a, b = samples[p, k, 0], samples[p, k, 1]
                luma_a, luma_b = _common_luma(one, a[0]), _common_luma(two, b[0])
                common_a = (a[channel] - one[channel, 1] - one[channel, 2] * luma_a) / one[channel, 0]
                common_b = (b[channel] - two[channel, 1] - two[channel, 2] * luma_b) / two[channel, 0]
                basis[k, 0], basis[k, 1] = 0.5 * (common_a + common_b), 1.0
                basis[k, 2] = 0.5 * (luma_a + luma_b) if channel else 0.0
                difference[k] = a[channel] - b[channel]
                told = 0.0
                for i in range(3):
                    told += (one[channel, i] - two[channel, i]) * basis[k, i]
                residual[k] = difference[k] - told
                sizes[k] = abs(residual[k])
            scale = max(1.4826 * _median(sizes), _LEAST_SCALE)
            for k in range(count):
                off = residual[k] / (_SCALES * scale)
                weight = 1.0 / ((1.0 + off * off) ** 2 * scale * scale)
                for i in range(3):
                    evidence[p, channel, i] += weight * basis[k, i] * difference[k]
                    for j in range(3):
                        information[p, channel, i, j] += weight * basis[k, i] * basis[k, j]

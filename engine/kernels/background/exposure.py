"""Exposure: samples of surfaces that two views see, and the tones of views that follow from them.

A tone here is float64 [3, 3]: for each of luma, cb and cr, relative to black and grey (64, 512, 512), the gain, offset
and tint (share of the luma; 0 for luma itself) with which a view renders the common luma and chroma.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16
from ..base.project import project_point, unproject_point
from ..base.view_table import EDGE, INVALID, OFFSET, STEP, TOLERANCE

__all__ = ["gather_samples", "solve_tones", "weigh_samples"]

BLACK, GREY = 64.0, 512.0
_CODES, _Y, _CB, _CR = range(4)  # columns of the addresses of views
_DARKEST, _BRIGHTEST = 72, 920  # luma codes within which a sensor is neither blocked up nor clipped
_REACH = 2  # distance of samples from depth edges and from the border of the picture, pixels
_LEAST_SCALE = 1.0  # least scale of residuals, codes
# Conjugate gradients end when the square of the residual has fallen to the share _SOLVED, or after _TURNS times the
# number of iterations that would be enough without rounding.
_SOLVED, _TURNS = 1e-24, 4
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
        information[p] = 0.0
        evidence[p] = 0.0
        count = counts[p]
        if count == 0:
            continue
        one, two = tones[nodes[p, 0]], tones[nodes[p, 1]]
        basis, difference, residual = np.empty((count, 3)), np.empty(count), np.empty(count)
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
            scale = max(1.4826 * np.median(np.abs(residual)), _LEAST_SCALE)
            for k in range(count):
                off = residual[k] / (_SCALES * scale)
                weight = 1.0 / ((1.0 + off * off) ** 2 * scale * scale)
                for i in range(3):
                    evidence[p, channel, i] += weight * basis[k, i] * difference[k]
                    for j in range(3):
                        information[p, channel, i, j] += weight * basis[k, i] * basis[k, j]


@parallel
def solve_tones(
    information: F64, evidence: F64, nodes: I64, weights: F64, precision: F64, off: F64
) -> None:
    """Least squares over all pairs: the differences `off` [n, 3, 3] of the tones from the neutral tone.

    information, evidence, nodes [p, 2]: see `weigh_samples`; a node of n or more is not an unknown. weights [p]: of the
    pairs; precision [3]: of gain, offset and tint about the expected values, which `off` holds at first. The solver is
    conjugate gradients (Hestenes and Stiefel 1952), preconditioned by the block of each tone: a view has few pairs, so
    the work grows with the number of views, not with its cube.
    """
    count = off.shape[0]
    for channel_ in numba.prange(3):
        channel = np.int64(channel_)
        told, tones, blocks = information[:, channel], off[:, channel], np.zeros((count, 3, 3))
        step, towards, pulled = np.zeros((count + 1, 3)), np.zeros((count, 3)), np.zeros((count, 3))
        step[:count] = tones  # the expected tones: the residual then has only the pairs' part of the normal equations
        _pull(told, nodes, weights, step, pulled)
        rest = -pulled
        for p in range(nodes.shape[0]):
            for side in range(2):
                node, sign = nodes[p, side], weights[p] * (1 - 2 * side)
                if node < count:
                    rest[node] += sign * evidence[p, channel]
                    blocks[node] += weights[p] * told[p]
        for k in range(3):
            blocks[:, k, k] += precision[k]
        first = length = 0.0
        for turn in range(_TURNS * 3 * count):
            _solve_blocks(blocks, rest, towards)
            before, length = length, (rest * towards).sum()
            first = max(first, length)
            if length <= _SOLVED * first:
                break
            for k in range(count):
                step[k] = towards[k] + (length / before) * step[k] if turn > 0 else towards[k]
            _pull(told, nodes, weights, step, pulled)
            pulled += precision * step[:count]
            share = length / (step[:count] * pulled).sum()
            tones += share * step[:count]
            rest -= share * pulled


@serial
def _pull(information: F64, nodes: I64, weights: F64, tones: F64, pulled: F64) -> None:
    """pulled [n + 1, 3]: the product of the pairs' matrix (information [p, 3, 3]) with tones [n + 1, 3]. The last row
    is of all nodes n or more, and is 0."""
    count = tones.shape[0] - 1
    pulled[:] = 0.0
    for p in range(nodes.shape[0]):
        a, b = min(nodes[p, 0], count), min(nodes[p, 1], count)
        for i in range(3):
            total = 0.0
            for j in range(3):
                total += information[p, i, j] * (tones[a, j] - tones[b, j])
            if a < count:
                pulled[a, i] += weights[p] * total
            if b < count:
                pulled[b, i] -= weights[p] * total


@serial
def _solve_blocks(blocks: F64, vectors: F64, out: F64) -> None:
    """out [n, 3]: the solutions of systems [n, 3, 3], symmetric and positive definite, by Cholesky's method."""
    factor = np.empty((3, 3))
    for n in range(blocks.shape[0]):
        for i in range(3):
            out[n, i] = vectors[n, i]
            for j in range(i + 1):
                rest = blocks[n, i, j]
                for k in range(j):
                    rest -= factor[i, k] * factor[j, k]
                factor[i, j] = rest / factor[j, j] if j < i else math.sqrt(rest)
            for k in range(i):
                out[n, i] -= factor[i, k] * out[n, k]
            out[n, i] /= factor[i, i]
        for i in range(2, -1, -1):
            for k in range(i + 1, 3):
                out[n, i] -= factor[k, i] * out[n, k]
            out[n, i] /= factor[i, i]

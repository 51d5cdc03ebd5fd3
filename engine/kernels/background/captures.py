"""Colours of captures at picture coordinates, for the PBI and for exported meshes.

A table of captures is int64 [n, CAPTURE_SIZE]: the addresses of a maximum depth image's planes, then its sizes. A
capture may also be an atlas (`background.atlas`): a picture for surfaces that no camera of the rig has seen.
"""

from __future__ import annotations

import math

import numba

from ...support.array_types import F32, I64
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16

__all__ = [
    "CAPTURE_SIZE", "CB", "CODES", "CR", "EDGE", "HEIGHT", "REACH", "SCATTERED", "WIDTH", "WRAPS", "Y", "chroma_at",
    "luma_at", "sample_colours",
]  # fmt: skip

# EDGE: the step between codes that is a depth edge. REACH: pixels that are farther apart in a row or a column may
# belong to different parts of a picture that is made of parts; 0: the picture is whole. SCATTERED: 1 where surfaces
# that meet in space may lie anywhere in the picture, so that only the places in one triangle have something between
# them.
Y, CB, CR, CODES, WIDTH, HEIGHT, WRAPS, EDGE, REACH, SCATTERED = range(10)
CAPTURE_SIZE = 10


@inlined
def _clamped(x: int, size: int, wraps: bool) -> int:
    """A column clamped to the picture, or wrapped round if the picture wraps."""
    return x % size if wraps else min(max(x, 0), size - 1)


@serial
def luma_at(capture: I64, u: float, v: float) -> float:
    """Luma at (u, v), interpolated over those of the four pixels round it that lie on the nearest one's surface."""
    width, height, wraps = capture[WIDTH], capture[HEIGHT], capture[WRAPS] != 0
    x, y = u - 0.5, v - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = _clamped(int(x0), width, wraps), _clamped(int(x0) + 1, width, wraps)
    top, low = width * _clamped(int(y0), height, False), width * _clamped(int(y0) + 1, height, False)
    nearest = load_u16(capture[CODES], (right if fx >= 0.5 else left) + (low if fy >= 0.5 else top))
    total, weights = 0.0, 0.0
    for k in range(4):
        index = (right if k & 1 else left) + (low if k >> 1 else top)
        weight = (fx if k & 1 else 1 - fx) * (fy if k >> 1 else 1 - fy)
        if abs(load_u16(capture[CODES], index) - nearest) <= capture[EDGE]:
            total += weight * load_u16(capture[Y], index)
            weights += weight
    return total / weights


@serial
def chroma_at(capture: I64, u: float, v: float) -> tuple[float, float]:
    """Chroma (cb, cr) at (u, v) of the picture, bilinear."""
    width, height, wraps = (capture[WIDTH] + 1) // 2, (capture[HEIGHT] + 1) // 2, capture[WRAPS] != 0
    x, y = 0.5 * u - 0.5, 0.5 * v - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = _clamped(int(x0), width, wraps), _clamped(int(x0) + 1, width, wraps)
    top, low = width * _clamped(int(y0), height, False), width * _clamped(int(y0) + 1, height, False)
    blue, red = 0.0, 0.0
    for k in range(4):
        index = (right if k & 1 else left) + (low if k >> 1 else top)
        weight = (fx if k & 1 else 1 - fx) * (fy if k >> 1 else 1 - fy)
        blue += weight * load_u16(capture[CB], index)
        red += weight * load_u16(capture[CR], index)
    return blue, red


@parallel
def sample_colours(capture: I64, uv: F32, ycbcr: F32) -> None:
    """Y'CbCr codes [n, 3] of a capture (a row of the table) at picture coordinates [n, 2]."""
    for i in numba.prange(uv.shape[0]):
        ycbcr[i, 0] = luma_at(capture, uv[i, 0], uv[i, 1])
        ycbcr[i, 1], ycbcr[i, 2] = chroma_at(capture, uv[i, 0], uv[i, 1])

"""Shading: one colour for each pixel of a warped picture, fetched from the views that see its surface.

A pixel's disparity gives a point; the point is projected into each view, and a view that measured the same depth
there contributes its colour, bilinear over the texels that lie on that surface. The weight favours views that
look from nearly the same direction (unstructured lumigraph: angle), that resolve the surface at least as finely
(distance), and fades near a picture's border.

A view table is float64 [n, TABLE_SIZE] (packed camera, then the fields below) beside int64 [n, 4], the addresses
of its C-contiguous uint16 arrays: codes, y, cb, cr. The caller keeps the arrays alive.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from .project import CAMERA_SIZE, project_point, unproject_point

__all__ = ["EDGE", "OFFSET", "STEP", "TABLE_SIZE", "TOLERANCE", "MIN_CODE", "INVALID", "SHARPNESS", "load_texel", "shade"]

OFFSET = CAMERA_SIZE  # disparity of code 0
STEP = CAMERA_SIZE + 1  # disparity of a code step
MIN_CODE = CAMERA_SIZE + 2
INVALID = CAMERA_SIZE + 3  # 1 where code 0 means "no depth"
TOLERANCE = CAMERA_SIZE + 4  # codes within which a view agrees
EDGE = CAMERA_SIZE + 5  # code step between texels that is a depth edge
SHARPNESS = CAMERA_SIZE + 6  # pixels a radian, relative to the target's
TABLE_SIZE = CAMERA_SIZE + 7

_BORDER_PX = 8.0  # over which a view fades out near its border

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]


@intrinsic  # type: ignore[misc]
def load_texel(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint16 at address + 2 * index: pictures of different views are reached through one table."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], cgutils.ir.IntType(16).as_pointer())
        value = builder.load(builder.gep(pointer, [args[1]]))
        return builder.zext(value, ir.IntType(64))

    return types.int64(types.int64, types.int64), codegen


@numba.njit(inline="always", cache=True, error_model="numpy")
def _chroma_index(u: float, v: float, width: int, height: int) -> int:
    """The chroma sample whose 2x2 pixels hold (u, v): replicated up, as the reference renderers do."""
    x, y = min(max(int(u), 0), width - 1), min(max(int(v), 0), height - 1)
    return (y // 2) * ((width + 1) // 2) + x // 2


@numba.njit(inline="always", cache=True, error_model="numpy")
def _fetch(
    row: F64, addresses: I64, u: float, v: float, code: float, nearest: bool
) -> tuple[float, float, float, float]:
    """Colour of one view at (u, v) and how much of it lies on the surface of that depth code (0 to 1).

    With `nearest` the texel closest in depth is taken whatever its depth: for the view that drew the pixel.
    """
    width, height = int(row[1]), int(row[2])
    wraps = row[19] > 0.0
    x, y = u - 0.5, min(max(v - 0.5, 0.0), height - 1.0)
    if not wraps:
        x = min(max(x, 0.0), width - 1.0)
    ix, iy = int(math.floor(x)), min(int(y), max(height - 2, 0))
    if not wraps:
        ix = min(ix, max(width - 2, 0))
    fx, fy = x - ix, y - iy
    x0 = ix % width
    x1 = (ix + 1) % width if wraps else min(ix + 1, width - 1)
    y1 = min(iy + 1, height - 1)
    a, b, c, d = iy * width + x0, iy * width + x1, y1 * width + x0, y1 * width + x1
    ca, cb = load_texel(addresses[0], a), load_texel(addresses[0], b)
    cc, cd = load_texel(addresses[0], c), load_texel(addresses[0], d)
    wa, wb, wc, wd = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    low, high = min(min(ca, cb), min(cc, cd)), max(max(ca, cb), max(cc, cd))
    whole = high - low <= row[EDGE] and (low > 0 or row[INVALID] == 0.0)
    if whole:
        if not nearest and abs(wa * ca + wb * cb + wc * cc + wd * cd - code) > row[TOLERANCE]:
            return 0.0, 0.0, 0.0, 0.0
        share = 1.0
    else:
        # An edge runs between the texels: take those of the wanted surface only.
        invalid = row[INVALID] > 0.0
        limit = 0.5 * row[EDGE] + row[TOLERANCE]
        ka = wa if abs(ca - code) <= limit and not (invalid and ca == 0) else 0.0
        kb = wb if abs(cb - code) <= limit and not (invalid and cb == 0) else 0.0
        kc = wc if abs(cc - code) <= limit and not (invalid and cc == 0) else 0.0
        kd = wd if abs(cd - code) <= limit and not (invalid and cd == 0) else 0.0
        share = ka + kb + kc + kd
        if share < 1e-3:
            if not nearest:
                return 0.0, 0.0, 0.0, 0.0
            best = min(min(abs(ca - code), abs(cb - code)), min(abs(cc - code), abs(cd - code)))
            ka = 1.0 if abs(ca - code) == best else 0.0
            kb = 1.0 if abs(cb - code) == best else 0.0
            kc = 1.0 if abs(cc - code) == best else 0.0
            kd = 1.0 if abs(cd - code) == best else 0.0
            share = ka + kb + kc + kd
        inverse = 1.0 / share
        wa, wb, wc, wd = ka * inverse, kb * inverse, kc * inverse, kd * inverse
        # Chroma from the middle of the texels taken.
        u = ix + 0.5 + wb + wd
        v = iy + 0.5 + wc + wd
    luma = (
        wa * load_texel(addresses[1], a) + wb * load_texel(addresses[1], b)
        + wc * load_texel(addresses[1], c) + wd * load_texel(addresses[1], d)
    )  # fmt: skip
    at = _chroma_index(u, v, width, height)
    return luma, float(load_texel(addresses[2], at)), float(load_texel(addresses[3], at)), min(share, 1.0)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _weight(row: F64, u: float, v: float, x: float, y: float, z: float, eye: F64) -> float:
    """Worth of a view for a point: small angle between its ray and the eye's, fine sampling, off the border."""
    ex, ey, ez = x - eye[16], y - eye[17], z - eye[18]
    vx, vy, vz = x - row[16], y - row[17], z - row[18]
    ee, vv = ex * ex + ey * ey + ez * ez, vx * vx + vy * vy + vz * vz
    cx, cy, cz = ey * vz - ez * vy, ez * vx - ex * vz, ex * vy - ey * vx
    angle2 = (cx * cx + cy * cy + cz * cz) / (ee * vv)  # sin^2
    if ex * vx + ey * vy + ez * vz < 0.0:
        angle2 = 2.0 - angle2
    finer = min(1.0, ee * row[SHARPNESS] * row[SHARPNESS] / vv)
    border = 1.0
    if row[19] == 0.0:
        border = min(u, row[1] - u)
        border = min(1.0, max(0.02, min(border, min(v, row[2] - v)) / _BORDER_PX))
    return border * (0.1 + finer) / (3e-5 + angle2)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def shade(
    disparity: F32, winner: U8, camera: F64, table: F64, addresses: I64, n_views: int, blend: int,
    luma: F32, chroma_b: F32, chroma_r: F32,
) -> None:  # fmt: skip
    """Fill luma, chroma_b and chroma_r [h, w] where disparity > 0.

    Rows 0..n_views-1 of the table are the warped views in order of worth; further rows are backdrops, which
    colour only the pixels that they won. At most `blend` agreeing views contribute to a pixel.
    """
    h, w = disparity.shape
    for y in numba.prange(h):
        for x in range(w):
            q = disparity[y, x]
            if q <= 0.0:
                continue
            px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / q)
            drawn = winner[y, x]
            total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
            if drawn < n_views:
                taken = 0
                for k in range(n_views):
                    row = table[k]
                    u, v, depth = project_point(row, px, py, pz)
                    if not (depth > 0.0 and u >= 0.0 and v >= 0.0 and u <= row[1] and v <= row[2]):
                        continue
                    code = (1.0 / depth - row[OFFSET]) / row[STEP]
                    cy, cb, cr, share = _fetch(row, addresses[k], u, v, code, False)
                    if share > 0.0:
                        weight = share * _weight(row, u, v, px, py, pz, camera)
                        total += weight
                        sum_y += weight * cy
                        sum_b += weight * cb
                        sum_r += weight * cr
                        taken += 1
                        if taken == blend:
                            break
            if total <= 0.0:
                row = table[drawn]
                u, v, depth = project_point(row, px, py, pz)
                code = (1.0 / depth - row[OFFSET]) / row[STEP]
                sum_y, sum_b, sum_r, _ = _fetch(row, addresses[drawn], u, v, code, True)
                total = 1.0
            inverse = 1.0 / total
            luma[y, x] = sum_y * inverse
            chroma_b[y, x] = sum_b * inverse
            chroma_r[y, x] = sum_r * inverse

"""The probable background image: what of the model is seen from a camera, with colour (section 3.4.1)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8, U16
from ..base.jit import inlined, parallel, serial
from ..base.project import unproject_point
from ..base.tolerance import Delta
from .rays import farthest_hit, load_f32, load_u16, load_u32
from .standing import standing_hit
from .uncovered import CELL

__all__ = ["render_background", "sample_colours"]


# Columns of the table of maximum depth images: addresses of planes, then sizes.
_Y, _CB, _CR, _CODES, _WIDTH, _HEIGHT, _WRAPS, _EDGE = range(8)
# Columns of a hit.
_DISPARITY, _U, _V, _SOURCE, _GEOMETRY, _PRIMITIVE, _DISTANCE = range(7)
_FLAT = 5e-4  # share of its distance by which a hit may be off a plane that it is taken to lie on


@inlined
def _load(plane: int, at: int) -> int:
    return numba.int64(load_u16(plane + 2 * at))


@inlined
def _clamped(x: int, size: int, wraps: bool) -> int:
    """Beyond the border the nearest sample, or the other side's where the picture wraps."""
    return x % size if wraps else min(max(x, 0), size - 1)


@serial
def _luma(image: I64, u: float, v: float) -> float:
    """Luma at (u, v), from those of the four pixels around that lie on the nearest one's surface."""
    width, height, wraps = image[_WIDTH], image[_HEIGHT], image[_WRAPS] != 0
    x, y = u - 0.5, v - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = _clamped(int(x0), width, wraps), _clamped(int(x0) + 1, width, wraps)
    top, low = width * _clamped(int(y0), height, False), width * _clamped(int(y0) + 1, height, False)
    own = _load(image[_CODES], (right if fx >= 0.5 else left) + (low if fy >= 0.5 else top))
    total, weights = 0.0, 0.0
    for k in range(4):
        at = (right if k & 1 else left) + (low if k >> 1 else top)
        weight = (fx if k & 1 else 1 - fx) * (fy if k >> 1 else 1 - fy)
        if abs(_load(image[_CODES], at) - own) <= image[_EDGE]:
            total += weight * _load(image[_Y], at)
            weights += weight
    return total / weights


@serial
def _chroma(image: I64, u: float, v: float) -> tuple[float, float]:
    """Chroma at (u, v) of the picture, bilinear."""
    width, height, wraps = (image[_WIDTH] + 1) // 2, (image[_HEIGHT] + 1) // 2, image[_WRAPS] != 0
    x, y = 0.5 * u - 0.5, 0.5 * v - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = _clamped(int(x0), width, wraps), _clamped(int(x0) + 1, width, wraps)
    top, low = width * _clamped(int(y0), height, False), width * _clamped(int(y0) + 1, height, False)
    blue, red = 0.0, 0.0
    for k in range(4):
        at = (right if k & 1 else left) + (low if k >> 1 else top)
        weight = (fx if k & 1 else 1 - fx) * (fy if k >> 1 else 1 - fy)
        blue += weight * _load(image[_CB], at)
        red += weight * _load(image[_CR], at)
    return blue, red


@serial
def _hit_uv(surface: I64, primitive: int, hu: float, hv: float) -> tuple[float, float]:
    """Source picture coordinates at a triangle's barycentric (hu, hv)."""
    corner = surface[0] + 12 * primitive
    a = surface[1] + 8 * numba.int64(load_u32(corner))
    b = surface[1] + 8 * numba.int64(load_u32(corner + 4))
    c = surface[1] + 8 * numba.int64(load_u32(corner + 8))
    wa = 1.0 - hu - hv
    return (
        wa * load_f32(a) + hu * load_f32(b) + hv * load_f32(c),
        wa * load_f32(a + 4) + hu * load_f32(b + 4) + hv * load_f32(c + 4),
    )


@serial
def _cast(
    function: int, scene: int, camera: F64, bounds: F64, surfaces: I64, near: float, present: F64, codes: I64,
    delta: Delta, x: int, y: int, hits: F64, k: int,
) -> int:  # fmt: skip
    """What is shown behind a pixel's centre, into hits[k] [7]: disparity (0: nothing), source u and v, source
    camera, geometry, primitive, distance; returns the rays cast."""
    u, v, rays = x + 0.5, y + 0.5, 1
    if present.shape[0] == 0:
        distance, hu, hv, geometry, primitive, length = farthest_hit(function, scene, camera, bounds, u, v)
    else:
        distance, hu, hv, geometry, primitive, length, rays = standing_hit(
            function, scene, camera, bounds, u, v, near, surfaces, present, codes, delta
        )
    if not distance > 0.0:
        hits[k, _DISPARITY], hits[k, _SOURCE] = 0.0, -1.0
        return rays
    hits[k, _DISPARITY], hits[k, _DISTANCE] = length / distance, distance
    hits[k, _U], hits[k, _V] = _hit_uv(surfaces[geometry], primitive, hu, hv)
    hits[k, _SOURCE], hits[k, _GEOMETRY], hits[k, _PRIMITIVE] = surfaces[geometry, 2], geometry, primitive
    return rays


@serial
def _on_plane(surfaces: I64, images: I64, camera: F64, hits: F64, a: int, b: int, x: int, y: int) -> bool:
    """Whether hits[b], of pixel (x, y), lies on the plane of hits[a]'s triangle, and both have their colour near by."""
    if (
        hits[a, _SOURCE] != hits[b, _SOURCE]
        or hits[a, _SOURCE] < 0.0
        or abs(hits[a, _U] - hits[b, _U]) > 0.5 * images[int(hits[a, _SOURCE]), _WIDTH]
    ):
        return False
    if hits[a, _PRIMITIVE] == hits[b, _PRIMITIVE] and hits[a, _GEOMETRY] == hits[b, _GEOMETRY]:
        return True
    surface = surfaces[int(hits[a, _GEOMETRY])]
    corners = surface[0] + 12 * int(hits[a, _PRIMITIVE])
    p = surface[3] + 12 * numba.int64(load_u32(corners))
    q = surface[3] + 12 * numba.int64(load_u32(corners + 4))
    r = surface[3] + 12 * numba.int64(load_u32(corners + 8))
    px, py, pz = load_f32(p), load_f32(p + 4), load_f32(p + 8)
    ex, ey, ez = load_f32(q) - px, load_f32(q + 4) - py, load_f32(q + 8) - pz
    fx, fy, fz = load_f32(r) - px, load_f32(r + 4) - py, load_f32(r + 8) - pz
    nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    bx, by, bz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / hits[b, _DISPARITY])
    off = abs(nx * (bx - px) + ny * (by - py) + nz * (bz - pz))
    return off <= _FLAT * hits[b, _DISTANCE] * math.sqrt(nx * nx + ny * ny + nz * nz)


@serial
def _colour(images: I64, hits: F64, y: U16, pair: int, column: int) -> tuple[float, float]:
    """Luma of the 2x2 pixels with the given hits [4, 7]; returns their chroma."""
    h, w = y.shape
    u, v, blue, red, count = 0.0, 0.0, 0.0, 0.0, 0
    one = True  # source picture
    for k in range(4):
        row, x = 2 * pair + (k >> 1), 2 * column + (k & 1)
        if row >= h or x >= w:
            continue
        if hits[k, _SOURCE] < 0.0:
            y[row, x] = 0
            continue
        y[row, x] = int(_luma(images[int(hits[k, _SOURCE])], hits[k, _U], hits[k, _V]) + 0.5)
        u, v, count = u + hits[k, _U], v + hits[k, _V], count + 1
        one &= hits[k, _SOURCE] == hits[0, _SOURCE] and abs(hits[k, _U] - hits[0, _U]) < 0.5 * images[0, _WIDTH]
    if count == 0:
        return 512.0, 512.0
    if one:
        return _chroma(images[int(hits[0, _SOURCE])], u / count, v / count)
    for k in range(4):
        if 2 * pair + (k >> 1) < h and 2 * column + (k & 1) < w and hits[k, _SOURCE] >= 0.0:
            own_blue, own_red = _chroma(images[int(hits[k, _SOURCE])], hits[k, _U], hits[k, _V])
            blue, red = blue + own_blue, red + own_red
    return blue / count, red / count


@serial
def _mean(hits: F64, k: int, grid: F64, a: int, b: int) -> None:
    """Puts the middle of two hits of one plane into hits[k]."""
    hits[k, _SOURCE] = grid[a, _SOURCE]
    for i in (_DISPARITY, _U, _V):
        hits[k, i] = 0.5 * (grid[a, i] + grid[b, i])


@inlined
def _is_wanted(wanted: U8, pair: int, column: int, before: int) -> bool:
    """Whether a 2x2 of pixels, or one up to `before` to the left of it or above it, is in a cell that is wanted."""
    if wanted.size == 0:
        return True
    y, x = 2 * pair // CELL, 2 * column // CELL
    top, left = 2 * max(pair - before, 0) // CELL, 2 * max(column - before, 0) // CELL
    return (wanted[y, x] | wanted[top, x] | wanted[y, left] | wanted[top, left]) != 0


@parallel
def render_background(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, largest: int,
    surfaces: I64, images: I64, near: float, present: F64, seen: I64, delta: Delta, sparse: bool,
    wanted: U8, codes: U16, y: U16, cb: U16, cr: U16,
) -> int:  # fmt: skip
    """Fills a view of the background, code 0 where there is none; returns the rays cast.

    What is shown is the farthest hit where `present` has no rows, else the nearest that stands: near, present, seen
    and delta as near, table, codes and delta in `standing_hit`.

    surfaces [geometries, 4]: addresses of triangles and uv, the owner camera, address of points; images [cameras, 8]:
    see the constants above. coding as in `coverage.keep_farther`, `largest` its largest code. With `sparse` rays
    are cast through every second pixel both ways, and between these only where they do not meet one plane. Chroma is
    the mean over the pixels of a 2x2 that are not holes. Cells that are not `wanted` (see `uncovered`; one with no
    elements: all are) are left as holes.
    """
    h, w = codes.shape
    rows, columns = cb.shape
    grid, rays = np.empty((rows * columns, 7)), 0
    for pair in numba.prange(rows):
        for column in range(columns):
            if _is_wanted(wanted, pair, column, 1):
                rays += _cast(
                    function, scene, camera, bounds, surfaces, near, present, seen, delta,
                    2 * column, 2 * pair, grid, pair * columns + column,
                )  # fmt: skip
    for pair in numba.prange(rows):
        hits = np.empty((4, 7))
        for column in range(columns):
            x, row, own = 2 * column, 2 * pair, pair * columns + column
            if not _is_wanted(wanted, pair, column, 0):
                codes[row : row + 2, x : x + 2], y[row : row + 2, x : x + 2] = 0, 0
                cb[pair, column], cr[pair, column] = 512, 512
                continue
            right, below = own + 1, own + columns
            inside = sparse and pair + 1 < rows and column + 1 < columns
            for i in range(7):
                hits[0, i] = grid[own, i]
            flat_right = inside and _on_plane(surfaces, images, camera, grid, own, right, x + 2, row)
            flat_below = inside and _on_plane(surfaces, images, camera, grid, own, below, x, row + 2)
            if flat_right:
                _mean(hits, 1, grid, own, right)
            elif x + 1 < w:
                rays += _cast(
                    function, scene, camera, bounds, surfaces, near, present, seen, delta, x + 1, row, hits, 1
                )
            if flat_below:
                _mean(hits, 2, grid, own, below)
            elif row + 1 < h:
                rays += _cast(
                    function, scene, camera, bounds, surfaces, near, present, seen, delta, x, row + 1, hits, 2
                )
            if flat_right and flat_below and _on_plane(surfaces, images, camera, grid, own, below + 1, x + 2, row + 2):
                _mean(hits, 3, grid, own, below + 1)
            elif x + 1 < w and row + 1 < h:
                rays += _cast(
                    function, scene, camera, bounds, surfaces, near, present, seen, delta, x + 1, row + 1, hits, 3
                )
            for k in range(4):
                if row + (k >> 1) < h and x + (k & 1) < w:
                    code = math.floor((hits[k, _DISPARITY] - coding[0]) / coding[1] + 0.5)
                    limited = int(min(max(code, 1.0), float(largest)))
                    codes[row + (k >> 1), x + (k & 1)] = limited if hits[k, _SOURCE] >= 0.0 else 0
            blue, red = _colour(images, hits, y, pair, column)
            cb[pair, column], cr[pair, column] = int(blue + 0.5), int(red + 0.5)
    return rays


@parallel
def sample_colours(image: I64, uv: F32, ycbcr: F32) -> None:
    """Y'CbCr codes [n, 3] of a maximum depth image (a row of the table of images) at picture coordinates [n, 2]."""
    for i in numba.prange(uv.shape[0]):
        ycbcr[i, 0] = _luma(image, uv[i, 0], uv[i, 1])
        ycbcr[i, 1], ycbcr[i, 2] = _chroma(image, uv[i, 0], uv[i, 1])

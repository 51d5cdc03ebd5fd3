"""The probable background image: farthest hits seen from a camera, with colour (section 3.4.1)."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from .rays import farthest_hit, load_f32, load_u16, load_u32

__all__ = ["render_background", "sample_colours"]

U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

# Columns of the table of maximum depth images: addresses of planes, then sizes.
_Y, _CB, _CR, _CODES, _WIDTH, _HEIGHT, _WRAPS, _EDGE = range(8)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _texel(plane: int, x: int, y: int, width: int, height: int, wraps: bool) -> int:
    """One sample of a uint16 plane, beyond the border the nearest one (or the other side's, where it wraps)."""
    y = min(max(y, 0), height - 1)
    x = x % width if wraps else min(max(x, 0), width - 1)
    return numba.int64(load_u16(plane + 2 * (y * width + x)))


@numba.njit(inline="always", cache=True, error_model="numpy")
def _bilinear(plane: int, x: float, y: float, width: int, height: int, wraps: bool) -> float:
    """A plane between its samples; sample centres at integers."""
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    xi, yi = int(x0), int(y0)
    top = (1 - fx) * _texel(plane, xi, yi, width, height, wraps) + fx * _texel(plane, xi + 1, yi, width, height, wraps)
    low = (1 - fx) * _texel(plane, xi, yi + 1, width, height, wraps) + fx * _texel(
        plane, xi + 1, yi + 1, width, height, wraps
    )
    return (1 - fy) * top + fy * low


@numba.njit(inline="always", cache=True, error_model="numpy")
def _luma(image: I64, u: float, v: float) -> float:
    """Luma at (u, v), from those of the four pixels around that lie on the nearest one's surface."""
    width, height, wraps = image[_WIDTH], image[_HEIGHT], image[_WRAPS] != 0
    x, y = u - 0.5, v - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    own = _texel(image[_CODES], int(x0) + (fx >= 0.5), int(y0) + (fy >= 0.5), width, height, wraps)
    total, weights = 0.0, 0.0
    for k in range(4):
        dx, dy = k & 1, k >> 1
        code = _texel(image[_CODES], int(x0) + dx, int(y0) + dy, width, height, wraps)
        if abs(code - own) <= image[_EDGE]:
            weight = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
            total += weight * _texel(image[_Y], int(x0) + dx, int(y0) + dy, width, height, wraps)
            weights += weight
    return total / weights


@numba.njit(inline="always", cache=True, error_model="numpy")
def _chroma(image: I64, u: float, v: float) -> tuple[float, float]:
    width, height = (image[_WIDTH] + 1) // 2, (image[_HEIGHT] + 1) // 2
    x, y, wraps = 0.5 * u - 0.5, 0.5 * v - 0.5, image[_WRAPS] != 0
    return (
        _bilinear(image[_CB], x, y, width, height, wraps),
        _bilinear(image[_CR], x, y, width, height, wraps),
    )


@numba.njit(inline="always", cache=True, error_model="numpy")
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


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def render_background(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, largest: int,
    surfaces: I64, images: I64, codes: U16, y: U16, cb: U16, cr: U16,
) -> None:  # fmt: skip
    """Fills a view of the background; code 0 where there is none.

    surfaces [geometries, 3]: addresses of triangles and uv, and the owner camera; images [cameras, 8]: see the
    constants above. coding as in `coverage.keep_farther`, `largest` its largest code. Chroma is the mean over
    the pixels of a 2x2 that are not holes.
    """
    h, w = codes.shape
    for pair in numba.prange(cb.shape[0]):
        for column in range(cb.shape[1]):
            blue, red, count = 0.0, 0.0, 0
            for row in range(2 * pair, min(2 * pair + 2, h)):
                for x in range(2 * column, min(2 * column + 2, w)):
                    distance, hu, hv, geometry, primitive, length = farthest_hit(
                        function, scene, camera, bounds, x + 0.5, row + 0.5
                    )
                    if not distance > 0.0:
                        codes[row, x], y[row, x] = 0, 0
                        continue
                    disparity = length / distance
                    code = math.floor((disparity - coding[0]) / coding[1] + 0.5)
                    codes[row, x] = int(min(max(code, 1.0), float(largest)))
                    u, v = _hit_uv(surfaces[geometry], primitive, hu, hv)
                    image = images[surfaces[geometry, 2]]
                    y[row, x] = int(_luma(image, u, v) + 0.5)
                    own_blue, own_red = _chroma(image, u, v)
                    blue, red, count = blue + own_blue, red + own_red, count + 1
            cb[pair, column] = int(blue / count + 0.5) if count else 512
            cr[pair, column] = int(red / count + 0.5) if count else 512


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def sample_colours(image: I64, uv: F32, ycbcr: F32) -> None:
    """Y'CbCr codes [n, 3] of a maximum depth image (a row of the table of images) at picture coordinates [n, 2]."""
    for i in numba.prange(uv.shape[0]):
        ycbcr[i, 0] = _luma(image, uv[i, 0], uv[i, 1])
        ycbcr[i, 1], ycbcr[i, 2] = _chroma(image, uv[i, 0], uv[i, 1])

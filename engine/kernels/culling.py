"""Marking of background triangles by rays cast from outside the scene toward a camera (section 3.3.2, Fig. 6a)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .project import project_point
from .rays import INVALID_ID, intersect1, or_u64, outside_ray

__all__ = ["OFFSETS", "mark_grid", "mark_through"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

# Toward the centroids of the two triangles that a pixel owns in the quad to its north-east (Fig. 4), a little.
OFFSETS = ((0.2, -0.1), (0.1, -0.2))


@numba.njit(inline="always", cache=True, error_model="numpy")
def _mark_along(
    function: int, scene: int, query: int, camera: F64, bounds: F64, u: float, v: float,
    delta: float, marks: I64, word: int, bits: int,
) -> int:  # fmt: skip
    """Marks the farthest triangle behind (u, v) and all within delta around it; returns the rays cast."""
    x, y, z, dx, dy, dz, far, _length = outside_ray(camera, bounds, u, v)
    if not far > 0.0:
        return 0
    ox, oy, oz = np.float32(x), np.float32(y), np.float32(z)
    fx, fy, fz = np.float32(dx), np.float32(dy), np.float32(dz)
    t, _hu, _hv, geometry, primitive = intersect1(
        function, scene, 0, ox, oy, oz, fx, fy, fz, np.float32(0.0), np.float32(far)
    )
    if geometry == INVALID_ID:
        return 1
    address = marks[geometry, 0] + numba.int64(primitive) * marks[geometry, 1] + 8 * word
    or_u64(address, numba.uint64(bits))
    if delta <= 0.0:
        return 1
    near = np.float32(max(t - 0.5 * delta, 0.0))
    intersect1(function, scene, query, ox, oy, oz, fx, fy, fz, near, np.float32(t + 0.5 * delta))
    return 2


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_grid(
    function: int, scene: int, query: int, camera: F64, bounds: F64, stride: int,
    delta: float, marks: I64, word: int, bits: int,
) -> int:  # fmt: skip
    """Two rays for every stride-th pixel, every stride-th row; returns the number of rays cast.

    `query` is a MarkQuery of the same marks table, word and bits (one camera's: threads only ever set the
    same bits, so that they cannot undo one another).
    """
    w, h = int(camera[1]), int(camera[2])
    rays = 0
    for row in numba.prange((h + stride - 1) // stride):
        v = min(row * stride + stride // 2, h - 1) + 0.5
        for column in range((w + stride - 1) // stride):
            u = min(column * stride + stride // 2, w - 1) + 0.5
            for k in range(2):
                rays += _mark_along(
                    function, scene, query, camera, bounds, u + OFFSETS[k][0], v + OFFSETS[k][1],
                    delta, marks, word, bits,
                )  # fmt: skip
    return rays


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_through(
    function: int, scene: int, query: int, camera: F64, bounds: F64, points: F32,
    delta: float, marks: I64, word: int, bits: int,
) -> int:  # fmt: skip
    """One ray through each of the points [n, 3] that the camera has in its picture; returns the rays cast."""
    rays = 0
    for i in numba.prange(points.shape[0]):
        u, v, depth = project_point(camera, points[i, 0], points[i, 1], points[i, 2])
        if depth > 0.0 and u >= 0.0 and v >= 0.0 and u < camera[1] and v < camera[2]:
            rays += _mark_along(function, scene, query, camera, bounds, u, v, delta, marks, word, bits)
    return rays

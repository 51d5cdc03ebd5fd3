"""Marking of background triangles by rays cast from outside the scene toward a camera (section 3.3.2, Fig. 6a)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I32, I64, U8, U64
from ..base.jit import inlined, parallel, serial
from ..base.project import project_point
from ..base.tolerance import Delta, delta_at
from .rays import INVALID_ID, ROUNDING, distance_to_exit, intersect1, is_free, or_u64, outside_ray

__all__ = ["OFFSETS", "SAMPLES", "SMALL_PX", "list_unmarked", "mark_by_triangle", "mark_grid"]


# Toward the centroids of the two triangles that a pixel owns in the quad to its north-east (Fig. 4), a little.
OFFSETS = ((0.2, -0.1), (0.1, -0.2))
# Two of the barycentric coordinates of points that stand for a triangle: the centroid first; for triangles that
# are larger than some pixels in their own picture also points near corners and near the middles of sides.
_THIRD = 1.0 / 3.0
SAMPLES = (
    (_THIRD, _THIRD), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45),
)  # fmt: skip
SMALL_PX = 2.5


@inlined
def _mark_along(
    function: int, scene: int, query: int, camera: F64, bounds: F64, u: float, v: float,
    delta: Delta, marks: I64, word: int, bits: int,
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
    half = 0.5 * delta_at(delta, far - t)
    if half <= 0.0:
        return 1
    near = np.float32(max(t - half, 0.0))
    intersect1(function, scene, query, ox, oy, oz, fx, fy, fz, near, np.float32(t + half))
    return 2


@parallel
def mark_grid(
    function: int, scene: int, query: int, camera: F64, bounds: F64, stride: int,
    delta: Delta, marks: I64, word: int, bits: int,
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


@inlined
def _looks(occluded: int, scene: int, camera: F64, bounds: F64, x: float, y: float, z: float, delta: Delta) -> int:
    """What a camera says of a point: 0: not in its picture; 1: something is farther by delta / 2; 2: nothing is."""
    u, v, depth = project_point(camera, x, y, z)
    if not (depth > 0.0 and u >= 0.0 and v >= 0.0 and u < camera[1] and v < camera[2]):
        return 0
    dx, dy, dz = x - camera[16], y - camera[17], z - camera[18]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / distance, dy / distance, dz / distance
    far = distance_to_exit(bounds, camera[16], camera[17], camera[18], dx, dy, dz)
    # Only up to the point's neighbourhood: most rays meet nothing at all on their way.
    reach = far - distance - max(0.5 * delta_at(delta, distance), ROUNDING * distance)
    if not reach > 0.0:
        return 2
    x, y, z = camera[16] + far * dx, camera[17] + far * dy, camera[18] + far * dz
    return 2 if is_free(occluded, scene, x, y, z, -dx, -dy, -dz, reach) else 1


@parallel
def mark_by_triangle(
    occluded: int, scene: int, cameras: F64, order: I64, run: int, bounds: F64, points: F32, uv: F32,
    triangles: I32, which: I64, delta: Delta, marks: U64,
) -> int:  # fmt: skip
    """Gives triangles `which` [n] the mark of the first camera that has one as background; returns the rays cast.

    A triangle is background where nothing lies more than delta / 2 behind one of its sample points, as a camera sees
    it. Cameras (packed, [cameras, 20]) are asked in the given order; with run > 0, every `run` triangles begin
    with the next one, so that each camera gets its share.
    """
    rays = 0
    for i in numba.prange(which.shape[0]):
        a, b, c = triangles[which[i], 0], triangles[which[i], 1], triangles[which[i], 2]
        first = i // run if run > 0 else 0
        extent = max(
            max(uv[a, 0], uv[b, 0], uv[c, 0]) - min(uv[a, 0], uv[b, 0], uv[c, 0]),
            max(uv[a, 1], uv[b, 1], uv[c, 1]) - min(uv[a, 1], uv[b, 1], uv[c, 1]),
        )
        found = -1
        for k in range(len(SAMPLES) if extent > SMALL_PX else 1):
            p, q = SAMPLES[k]
            r = 1.0 - p - q
            x = p * points[a, 0] + q * points[b, 0] + r * points[c, 0]
            y = p * points[a, 1] + q * points[b, 1] + r * points[c, 1]
            z = p * points[a, 2] + q * points[b, 2] + r * points[c, 2]
            for j in range(order.shape[0]):
                camera = order[(first + j) % order.shape[0]]
                said = _looks(occluded, scene, cameras[camera], bounds, x, y, z, delta)
                rays += said > 0
                if said == 2:
                    found = camera
                    break
            if found >= 0:
                marks[which[i], found // 64] |= np.uint64(1) << np.uint64(found % 64)
                break
    return rays


@serial
def list_unmarked(marks: U64, invalid: U8, numbers: I64) -> int:
    """Write the numbers of valid triangles (invalid [m] 0) without any bit in marks [m, words]; returns how many."""
    count = 0
    for i in range(invalid.shape[0]):
        found = np.uint64(invalid[i])
        for word in range(marks.shape[1]):
            found |= marks[i, word]
        numbers[count] = i
        count += found == np.uint64(0)
    return count

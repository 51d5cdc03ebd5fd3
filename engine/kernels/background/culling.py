"""Foreground culling (section 3.3.2): rays from outside the scene find the triangles that are background.

This is the default: rays through points of the triangles. The paper's way, rays through pixels, each followed by a
complementary ray, is in `complementary_rays`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64, I64, U8, U64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.project import project_point
from ..base.tolerance import Delta, delta_at
from .lines import along, from_camera
from .rays import ROUNDING, Tracer, distance_to_exit, is_free
from .surfaces import Triangles

__all__ = ["SAMPLES", "SMALL_PX", "extent_px", "list_unmarked", "mark_by_triangle", "sample_point"]


# Two of the barycentric coordinates of a triangle's sample points: first the centroid; then, for triangles larger than
# some pixels in their own picture, points near the corners and near the middles of sides.
_THIRD = 1.0 / 3.0
SAMPLES = (
    (_THIRD, _THIRD), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45),
)  # fmt: skip
SMALL_PX = 2.5
_OUTSIDE, _FOREGROUND, _BACKGROUND = 0, 1, 2  # a camera's verdict on a point


@inlined
def _judge(tracer: Tracer, camera: F64, x: float, y: float, z: float, delta: Delta) -> int:
    """A camera's verdict on a point: _OUTSIDE its picture; _FOREGROUND if a surface is farther by more than delta / 2;
    else _BACKGROUND."""
    u, v, depth = project_point(camera, x, y, z)
    if not (depth > 0.0 and u >= 0.0 and v >= 0.0 and u < camera[WIDTH] and v < camera[HEIGHT]):
        return _OUTSIDE
    dx, dy, dz = from_camera(camera, x, y, z)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / distance, dy / distance, dz / distance
    far = distance_to_exit(tracer.bounds, camera, dx, dy, dz)
    # The ray ends near the point: most rays meet nothing on their way.
    reach = far - distance - max(0.5 * delta_at(delta, distance), ROUNDING * distance)
    if not reach > 0.0:
        return _BACKGROUND
    x, y, z = along(camera, far, dx, dy, dz)
    return _BACKGROUND if is_free(tracer, x, y, z, -dx, -dy, -dz, reach) else _FOREGROUND


@inlined
def extent_px(mesh: Triangles, a: int, b: int, c: int) -> float:
    """The larger side, in pixels, of the bounding box of the triangle of points a, b and c in its own picture."""
    uv = mesh.uv
    return max(
        max(uv[a, 0], uv[b, 0], uv[c, 0]) - min(uv[a, 0], uv[b, 0], uv[c, 0]),
        max(uv[a, 1], uv[b, 1], uv[c, 1]) - min(uv[a, 1], uv[b, 1], uv[c, 1]),
    )


@inlined
def sample_point(mesh: Triangles, i: int, k: int) -> tuple[float, float, float]:
    """Sample point k of a triangle (SAMPLES); the first one is its middle."""
    points, a, b, c = mesh.points, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    p, q = SAMPLES[k]
    r = 1.0 - p - q
    return (
        p * points[a, 0] + q * points[b, 0] + r * points[c, 0],
        p * points[a, 1] + q * points[b, 1] + r * points[c, 1],
        p * points[a, 2] + q * points[b, 2] + r * points[c, 2],
    )


@parallel
def mark_by_triangle(
    tracer: Tracer, cameras: F64, order: I64, run: int, mesh: Triangles, which: I64, delta: Delta, marks: U64
) -> int:
    """Gives each of the triangles `which` [n] the mark of the first camera that finds it to be background; returns the
    number of rays.

    A triangle is background if, as seen from a camera, nothing lies more than delta / 2 behind one of its sample
    points. Cameras (packed, [cameras, CAMERA_SIZE]) are asked in the given order; with run > 0, the first camera is the
    next one after every `run` triangles, so that each camera gets its share of the marks.
    """
    rays = 0
    for i in numba.prange(which.shape[0]):
        triangles = mesh.triangles
        a, b, c = triangles[which[i], 0], triangles[which[i], 1], triangles[which[i], 2]
        first = i // run if run > 0 else 0
        found = -1
        for k in range(len(SAMPLES) if extent_px(mesh, a, b, c) > SMALL_PX else 1):
            x, y, z = sample_point(mesh, which[i], k)
            for j in range(order.shape[0]):
                camera = order[(first + j) % order.shape[0]]
                verdict = _judge(tracer, cameras[camera], x, y, z, delta)
                rays += verdict != _OUTSIDE
                if verdict == _BACKGROUND:
                    found = camera
                    break
            if found >= 0:
                marks[which[i], found // 64] |= np.uint64(1) << np.uint64(found % 64)
                break
    return rays


@serial
def list_unmarked(marks: U64, invalid: U8, numbers: I64) -> int:
    """Writes the numbers of valid triangles (invalid [m] 0) without a bit in marks [m, words]; returns their count."""
    count = 0
    for i in range(invalid.shape[0]):
        found = np.uint64(invalid[i])
        for word in range(marks.shape[1]):
            found |= marks[i, word]
        numbers[count] = i
        count += found == np.uint64(0)
    return count

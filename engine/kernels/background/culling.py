"""Foreground culling (section 3.3.2): rays from outside the scene find the triangles that are background.

`mark_by_triangle` is the default: rays through points of the triangles. `mark_by_pixel` is the paper's way: two rays
per pixel, each followed by a complementary ray (Fig. 6a).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64, I64, U8, U64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.memory import or_u64
from ..base.project import project_point
from ..base.tolerance import Delta, delta_at
from .intersect import intersect1
from .lines import along, from_camera
from .ray_hit import INVALID_ID
from .rays import ROUNDING, Tracer, distance_to_exit, is_free, outside_ray
from .surfaces import MARKS, WORDS, Triangles

__all__ = ["OFFSETS", "SAMPLES", "SMALL_PX", "extent_px", "list_unmarked", "mark_by_pixel", "mark_by_triangle"]


# Offsets from a pixel's centre into the two triangles that it owns in the quad to its north-east (Fig. 4). They are
# right for both diagonals: quads are divided by either in turn, and at a depth edge only one triangle may be left.
OFFSETS = ((0.72, -0.47), (0.27, -0.54))
# Two of the barycentric coordinates of a triangle's sample points: first the centroid; then, for triangles larger than
# some pixels in their own picture, points near the corners and near the middles of sides.
_THIRD = 1.0 / 3.0
SAMPLES = (
    (_THIRD, _THIRD), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45),
)  # fmt: skip
SMALL_PX = 2.5
_OUTSIDE, _FOREGROUND, _BACKGROUND = 0, 1, 2  # a camera's verdict on a point


@inlined
def _mark_along(
    tracer: Tracer, query: int, camera: F64, u: float, v: float, delta: Delta, marks: I64, word: int, bits: int
) -> int:
    """Marks the farthest triangle behind (u, v) and, by the complementary ray, all triangles from delta / 2 before it
    to delta / 2 behind it; returns the number of rays."""
    x, y, z, dx, dy, dz, far, _length = outside_ray(camera, tracer.bounds, u, v)
    if not far > 0.0:
        return 0
    ox, oy, oz = np.float32(x), np.float32(y), np.float32(z)
    fx, fy, fz = np.float32(dx), np.float32(dy), np.float32(dz)
    t, _hu, _hv, geometry, primitive = intersect1(
        tracer.intersect, tracer.scene, 0, ox, oy, oz, fx, fy, fz, np.float32(0.0), np.float32(far)
    )
    if geometry == INVALID_ID:
        return 1
    index = numba.int64(primitive) * marks[geometry, WORDS] + word
    or_u64(marks[geometry, MARKS], index, numba.uint64(bits))
    half = 0.5 * delta_at(delta, far - t)
    if half <= 0.0:
        return 1
    near = np.float32(max(t - half, 0.0))
    intersect1(tracer.intersect, tracer.scene, query, ox, oy, oz, fx, fy, fz, near, np.float32(t + half))
    return 2


@parallel
def mark_by_pixel(
    tracer: Tracer, query: int, camera: F64, stride: int, delta: Delta, marks: I64, word: int, bits: int
) -> int:
    """Casts two rays, each with its complementary ray, for every stride-th pixel in both directions; returns the number
    of rays.

    `query`: address of a MarkQuery with the same table of marks, word and bits. The bits are of one camera, so all
    threads set the same bits and cannot undo one another's.
    """
    w, h = int(camera[WIDTH]), int(camera[HEIGHT])
    rays = 0
    for row in numba.prange((h + stride - 1) // stride):
        v = min(row * stride + stride // 2, h - 1) + 0.5
        for column in range((w + stride - 1) // stride):
            u = min(column * stride + stride // 2, w - 1) + 0.5
            for k in range(2):
                rays += _mark_along(
                    tracer, query, camera, u + OFFSETS[k][0], v + OFFSETS[k][1], delta, marks, word, bits
                )
    return rays


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
        points, triangles = mesh.points, mesh.triangles
        a, b, c = triangles[which[i], 0], triangles[which[i], 1], triangles[which[i], 2]
        first = i // run if run > 0 else 0
        found = -1
        for k in range(len(SAMPLES) if extent_px(mesh, a, b, c) > SMALL_PX else 1):
            p, q = SAMPLES[k]
            r = 1.0 - p - q
            x = p * points[a, 0] + q * points[b, 0] + r * points[c, 0]
            y = p * points[a, 1] + q * points[b, 1] + r * points[c, 1]
            z = p * points[a, 2] + q * points[b, 2] + r * points[c, 2]
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

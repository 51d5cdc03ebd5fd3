"""Rays that kernels cast: from outside the scene toward a camera, and from a camera."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64
from ...support.packed import POSITION
from ..base.jit import inlined, serial
from ..base.project import position, unproject_point
from .intersect import intersect1
from .lines import along, from_camera
from .ray_hit import INVALID_ID

__all__ = [
    "BESIDE_PX",
    "ROUNDING",
    "Tracer",
    "distance_to_exit",
    "farthest_hit",
    "is_free",
    "is_seen_from",
    "outside_ray",
]


ROUNDING = 1e-4  # share of a distance that float32 rays may be off by
# Embree keeps rays from leaking through sides, but of those through the very corner where triangles meet one in
# thousands slips by all of them. Corners are centres of pixels, and so are rays: what hits nothing is asked again a
# little beside.
BESIDE_PX = 1.0 / 32


class Tracer(NamedTuple):
    """A ray tracer's scene, as kernels take it.

    intersect, occluded: addresses of rtcIntersect1 and rtcOccluded1; scene: the address of a committed scene. bounds:
    [2, 3], a box that holds the scene with some room, metres, relative to the scene origin: rays from outside start on
    it.
    """

    intersect: int
    occluded: int
    scene: int
    bounds: F64


@inlined
def is_free(
    tracer: Tracer, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, far: float
) -> bool:
    """Whether a ray meets nothing up to `far` (in lengths of its direction). Where it does, the first thing that is
    found ends the search, wherever on the ray (an any-hit ray)."""
    # RTCRayHit starts with the RTCRay that rtcOccluded1 takes; where something is hit, it sets tfar to -inf.
    left, _u, _v, _geometry, _primitive = intersect1(
        tracer.occluded, tracer.scene, 0, np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx),
        np.float32(dy), np.float32(dz), np.float32(0.0), np.float32(far),
    )  # fmt: skip
    return bool(left >= np.float32(0.0))


@inlined
def is_seen_from(tracer: Tracer, camera: F64, dx: float, dy: float, dz: float, far: float) -> bool:
    """Whether nothing stands between a camera (packed) and `far` times a direction from it."""
    ox, oy, oz = position(camera)
    return is_free(tracer, ox, oy, oz, dx, dy, dz, far)


@inlined
def distance_to_exit(bounds: F64, camera: F64, dx: float, dy: float, dz: float) -> float:
    """How far a ray from a camera (packed) goes until it has left a box [2, 3] for good; negative where it never meets
    it again."""
    far = math.inf
    for axis, step in ((0, dx), (1, dy), (2, dz)):
        if step > 0.0:
            far = min(far, (bounds[1, axis] - camera[POSITION + axis]) / step)
        elif step < 0.0:
            far = min(far, (bounds[0, axis] - camera[POSITION + axis]) / step)
    return far


@inlined
def outside_ray(
    camera: F64, bounds: F64, u: float, v: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """The ray from outside the scene's bounds toward a camera, through (u, v) of its picture.

    Origin (3), unit direction (3), distance to the camera (<= 0: the ray misses the scene), and the distance from the
    camera that a depth of 1 makes.
    """
    x, y, z = unproject_point(camera, u, v, 1.0)
    dx, dy, dz = from_camera(camera, x, y, z)
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    far = distance_to_exit(bounds, camera, dx, dy, dz)
    x, y, z = along(camera, far, dx, dy, dz)
    return x, y, z, -dx, -dy, -dz, far, length


@inlined
def farthest_hit(tracer: Tracer, camera: F64, u: float, v: float) -> tuple[float, float, float, int, int, float]:
    """What lies farthest behind (u, v) of a camera: distance from the camera, barycentric u and v, geometry,
    primitive, and the distance that a depth of 1 makes. The distance is negative where nothing is hit, nor beside."""
    hit = _farthest_along(tracer, camera, u, v)
    if hit[0] < 0.0:
        hit = _farthest_along(tracer, camera, u + BESIDE_PX, v - BESIDE_PX)
    return hit


@serial
def _farthest_along(tracer: Tracer, camera: F64, u: float, v: float) -> tuple[float, float, float, int, int, float]:
    """`farthest_hit` by a single ray."""
    x, y, z, dx, dy, dz, far, length = outside_ray(camera, tracer.bounds, u, v)
    if not far > 0.0:
        return -1.0, 0.0, 0.0, -1, -1, length
    t, hu, hv, geometry, primitive = intersect1(
        tracer.intersect, tracer.scene, 0, np.float32(x), np.float32(y), np.float32(z),
        np.float32(dx), np.float32(dy), np.float32(dz), np.float32(0.0), np.float32(far),
    )  # fmt: skip
    if geometry == INVALID_ID:
        return -1.0, 0.0, 0.0, -1, -1, length
    return far - t, hu, hv, numba.int64(geometry), numba.int64(primitive), length

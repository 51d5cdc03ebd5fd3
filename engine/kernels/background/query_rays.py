"""Rays that users of the model cast: from anywhere, in any direction."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64, U8
from ..base.jit import inlined, parallel, serial
from .intersect import intersect1
from .queried import Found, Queried, write_found
from .ray_hit import INVALID_ID
from .rays import Tracer, is_free

__all__ = ["FARTHEST", "NEAREST", "cast_rays", "mark_free"]

NEAREST, FARTHEST = range(2)  # which hit is asked for


@inlined
def _exit(bounds: F64, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> float:
    """How far a ray goes until it has left a box [2, 3] for good; negative where it never meets it."""
    far = math.inf
    for axis, at, step in ((0, x, dx), (1, y, dy), (2, z, dz)):
        if step > 0.0:
            far = min(far, (bounds[1, axis] - at) / step)
        elif step < 0.0:
            far = min(far, (bounds[0, axis] - at) / step)
    return far


@serial
def _hit(
    tracer: Tracer, which: int, x: float, y: float, z: float, dx: float, dy: float, dz: float, far: float
) -> tuple[float, float, float, int, int]:
    """Distance (negative: nothing is hit), barycentric u and v, geometry and primitive of a ray's nearest or farthest
    hit; unit direction."""
    if which == FARTHEST:  # the nearest one to the other end of the ray, from there
        far = min(far, _exit(tracer.bounds, x, y, z, dx, dy, dz))
        if not far > 0.0:
            return -1.0, 0.0, 0.0, -1, -1
        x, y, z, dx, dy, dz = x + far * dx, y + far * dy, z + far * dz, -dx, -dy, -dz
    t, u, v, geometry, primitive = intersect1(
        tracer.intersect, tracer.scene, 0, np.float32(x), np.float32(y), np.float32(z),
        np.float32(dx), np.float32(dy), np.float32(dz), np.float32(0.0), np.float32(far),
    )  # fmt: skip
    if geometry == INVALID_ID:
        return -1.0, 0.0, 0.0, -1, -1
    return max(far - t, 0.0) if which == FARTHEST else t, u, v, numba.int64(geometry), numba.int64(primitive)


@serial
def _answer(
    tracer: Tracer, queried: Queried, which: int, start: tuple[float, float, float],
    direction: tuple[float, float, float], far: float, k: int, found: Found,
) -> None:  # fmt: skip
    """Casts ray k and writes its answer; start: metres in the world; direction: of any length."""
    dx, dy, dz = direction
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    x, y, z = start
    t, u, v, geometry, primitive = _hit(
        tracer, which, x - queried.origin[0], y - queried.origin[1], z - queried.origin[2], dx, dy, dz, far
    )
    if t < 0.0:
        found.distances[k], found.ages[k] = np.inf, -1
        for axis in range(3):
            found.points[k, axis], found.normals[k, axis] = np.nan, np.nan
        return
    found.distances[k] = t
    found.points[k, 0], found.points[k, 1], found.points[k, 2] = x + t * dx, y + t * dy, z + t * dz
    write_found(queried, geometry, primitive, (u, v), (-dx, -dy, -dz), k, found)


@parallel
def cast_rays(
    tracer: Tracer, queried: Queried, which: int, origins: F64, directions: F64, far: F64, found: Found
) -> None:
    """Casts rays from origins [n, 3] (metres, world) in directions [n, 3] (of any length) up to `far` [n] metres, and
    writes what they hit; which: NEAREST or FARTHEST."""
    for i in numba.prange(far.shape[0]):
        k = np.int64(i)
        start = (origins[k, 0], origins[k, 1], origins[k, 2])
        direction = (directions[k, 0], directions[k, 1], directions[k, 2])
        _answer(tracer, queried, which, start, direction, far[k], k, found)


@parallel
def mark_free(
    tracer: Tracer, origin: F64, origins: F64, directions: F64, far: F64, free: U8
) -> None:
    """Sets free [n] to 1 where rays hit nothing, else to 0; rays as in `cast_rays`; origin [3]: the scene's."""
    for k in numba.prange(far.shape[0]):
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        x, y, z = origins[k, 0] - origin[0], origins[k, 1] - origin[1], origins[k, 2] - origin[2]
        free[k] = is_free(tracer, x, y, z, dx / length, dy / length, dz / length, far[k])

"""What is near a point: the nearest place on the model's surfaces, and the triangles that a sphere touches.

Embree's point query finds the triangles whose boxes lie within a radius, and calls back for each (`point_query`,
`point_callbacks`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, I32
from ..base.jit import parallel, serial
from ..base.memory import load_i64
from .point_query import point_query
from .point_search import CONTEXT_SIZE, COUNT, INVALID, LIST, ROOM, SURFACES, TRIANGLE, closest_on
from .queried import Found, Queried, write_found
from .triangles import corners_of, point_of

__all__ = ["Near", "count_touched", "find_closest"]

_RUN = 64  # searches that share a context


class Near(NamedTuple):
    """Embree's search, for kernels: addresses of rtcPointQuery, of a committed scene and of a callback."""

    function: int
    scene: int
    callback: int


@parallel
def find_closest(near: Near, queried: Queried, points: F64, within: F64, found: Found) -> None:
    """The place on the model's surfaces that is nearest to each point [n, 3] (metres, world) and less than `within` [n]
    metres away; normals are on the point's side."""
    for run in numba.prange((points.shape[0] + _RUN - 1) // _RUN):
        context = np.zeros(CONTEXT_SIZE, np.int64)
        context[SURFACES], context[INVALID] = queried.surfaces.ctypes.data, queried.invalid.ctypes.data
        user = context.ctypes.data
        for k in range(run * _RUN, min((run + 1) * _RUN, points.shape[0])):
            x, y = points[k, 0] - queried.origin[0], points[k, 1] - queried.origin[1]
            z = points[k, 2] - queried.origin[2]
            context[TRIANGLE] = -1
            point_query(
                near.function, near.scene, near.callback, user, np.float32(x), np.float32(y), np.float32(z),
                np.float32(within[k]),
            )  # fmt: skip
            _write_closest(queried, load_i64(user, TRIANGLE), x, y, z, k, found)


@serial
def _write_closest(queried: Queried, triangle: int, x: float, y: float, z: float, k: int, found: Found) -> None:
    """Writes answer k for a point (relative to the scene origin) whose nearest triangle is known (-1: none)."""
    if triangle < 0:
        found.distances[k], found.ages[k] = np.inf, -1
        for axis in range(3):
            found.points[k, axis], found.normals[k, axis] = np.nan, np.nan
        return
    geometry, primitive = triangle & 0xFFFFFFFF, triangle >> 32
    a, b, c = corners_of(queried.surfaces[geometry], primitive)
    px, py, pz, v, w = closest_on(
        x, y, z, point_of(queried.surfaces[geometry], a), point_of(queried.surfaces[geometry], b),
        point_of(queried.surfaces[geometry], c),
    )  # fmt: skip
    bx, by, bz = x - px, y - py, z - pz
    found.distances[k] = math.sqrt(bx * bx + by * by + bz * bz)
    found.points[k, 0] = px + queried.origin[0]
    found.points[k, 1] = py + queried.origin[1]
    found.points[k, 2] = pz + queried.origin[2]
    write_found(queried, geometry, primitive, (v, w), (bx, by, bz), k, found)


@parallel
def count_touched(
    near: Near, queried: Queried, centres: F64, radii: F64, counts: I32, triangles: int, most: int
) -> None:
    """The number of triangles that each sphere touches, at most MOST_COUNTED: centres [n, 3], metres in the world;
    radii [n], metres; counts [n]. The first `most` of each are listed, in no order: triangles is the address of int32
    [n, most, 2], geometry and primitive."""
    for run in numba.prange((centres.shape[0] + _RUN - 1) // _RUN):
        context = np.zeros(CONTEXT_SIZE, np.int64)
        context[SURFACES], context[INVALID] = queried.surfaces.ctypes.data, queried.invalid.ctypes.data
        context[ROOM] = most
        user = context.ctypes.data
        for k in range(run * _RUN, min((run + 1) * _RUN, centres.shape[0])):
            context[COUNT], context[LIST] = 0, triangles + 8 * most * k
            point_query(
                near.function, near.scene, near.callback, user, np.float32(centres[k, 0] - queried.origin[0]),
                np.float32(centres[k, 1] - queried.origin[1]), np.float32(centres[k, 2] - queried.origin[2]),
                np.float32(radii[k]),
            )  # fmt: skip
            counts[k] = load_i64(user, COUNT)

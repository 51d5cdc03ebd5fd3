"""What is near a point: the nearest place on the model's surfaces, and the triangles that a sphere touches.

Embree's point query finds the triangles whose boxes lie within a radius, and calls back for each (`point_query`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numba import types

from ...support.array_types import F64, I32
from ..base.callbacks import callback
from ..base.jit import inlined, parallel, serial
from ..base.memory import (
    add_i64_atomically,
    load_f32,
    load_foreign_i64,
    load_foreign_u32,
    load_i64,
    load_u8,
    load_u32,
    store_foreign_i32,
)
from .point_query import GEOM_ID, PRIM_ID, QUERY, USER, point_query, read_query, shrink_query
from .queried import Found, Queried, write_found
from .surfaces import POINTS, SURFACE_SIZE, TRIANGLES
from .triangles import corners_of, point_of

__all__ = ["MOST_COUNTED", "Near", "count_touched", "find_closest", "take_nearer", "take_touched"]


# The context of a search is int64 [_CONTEXT_SIZE]: addresses of the tables of surfaces (`surfaces`) and of flags
# (`queried.Queried`); the nearest triangle so far (geometry in the low half, primitive in the high one, -1: none), or
# how many triangles the sphere touches; and the place of a list of pairs int32 of them, and how many pairs it holds.
_SURFACES, _INVALID, _TRIANGLE, _COUNT, _LIST, _ROOM = range(6)
_CONTEXT_SIZE = 6
_RUN = 64  # searches that share a context
MOST_COUNTED = 4096  # triangles of a sphere: one that holds the whole room takes no longer than this many


@inlined
def _share(part: float, whole: float) -> float:
    """part / whole, 0 where the whole is nothing."""
    return part / whole if whole > 0.0 else 0.0


@inlined
def _closest_on(
    px: float, py: float, pz: float, a: tuple[float, float, float], b: tuple[float, float, float],
    c: tuple[float, float, float],
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """The place on a triangle that is nearest to a point, and its weights of the corners b and c (Ericson, Real-Time
    Collision Detection, 5.1.5)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = px - a[0], py - a[1], pz - a[2]
    bpx, bpy, bpz = px - b[0], py - b[1], pz - b[2]
    cpx, cpy, cpz = px - c[0], py - c[1], pz - c[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = _share(d1, d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, _share(d2, d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = _share(d4 - d3, (d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = _share(vb, va + vb + vc), _share(vc, va + vb + vc)
    return a[0] + v * abx + w * acx, a[1] + v * aby + w * acy, a[2] + v * abz + w * acz, v, w


@inlined
def _corner(table: int, geometry: int, primitive: int, corner: int) -> tuple[float, float, float]:
    """A corner of a triangle, through the address of a table of surfaces; in double precision."""
    row = SURFACE_SIZE * geometry
    number = load_u32(load_i64(table, row + TRIANGLES), 3 * primitive + corner)
    points = load_i64(table, row + POINTS)
    return (
        np.float64(load_f32(points, 3 * number)), np.float64(load_f32(points, 3 * number + 1)),
        np.float64(load_f32(points, 3 * number + 2)),
    )  # fmt: skip


@inlined
def _squared_distance(table: int, geometry: int, primitive: int, x: float, y: float, z: float) -> float:
    """The square of a point's distance from a triangle."""
    px, py, pz = np.float64(x), np.float64(y), np.float64(z)
    a = _corner(table, geometry, primitive, 0)
    b = _corner(table, geometry, primitive, 1)
    c = _corner(table, geometry, primitive, 2)
    qx, qy, qz, _v, _w = _closest_on(px, py, pz, a, b, c)
    return (qx - px) * (qx - px) + (qy - py) * (qy - py) + (qz - pz) * (qz - pz)


@inlined
def _is_there(user: int, geometry: int, primitive: int) -> bool:
    """Whether a triangle is not culled."""
    return load_u8(load_i64(load_i64(user, _INVALID), geometry), primitive) == 0


@callback(types.uint8(types.intp))
def take_nearer(arguments: int) -> int:
    """RTCPointQueryFunction: a triangle that is nearer than all before becomes the nearest one."""
    query, user = load_foreign_i64(arguments, QUERY), load_foreign_i64(arguments, USER)
    primitive, geometry = load_foreign_u32(arguments, PRIM_ID), load_foreign_u32(arguments, GEOM_ID)
    if not _is_there(user, geometry, primitive):
        return 0
    x, y, z, radius = read_query(query)
    distance = math.sqrt(_squared_distance(load_i64(user, _SURFACES), geometry, primitive, x, y, z))
    if not distance < radius:
        return 0
    shrink_query(query, np.float32(distance))
    store_foreign_i32(user, 2 * _TRIANGLE, numba.int32(geometry))
    store_foreign_i32(user, 2 * _TRIANGLE + 1, numba.int32(primitive))
    return 1


@callback(types.uint8(types.intp))
def take_touched(arguments: int) -> int:
    """RTCPointQueryFunction: counts a triangle that lies within the radius, and lists it while there is room; ends the
    search at MOST_COUNTED."""
    query, user = load_foreign_i64(arguments, QUERY), load_foreign_i64(arguments, USER)
    primitive, geometry = load_foreign_u32(arguments, PRIM_ID), load_foreign_u32(arguments, GEOM_ID)
    if not _is_there(user, geometry, primitive):
        return 0
    x, y, z, radius = read_query(query)
    reach = np.float64(radius) * np.float64(radius)
    if radius < 0.0 or _squared_distance(load_i64(user, _SURFACES), geometry, primitive, x, y, z) > reach:
        return 0
    count = load_i64(user, _COUNT)
    if count < load_i64(user, _ROOM):
        store_foreign_i32(load_i64(user, _LIST), 2 * count, numba.int32(geometry))
        store_foreign_i32(load_i64(user, _LIST), 2 * count + 1, numba.int32(primitive))
    add_i64_atomically(user, _COUNT, 1)
    if count + 1 < MOST_COUNTED:
        return 0
    shrink_query(query, numba.float32(-1.0))
    return 1


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
        context = np.zeros(_CONTEXT_SIZE, np.int64)
        context[_SURFACES], context[_INVALID] = queried.surfaces.ctypes.data, queried.invalid.ctypes.data
        user = context.ctypes.data
        for k in range(run * _RUN, min((run + 1) * _RUN, points.shape[0])):
            x, y = points[k, 0] - queried.origin[0], points[k, 1] - queried.origin[1]
            z = points[k, 2] - queried.origin[2]
            store_foreign_i32(user, 2 * _TRIANGLE, numba.int32(-1))
            store_foreign_i32(user, 2 * _TRIANGLE + 1, numba.int32(-1))
            point_query(
                near.function, near.scene, near.callback, user, np.float32(x), np.float32(y), np.float32(z),
                np.float32(within[k]),
            )  # fmt: skip
            _write_closest(queried, load_i64(user, _TRIANGLE), x, y, z, k, found)


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
    px, py, pz, v, w = _closest_on(
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
        context = np.zeros(_CONTEXT_SIZE, np.int64)
        context[_SURFACES], context[_INVALID] = queried.surfaces.ctypes.data, queried.invalid.ctypes.data
        context[_ROOM] = most
        user = context.ctypes.data
        for k in range(run * _RUN, min((run + 1) * _RUN, centres.shape[0])):
            context[_COUNT], context[_LIST] = 0, triangles + 8 * most * k
            point_query(
                near.function, near.scene, near.callback, user, np.float32(centres[k, 0] - queried.origin[0]),
                np.float32(centres[k, 1] - queried.origin[1]), np.float32(centres[k, 2] - queried.origin[2]),
                np.float32(radii[k]),
            )  # fmt: skip
            counts[k] = load_i64(user, _COUNT)

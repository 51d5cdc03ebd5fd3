"""What Embree calls back in searches near points: for each triangle whose box lies within the radius.

A module of its own, which the first search imports: its functions are compiled when it is imported.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numba import types

from ..base.callbacks import callback
from ..base.jit import inlined
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
from .point_query import GEOM_ID, PRIM_ID, QUERY, USER, read_query, shrink_query
from .point_search import COUNT, INVALID, LIST, MOST_COUNTED, ROOM, SURFACES, TRIANGLE, closest_on
from .surfaces import POINTS, SURFACE_SIZE, TRIANGLES

__all__ = ["take_nearer", "take_touched"]


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
    qx, qy, qz, _v, _w = closest_on(px, py, pz, a, b, c)
    return (qx - px) * (qx - px) + (qy - py) * (qy - py) + (qz - pz) * (qz - pz)


@inlined
def _is_there(user: int, geometry: int, primitive: int) -> bool:
    """Whether a triangle is not culled."""
    return load_u8(load_i64(load_i64(user, INVALID), geometry), primitive) == 0


@callback(types.uint8(types.intp))
def take_nearer(arguments: int) -> int:
    """RTCPointQueryFunction: a triangle that is nearer than all before becomes the nearest one."""
    query, user = load_foreign_i64(arguments, QUERY), load_foreign_i64(arguments, USER)
    primitive, geometry = load_foreign_u32(arguments, PRIM_ID), load_foreign_u32(arguments, GEOM_ID)
    if not _is_there(user, geometry, primitive):
        return 0
    x, y, z, radius = read_query(query)
    distance = math.sqrt(_squared_distance(load_i64(user, SURFACES), geometry, primitive, x, y, z))
    if not distance < radius:
        return 0
    shrink_query(query, np.float32(distance))
    store_foreign_i32(user, 2 * TRIANGLE, numba.int32(geometry))
    store_foreign_i32(user, 2 * TRIANGLE + 1, numba.int32(primitive))
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
    if radius < 0.0 or _squared_distance(load_i64(user, SURFACES), geometry, primitive, x, y, z) > reach:
        return 0
    count = load_i64(user, COUNT)
    if count < load_i64(user, ROOM):
        store_foreign_i32(load_i64(user, LIST), 2 * count, numba.int32(geometry))
        store_foreign_i32(load_i64(user, LIST), 2 * count + 1, numba.int32(primitive))
    add_i64_atomically(user, COUNT, 1)
    if count + 1 < MOST_COUNTED:
        return 0
    shrink_query(query, numba.float32(-1.0))
    return 1

"""Which of the surfaces behind a pixel still stands: the nearest one that no view has ever looked through.

The farthest one, which the paper takes (section 3.4.1), is the far room's wall for whoever stands before a partition
beside whose door some camera looks. Culling leaves the partition in the model as well: it asks each camera for what
lies behind a triangle on its own rays. On those of a viewer there may be both.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, I64
from ..base.jit import serial
from ..base.project import position, unproject_point
from ..base.sight import looks_through, shows
from ..base.tolerance import Delta, delta_at
from .intersect import intersect1
from .lines import along, from_camera
from .ray_hit import INVALID_ID
from .rays import BESIDE_PX, ROUNDING, Tracer, farthest_hit
from .surfaces import CAMERA

__all__ = ["FARTHEST", "NOW", "Present", "standing_hit"]


_LAYERS = 8  # surfaces that are looked at along a ray before the farthest is taken
NOW, FARTHEST = range(2)  # columns of `Present.codes`


class Present(NamedTuple):
    """What decides which surface stands: the newest frame's views, and what their cameras have ever seen.

    near: the depth, metres, before which nothing is shown: what lies between the PBI's camera and the eyes. table:
    float64 [views, TABLE_SIZE], as `kernels.base.view_table` has them; without rows where nothing is asked of the
    views. codes: int64 [views, 2], addresses of their present codes (NOW), and of their maximum depth images'
    (FARTHEST).
    """

    near: float
    table: F64
    codes: I64


@serial
def _stands(present: Present, x: float, y: float, z: float, delta: Delta) -> bool:
    """Whether no view has ever looked through a point."""
    table, codes = present.table, present.codes
    for k in range(table.shape[0]):  # noqa: SIM110 (compiled)
        if looks_through(table[k], codes[k, FARTHEST], x, y, z, delta):
            return False
    return True


@serial
def standing_hit(
    tracer: Tracer, camera: F64, u: float, v: float, surfaces: I64, present: Present, delta: Delta
) -> tuple[float, float, float, int, int, float, int]:
    """As `rays.farthest_hit`, but of the surfaces beyond `present.near` the nearest that stands, and the rays cast.

    A surface stands where the view that it stems from shows it now (most do: one ray), or no view has ever looked
    through it. What lies within delta of the farthest hit is taken to be that surface, and it is the last
    resort: whether it is a ghost the front end sees. surfaces: see `surfaces`. What hits nothing is asked again a
    little beside (see `rays.BESIDE_PX`).
    """
    distance, hu, hv, geometry, primitive, length, rays = _standing_along(
        tracer, camera, u, v, surfaces, present, delta
    )
    if distance < 0.0:
        distance, hu, hv, geometry, primitive, length, more = _standing_along(
            tracer, camera, u + BESIDE_PX, v - BESIDE_PX, surfaces, present, delta
        )
        rays += more
    return distance, hu, hv, geometry, primitive, length, rays


@serial
def _standing_along(
    tracer: Tracer, camera: F64, u: float, v: float, surfaces: I64, present: Present, delta: Delta
) -> tuple[float, float, float, int, int, float, int]:
    """`standing_hit` along a single ray."""
    px, py, pz = unproject_point(camera, u, v, 1.0)
    ox, oy, oz = position(camera)
    # Directions as long as a depth of 1: distances along them are depths.
    dx, dy, dz = from_camera(camera, px, py, pz)
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    start, rays = present.near, 0
    last, lu, lv, last_geometry, last_primitive = 0.0, 0.0, 0.0, -1, -1
    for layer in range(_LAYERS):
        depth, hu, hv, geometry, primitive = intersect1(
            tracer.intersect, tracer.scene, 0, np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx),
            np.float32(dy), np.float32(dz), np.float32(start), np.float32(np.inf),
        )  # fmt: skip
        rays += 1
        if geometry == INVALID_ID:
            break
        x, y, z = along(camera, depth, dx, dy, dz)
        view = surfaces[geometry, CAMERA]
        found = depth * length, hu, hv, numba.int64(geometry), numba.int64(primitive), length
        if shows(present.table[view], present.codes[view, NOW], x, y, z, delta):
            return (*found, rays)
        if layer == 0:
            last, lu, lv, last_geometry, last_primitive, _length = farthest_hit(tracer, camera, u, v)
            rays += 1
        if depth * length >= last - max(delta_at(delta, last), ROUNDING * last):
            break
        if _stands(present, x, y, z, delta):
            return (*found, rays)
        start = depth * (1.0 + ROUNDING)
    return last if last > present.near * length else -1.0, lu, lv, last_geometry, last_primitive, length, rays

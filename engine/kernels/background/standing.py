"""The surface behind a pixel that still stands: the nearest one that no view has ever seen past.

The paper takes the farthest surface (section 3.4.1). If a camera looks through the door of a partition wall, that would
be the wall of the room behind, even for a viewer who stands before the partition. The partition is in the model as
well, because culling only tests, for each camera, what lies behind a triangle on that camera's rays. A viewer's ray may
meet both walls.
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
from .surfaces import CAMERA, LATE

__all__ = ["FARTHEST", "NOW", "Present", "standing_hit"]


_LAYERS = 8  # surfaces that are tested along a ray before the farthest is taken
NOW, FARTHEST = range(2)  # columns of `Present.codes`


class Present(NamedTuple):
    """The evidence on whether a surface stands: the newest frame's views, and the maximum depth images.

    near: surfaces nearer than this depth, metres, are between the PBI's camera and the eyes and are not shown. table:
    float64 [views, TABLE_SIZE], see `kernels.base.view_table`; without rows, no view is consulted. codes: int64
    [views, 2], the addresses of their present codes (NOW; 0: none), and of their maximum depth images' codes
    (FARTHEST).
    """

    near: float
    table: F64
    codes: I64


@serial
def _stands(present: Present, column: int, x: float, y: float, z: float, delta: Delta) -> bool:
    """Whether no view has ever seen past a point (column FARTHEST), or none sees past it now (NOW)."""
    table, codes = present.table, present.codes
    for k in range(table.shape[0]):
        address = codes[k, column]
        if address != 0 and looks_through(table[k], address, x, y, z, delta):
            return False
    return True


@serial
def standing_hit(
    tracer: Tracer, camera: F64, u: float, v: float, surfaces: I64, present: Present, delta: Delta
) -> tuple[float, float, float, int, int, float, int]:
    """As `rays.farthest_hit`, but the nearest hit beyond `present.near` that stands; and the number of rays.

    A surface stands if the view that it stems from shows it now (most do, and need one ray), or if no view has ever
    seen past it; a late layer, if no view sees past it now. A hit within delta of the farthest hit counts as the
    farthest surface, which is the fallback; the front end rejects it if it is a ghost. surfaces: see `surfaces`. A ray
    that hits nothing is cast again a little to the side (see `rays.BESIDE_PX`).
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
    # The direction has the length of a depth of 1, so distances along it are depths.
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
        if _stands(present, NOW if surfaces[geometry, LATE] != 0 else FARTHEST, x, y, z, delta):
            return (*found, rays)
        start = depth * (1.0 + ROUNDING)
    return last if last > present.near * length else -1.0, lu, lv, last_geometry, last_primitive, length, rays

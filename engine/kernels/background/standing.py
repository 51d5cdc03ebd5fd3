"""Which of the surfaces behind a pixel still stands: the nearest one that no view has ever looked through.

The farthest one, which the paper takes (section 3.4.1), is the far room's wall for whoever stands before a partition
beside whose door some camera looks. Culling leaves the partition in the model as well: it asks each camera for what
lies behind a triangle on its own rays. On those of a viewer there may be both.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, I64
from ..base.jit import serial
from ..base.project import unproject_point
from ..base.sight import looks_through, shows
from ..base.tolerance import Delta, delta_at
from .rays import BESIDE_PX, INVALID_ID, ROUNDING, farthest_hit, intersect1

__all__ = ["standing_hit"]


_LAYERS = 8  # surfaces that are looked at along a ray before the farthest is taken


@serial
def _stands(table: F64, codes: I64, x: float, y: float, z: float, delta: Delta) -> bool:
    """Whether no view has ever looked through a point."""
    for k in range(table.shape[0]):  # noqa: SIM110 (compiled)
        if looks_through(table[k], codes[k, 1], x, y, z, delta):
            return False
    return True


@serial
def standing_hit(
    function: int, scene: int, camera: F64, bounds: F64, u: float, v: float, near: float,
    owners: I64, table: F64, codes: I64, delta: Delta,
) -> tuple[float, float, float, int, int, float, int]:  # fmt: skip
    """As `rays.farthest_hit`, but of the surfaces beyond depth `near` the nearest that stands, and the rays cast.

    A surface stands where the view that it stems from shows it now (most do: one ray), or no view has ever looked
    through it. What lies within delta of the farthest hit is taken to be that surface, and it is the last
    resort: whether it is a ghost the front end sees. owners [geometries, >= 3]: column 2 is a geometry's view;
    table: views as `kernels.base.view_table` has them; codes [views, 2]: addresses of their present codes and of their
    maximum depth images. What hits nothing is asked again a little beside (see `rays.BESIDE_PX`).
    """
    distance, hu, hv, geometry, primitive, length, rays = _standing_along(
        function, scene, camera, bounds, u, v, near, owners, table, codes, delta
    )
    if distance < 0.0:
        distance, hu, hv, geometry, primitive, length, more = _standing_along(
            function, scene, camera, bounds, u + BESIDE_PX, v - BESIDE_PX, near, owners, table, codes, delta
        )
        rays += more
    return distance, hu, hv, geometry, primitive, length, rays


@serial
def _standing_along(
    function: int, scene: int, camera: F64, bounds: F64, u: float, v: float, near: float,
    owners: I64, table: F64, codes: I64, delta: Delta,
) -> tuple[float, float, float, int, int, float, int]:  # fmt: skip
    """`standing_hit` along a single ray."""
    px, py, pz = unproject_point(camera, u, v, 1.0)
    ox, oy, oz = np.float32(camera[16]), np.float32(camera[17]), np.float32(camera[18])
    # Directions as long as a depth of 1: distances along them are depths.
    dx, dy, dz = px - camera[16], py - camera[17], pz - camera[18]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    start, rays = near, 0
    last, lu, lv, last_geometry, last_primitive = 0.0, 0.0, 0.0, -1, -1
    for layer in range(_LAYERS):
        depth, hu, hv, geometry, primitive = intersect1(
            function, scene, 0, ox, oy, oz, np.float32(dx), np.float32(dy), np.float32(dz),
            np.float32(start), np.float32(np.inf),
        )  # fmt: skip
        rays += 1
        if geometry == INVALID_ID:
            break
        x, y, z = camera[16] + depth * dx, camera[17] + depth * dy, camera[18] + depth * dz
        view = owners[geometry, 2]
        found = depth * length, hu, hv, numba.int64(geometry), numba.int64(primitive), length
        if shows(table[view], codes[view, 0], x, y, z, delta):
            return (*found, rays)
        if layer == 0:
            last, lu, lv, last_geometry, last_primitive, _length = farthest_hit(function, scene, camera, bounds, u, v)
            rays += 1
        if depth * length >= last - max(delta_at(delta, last), ROUNDING * last):
            break
        if _stands(table, codes, x, y, z, delta):
            return (*found, rays)
        start = depth * (1.0 + ROUNDING)
    return last if last > near * length else -1.0, lu, lv, last_geometry, last_primitive, length, rays

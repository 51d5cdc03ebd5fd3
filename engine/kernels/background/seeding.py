"""What a rig sees of surfaces from an earlier model."""

from __future__ import annotations

import numba

from ...support.array_types import F64, I64, U8
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel
from ..base.project import project_point
from ..base.sight import shows
from ..base.tolerance import Delta
from .surfaces import Triangles

__all__ = ["judge_seed"]

# Two of the barycentric coordinates of the points at which a triangle is looked for: its centroid, its corners, and the
# middles of its sides. The corners count, as what is left out reaches up to them.
_THIRD = 1.0 / 3.0
_POINTS = ((_THIRD, _THIRD), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5))


@inlined
def _is_shown(table: F64, codes: I64, x: float, y: float, z: float, delta: Delta) -> bool:
    """Whether one of the views shows a surface at a point."""
    for k in range(table.shape[0]):  # noqa: SIM110 (compiled)
        if shows(table[k], codes[k], x, y, z, delta):
            return True
    return False


@inlined
def _is_inside(cameras: F64, x: float, y: float, z: float) -> bool:
    """Whether a point's image is inside the picture of one of the cameras."""
    for k in range(cameras.shape[0]):
        u, v, depth = project_point(cameras[k], x, y, z)
        if depth > 0.0 and u >= 0.0 and v >= 0.0 and u < cameras[k, WIDTH] and v < cameras[k, HEIGHT]:
            return True
    return False


@parallel
def judge_seed(
    table: F64, codes: I64, cameras: F64, mesh: Triangles, delta: Delta, shown: U8, unseen: U8
) -> None:
    """Sets shown [m] to 1 for triangles of which views show all points of _POINTS, and unseen [m] to 1 for those whose
    centroid is in no camera's picture.

    table [views, TABLE_SIZE] and codes [views], the addresses of depth codes: see `kernels.base.view_table`; cameras:
    packed, [n, CAMERA_SIZE].
    """
    for i in numba.prange(shown.shape[0]):
        points, triangles = mesh.points, mesh.triangles
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        count = 0
        for k in range(len(_POINTS)):
            p, q = _POINTS[k]
            r = 1.0 - p - q
            x = p * points[a, 0] + q * points[b, 0] + r * points[c, 0]
            y = p * points[a, 1] + q * points[b, 1] + r * points[c, 1]
            z = p * points[a, 2] + q * points[b, 2] + r * points[c, 2]
            if k == 0:
                unseen[i] = not _is_inside(cameras, x, y, z)
            if not _is_shown(table, codes, x, y, z, delta):
                break
            count += 1
        shown[i] = count == len(_POINTS)

"""Projection of single points, both ways, over packed cameras.

A packed camera is a float64 array of CAMERA_SIZE numbers:
[0] kind, [1:3] width, height, [3:7] fx fy cx cy (perspective) or phi_max, radians a column, theta_max, radians
a row (equirectangular), [7:16] rotation world from camera (row-major), [16:19] position relative to the scene
origin, [19] 1 where the picture wraps round.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["CAMERA_SIZE", "EQUIRECTANGULAR", "PERSPECTIVE", "project_point", "unproject_point"]

CAMERA_SIZE = 20
PERSPECTIVE = 0.0
EQUIRECTANGULAR = 1.0

FloatArray = npt.NDArray[np.float64]


@numba.njit(inline="always", cache=True, error_model="numpy")
def project_point(camera: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point relative to the scene origin -> (u, v, depth); depth <= 0 means behind a perspective camera."""
    dx, dy, dz = x - camera[16], y - camera[17], z - camera[18]
    cx = camera[7] * dx + camera[10] * dy + camera[13] * dz
    cy = camera[8] * dx + camera[11] * dy + camera[14] * dz
    cz = camera[9] * dx + camera[12] * dy + camera[15] * dz
    if camera[0] == PERSPECTIVE:
        inverse = 1.0 / cx
        return camera[5] - camera[3] * cy * inverse, camera[6] - camera[4] * cz * inverse, cx
    planar = math.sqrt(cx * cx + cy * cy)
    u = (camera[3] - math.atan2(cy, cx)) / camera[4]
    # The azimuth is known up to a turn: take the one nearest to the picture's middle.
    turn = 2.0 * math.pi / camera[4]
    u -= turn * math.floor((u - 0.5 * camera[1]) / turn + 0.5)
    v = (camera[5] - math.atan2(cz, planar)) / camera[6]
    return u, v, math.sqrt(planar * planar + cz * cz)


@numba.njit(inline="always", cache=True, error_model="numpy")
def unproject_point(camera: FloatArray, u: float, v: float, depth: float) -> tuple[float, float, float]:
    """Pixel coordinates and depth -> the point relative to the scene origin."""
    if camera[0] == PERSPECTIVE:
        cx, cy, cz = 1.0, (camera[5] - u) / camera[3], (camera[6] - v) / camera[4]
    else:
        phi, theta = camera[3] - u * camera[4], camera[5] - v * camera[6]
        planar = math.cos(theta)
        cx, cy, cz = planar * math.cos(phi), planar * math.sin(phi), math.sin(theta)
    cx, cy, cz = cx * depth, cy * depth, cz * depth
    return (
        camera[7] * cx + camera[8] * cy + camera[9] * cz + camera[16],
        camera[10] * cx + camera[11] * cy + camera[12] * cz + camera[17],
        camera[13] * cx + camera[14] * cy + camera[15] * cz + camera[18],
    )

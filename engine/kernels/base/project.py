"""Projection of single points, both ways, over packed cameras.

`support.packed` has the layout of a packed camera.
"""

from __future__ import annotations

import math

from numba.np.unsafe.ndarray import to_fixed_tuple

from ...support.array_types import F64
from ...support.packed import CAMERA_SIZE, PERSPECTIVE
from .jit import inlined, serial

__all__ = [
    "arc_tangent",
    "cosine_sine",
    "project_pixels",
    "project_point",
    "unproject_point",
]


@inlined(fastmath={"contract", "nnan", "nsz"})
def arc_tangent(y: float, x: float) -> float:
    """atan2 by a minimax polynomial: within 4e-8 rad, far below a hundredth of a pixel, and free of branches."""
    ax, ay = abs(x), abs(y)
    a = min(ax, ay) / max(max(ax, ay), 1e-300)
    s = a * a
    r = 0.0218629205 - 0.00405455675 * s
    r = 0.0964219347 + s * (-0.0559122734 + s * r)
    r = 0.199465654 + s * (-0.139086281 + s * r)
    r = a * (0.999999336 + s * (-0.333298608 + s * r))
    r = 0.5 * math.pi - r if ay > ax else r
    r = math.pi - r if x < 0.0 else r
    return -r if y < 0.0 else r


@inlined(fastmath={"contract", "nnan", "nsz"})
def cosine_sine(angle: float) -> tuple[float, float]:
    """Both by their series within an eighth of a turn: within 1e-11, and free of branches."""
    quarter = math.floor(angle * (2.0 / math.pi) + 0.5)
    r = angle - quarter * (0.5 * math.pi)
    s = r * r
    sine = 1.0 / 120 + s * (-1.0 / 5040 + s * (1.0 / 362880 - s * (1.0 / 39916800)))
    sine = r * (1.0 + s * (-1.0 / 6 + s * sine))
    cosine = -1.0 / 720 + s * (1.0 / 40320 + s * (-1.0 / 3628800 + s * (1.0 / 479001600)))
    cosine = 1.0 + s * (-0.5 + s * (1.0 / 24 + s * cosine))
    half = 0.5 * quarter
    odd = half != math.floor(half)
    c, s = (sine, cosine) if odd else (cosine, sine)
    turned = math.floor(half + 0.5) * 0.5  # cosines of the second and third quarter are negative
    c = -c if turned != math.floor(turned) else c
    upper = math.floor(half) * 0.5
    s = -s if upper != math.floor(upper) else s
    return c, s


@inlined
def project_point(camera: F64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point relative to the scene origin -> (u, v, depth); depth <= 0 means behind a perspective camera."""
    dx, dy, dz = x - camera[16], y - camera[17], z - camera[18]
    cx = camera[7] * dx + camera[10] * dy + camera[13] * dz
    cy = camera[8] * dx + camera[11] * dy + camera[14] * dz
    cz = camera[9] * dx + camera[12] * dy + camera[15] * dz
    if camera[0] == PERSPECTIVE:
        inverse = 1.0 / cx
        u, v, depth = camera[5] - camera[3] * cy * inverse, camera[6] - camera[4] * cz * inverse, cx
    else:
        square = cx * cx + cy * cy
        u = (camera[3] - arc_tangent(cy, cx)) / camera[4]
        # The azimuth is known up to a turn: take the one nearest to the picture's middle.
        turn = 2.0 * math.pi / camera[4]
        u -= turn * math.floor((u - 0.5 * camera[1]) / turn + 0.5)
        v = (camera[5] - arc_tangent(cz, math.sqrt(square))) / camera[6]
        depth = math.sqrt(square + cz * cz)
    return u, v, depth


@inlined
def unproject_point(camera: F64, u: float, v: float, depth: float) -> tuple[float, float, float]:
    """Pixel coordinates and depth -> the point relative to the scene origin."""
    if camera[0] == PERSPECTIVE:
        cx, cy, cz = 1.0, (camera[5] - u) / camera[3], (camera[6] - v) / camera[4]
    else:
        phi, theta = camera[3] - u * camera[4], camera[5] - v * camera[6]
        planar, cz = cosine_sine(theta)
        cx, cy = cosine_sine(phi)
        cx, cy = planar * cx, planar * cy
    cx, cy, cz = cx * depth, cy * depth, cz * depth
    return (
        camera[7] * cx + camera[8] * cy + camera[9] * cz + camera[16],
        camera[10] * cx + camera[11] * cy + camera[12] * cz + camera[17],
        camera[13] * cx + camera[14] * cy + camera[15] * cz + camera[18],
    )


@serial(fastmath={"contract", "nnan", "nsz"})
def project_pixels(camera: F64, other: F64, pixels: F64, images: F64, count: int) -> None:
    """images [3, >= count]: u, v and depth in another camera of pixels [3, >= count] u, v and disparity of a first.

    Tuples, unlike arrays, keep what is the same for all pixels in registers: this compiles to vector instructions.
    """
    own, there = to_fixed_tuple(camera, CAMERA_SIZE), to_fixed_tuple(other, CAMERA_SIZE)
    for i in range(count):
        x, y, z = unproject_point(own, pixels[0, i], pixels[1, i], 1.0 / pixels[2, i])
        images[0, i], images[1, i], images[2, i] = project_point(there, x, y, z)

"""Projection and back-projection of single points with packed cameras (layout: `support.packed`)."""

from __future__ import annotations

import math
from typing import Any

from numba import config
from numba.np.unsafe import ndarray as numba_arrays

from ...support.array_types import F64
from ...support.packed import (
    CAMERA_SIZE,
    CX,
    CY,
    FORWARD_X,
    FORWARD_Y,
    FORWARD_Z,
    FX,
    FY,
    KIND,
    LEFT_X,
    LEFT_Y,
    LEFT_Z,
    PERSPECTIVE,
    PHI_MAX,
    POSITION_X,
    POSITION_Y,
    POSITION_Z,
    RADIANS_A_COLUMN,
    RADIANS_A_ROW,
    THETA_MAX,
    UP_X,
    UP_Y,
    UP_Z,
    WIDTH,
)
from .jit import inlined, serial

__all__ = [
    "arc_tangent",
    "arc_tangent_of_ratio",
    "cosine_sine",
    "direction_in_world",
    "point_in_camera",
    "position",
    "project_pixels",
    "project_point",
    "unproject_point",
]


@inlined
def arc_tangent_of_ratio(ratio: Any) -> Any:
    """Arc tangent of a number, or of a vector of numbers, in [0, 1], by a minimax polynomial: within 4e-8 rad."""
    s = ratio * ratio
    r = 0.0218629205 - 0.00405455675 * s
    r = 0.0964219347 + s * (-0.0559122734 + s * r)
    r = 0.199465654 + s * (-0.139086281 + s * r)
    return ratio * (0.999999336 + s * (-0.333298608 + s * r))


@inlined(fastmath={"contract", "nnan", "nsz"})
def arc_tangent(y: float, x: float) -> float:
    """atan2, within 4e-8 rad, far below a hundredth of a pixel, and free of branches."""
    ax, ay = abs(x), abs(y)
    r = arc_tangent_of_ratio(min(ax, ay) / max(max(ax, ay), 1e-300))
    r = 0.5 * math.pi - r if ay > ax else r
    r = math.pi - r if x < 0.0 else r
    return -r if y < 0.0 else r


@inlined(fastmath={"contract", "nnan", "nsz"})
def cosine_sine(angle: float) -> tuple[float, float]:
    """Both functions, by their series within an eighth of a turn: within 1e-11, and free of branches."""
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
def position(camera: F64) -> tuple[float, float, float]:
    """A camera's position relative to the scene origin, metres."""
    return camera[POSITION_X], camera[POSITION_Y], camera[POSITION_Z]


@inlined
def point_in_camera(camera: F64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point relative to the scene origin -> its coordinates in a camera's axes (forward, left, up)."""
    dx, dy, dz = x - camera[POSITION_X], y - camera[POSITION_Y], z - camera[POSITION_Z]
    return (
        camera[FORWARD_X] * dx + camera[FORWARD_Y] * dy + camera[FORWARD_Z] * dz,
        camera[LEFT_X] * dx + camera[LEFT_Y] * dy + camera[LEFT_Z] * dz,
        camera[UP_X] * dx + camera[UP_Y] * dy + camera[UP_Z] * dz,
    )


@inlined
def direction_in_world(camera: F64, forward: float, left: float, up: float) -> tuple[float, float, float]:
    """A direction in a camera's axes -> the same in the world's."""
    return (
        camera[FORWARD_X] * forward + camera[LEFT_X] * left + camera[UP_X] * up,
        camera[FORWARD_Y] * forward + camera[LEFT_Y] * left + camera[UP_Y] * up,
        camera[FORWARD_Z] * forward + camera[LEFT_Z] * left + camera[UP_Z] * up,
    )


@inlined
def project_point(camera: F64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point relative to the scene origin -> (u, v, depth); depth <= 0 means behind a perspective camera."""
    cx, cy, cz = point_in_camera(camera, x, y, z)
    if camera[KIND] == PERSPECTIVE:
        inverse = 1.0 / cx
        u, v, depth = camera[CX] - camera[FX] * cy * inverse, camera[CY] - camera[FY] * cz * inverse, cx
    else:
        square = cx * cx + cy * cy
        u = (camera[PHI_MAX] - arc_tangent(cy, cx)) / camera[RADIANS_A_COLUMN]
        # Of the azimuths that differ by whole turns, take the one nearest to the picture's middle.
        turn = 2.0 * math.pi / camera[RADIANS_A_COLUMN]
        u -= turn * math.floor((u - 0.5 * camera[WIDTH]) / turn + 0.5)
        v = (camera[THETA_MAX] - arc_tangent(cz, math.sqrt(square))) / camera[RADIANS_A_ROW]
        depth = math.sqrt(square + cz * cz)
    return u, v, depth


@inlined
def unproject_point(camera: F64, u: float, v: float, depth: float) -> tuple[float, float, float]:
    """Pixel coordinates and depth -> the point relative to the scene origin."""
    if camera[KIND] == PERSPECTIVE:
        cx, cy, cz = 1.0, (camera[CX] - u) / camera[FX], (camera[CY] - v) / camera[FY]
    else:
        phi, theta = camera[PHI_MAX] - u * camera[RADIANS_A_COLUMN], camera[THETA_MAX] - v * camera[RADIANS_A_ROW]
        planar, cz = cosine_sine(theta)
        cx, cy = cosine_sine(phi)
        cx, cy = planar * cx, planar * cy
    x, y, z = direction_in_world(camera, cx * depth, cy * depth, cz * depth)
    return x + camera[POSITION_X], y + camera[POSITION_Y], z + camera[POSITION_Z]


if config.DISABLE_JIT:

    def to_fixed_tuple(array: F64, length: int) -> tuple[float, ...]:
        """The first elements of an array as a tuple."""
        return tuple(array[:length])

else:
    to_fixed_tuple = numba_arrays.to_fixed_tuple


@serial(fastmath={"contract", "nnan", "nsz"})
def project_pixels(camera: F64, other: F64, pixels: F64, images: F64, count: int) -> None:
    """Projects pixels of a camera into another one. pixels [3, >= count]: u, v and disparity in the first; images
    [3, >= count]: u, v and depth in the other.

    The cameras are read into tuples, which stay in registers, unlike arrays: so this compiles to vector instructions.
    """
    first, second = to_fixed_tuple(camera, CAMERA_SIZE), to_fixed_tuple(other, CAMERA_SIZE)
    for i in range(count):
        x, y, z = unproject_point(first, pixels[0, i], pixels[1, i], 1.0 / pixels[2, i])
        images[0, i], images[1, i], images[2, i] = project_point(second, x, y, z)

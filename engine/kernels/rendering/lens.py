"""Lenses: a view relative to one eye, to project the eye's pixels into the view.

A pixel is a direction from the eye and a disparity q. All geometry is in the view's axes, relative to its centre, and
scaled by q, which changes neither angles nor ratios of lengths: there the pixel's point is M direction + q t, float32.
That is exact to a few thousandths of a pixel at 8192 columns.

A lens is float32 [LENS_SIZE]: the data of a view table's row (`kernels.base.view_table`), relative to one eye.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.array_types import F32, F64
from ...support.packed import (
    CX,
    CY,
    FORWARD_X,
    FORWARD_Y,
    FORWARD_Z,
    FX,
    FY,
    HEIGHT,
    KIND,
    PERSPECTIVE,
    PHI_MAX,
    POSITION_X,
    POSITION_Y,
    POSITION_Z,
    THETA_MAX,
    WIDTH,
    WRAPS,
)
from ..base import view_table as t
from ..base.jit import inlined_late, serial
from ..base.memory import load_f32
from ..base.project import arc_tangent_of_ratio
from ..base.simd import Floats, Mask, maximum, minimum, select, spread, square_root
from ..base.tone import TONE_SIZE

__all__ = [
    "EDGE",
    "LEAST",
    "LENS_SIZE",
    "OUTSIDE",
    "PICTURE_HEIGHT",
    "PICTURE_WIDTH",
    "PICTURE_WRAPS",
    "SUBSAMPLED",
    "TOLERANCE",
    "TONE_AT",
    "aim",
    "lens_at",
    "make_lens",
]

# Fields of a lens. Rotation, view from eye, 3 x 3 and row-major (_XY: from the eye's y to the view's x), and shift.
_XX, _XY, _XZ, _YX, _YY, _YZ, _ZX, _ZY, _ZZ = range(9)
_ROTATION = _XX
_SHIFT_X, _SHIFT_Y, _SHIFT_Z = 9, 10, 11
PICTURE_WIDTH, PICTURE_HEIGHT, _OFFSET, _PER_STEP, _KIND, PICTURE_WRAPS = 12, 13, 14, 15, 16, 17
_FX, _CX, _FY, _CY = 18, 19, 20, 21  # or columns, left, rows, top
EDGE, TOLERANCE, LEAST = 22, 23, 24  # codes; LEAST: the least valid one
_SHARPNESS2, _PIXEL2, SUBSAMPLED = 25, 26, 27
TONE_AT = 28
LENS_SIZE = TONE_AT + TONE_SIZE

OUTSIDE = -1e9  # instead of the depth code of a point outside a view's picture
_MIXED = 0.03  # weight of a texel at a depth edge: it colours the rim of a surface that no other view sees
_BORDER_PX = 8.0  # width of the zone near its border in which a view fades out


@inlined_late
def lens_at(lenses: int, k: int) -> int:
    """The address of the k-th lens of an array."""
    return lenses + k * (4 * LENS_SIZE)


@serial
def make_lens(row: F64, camera: F64, lens: F32) -> None:
    """Fill a lens from a view table's row, for the eye of a packed camera."""
    for i in range(3):
        for j in range(3):
            lens[_ROTATION + 3 * i + j] = (
                row[FORWARD_X + i] * camera[FORWARD_X + j] + row[FORWARD_Y + i] * camera[FORWARD_Y + j]
                + row[FORWARD_Z + i] * camera[FORWARD_Z + j]
            )  # fmt: skip
        lens[_SHIFT_X + i] = (
            row[FORWARD_X + i] * (camera[POSITION_X] - row[POSITION_X])
            + row[FORWARD_Y + i] * (camera[POSITION_Y] - row[POSITION_Y])
            + row[FORWARD_Z + i] * (camera[POSITION_Z] - row[POSITION_Z])
        )
    lens[PICTURE_WIDTH], lens[PICTURE_HEIGHT] = row[WIDTH], row[HEIGHT]
    lens[_OFFSET], lens[_PER_STEP] = row[t.OFFSET], 1.0 / row[t.STEP]
    lens[_KIND], lens[PICTURE_WRAPS] = row[KIND], row[WRAPS]
    if row[KIND] == PERSPECTIVE:
        lens[_FX], lens[_CX], lens[_FY], lens[_CY] = row[FX], row[CX], row[FY], row[CY]
    else:
        lens[_FX], lens[_CX], lens[_FY], lens[_CY] = row[t.COLUMNS], row[PHI_MAX], row[t.ROWS], row[THETA_MAX]
    lens[EDGE], lens[TOLERANCE], lens[LEAST] = row[t.EDGE], row[t.TOLERANCE], row[t.INVALID]
    lens[_SHARPNESS2], lens[_PIXEL2] = row[t.SHARPNESS] * row[t.SHARPNESS], row[t.PIXEL] * row[t.PIXEL]
    lens[SUBSAMPLED] = row[t.SUBSAMPLED]
    for k in range(TONE_SIZE):
        lens[TONE_AT + k] = row[t.TONE + k]


@inlined_late
def _absolute(x: Floats) -> Floats:
    return maximum(x, -x)


@inlined_late
def _angle(ratio: Floats, steep: Mask, negative: Mask) -> Floats:
    """Arc tangent of a ratio in [0, 1] or, where it is `steep`, of its inverse; negated where it is `negative`. Within
    3e-7 rad, a thousandth of a pixel."""
    r = arc_tangent_of_ratio(ratio)
    r = select(steep, 0.5 * math.pi - r, r)
    return select(negative, -r, r)


@inlined_late
def _project(lens: int, q: Floats, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Points in the view's axes, scaled by q -> u, v and depth code; the code is OUTSIDE where there is no image."""
    if load_f32(lens, _KIND) == PERSPECTIVE:
        inverse = 1.0 / x
        u = load_f32(lens, _CX) - load_f32(lens, _FX) * y * inverse
        v = load_f32(lens, _CY) - load_f32(lens, _FY) * z * inverse
        near = q * inverse
    else:
        planar = x * x + y * y
        root, length = square_root(planar), square_root(planar + z * z)
        ax, ay, az = _absolute(x), _absolute(y), _absolute(z)
        longer, higher = maximum(maximum(ax, ay), 1e-20), maximum(maximum(root, az), 1e-20)
        inverse = 1.0 / (longer * higher * length)  # one division for three
        across = _angle(minimum(ax, ay) * higher * length * inverse, ay > ax, (x < 0.0) ^ (y < 0.0))
        across = select(x < 0.0, select(y < 0.0, -math.pi + across, math.pi + across), across)
        up = _angle(minimum(root, az) * longer * length * inverse, az > root, z < 0.0)
        u = (load_f32(lens, _CX) - across) * load_f32(lens, _FX)
        v = (load_f32(lens, _CY) - up) * load_f32(lens, _FY)
        near = q * longer * higher * inverse
        # Of the azimuths that differ by whole turns, take the one nearest to the picture's middle.
        turn = np.float32(2.0 * math.pi) * load_f32(lens, _FX)
        most = np.float32(0.5) * (load_f32(lens, PICTURE_WIDTH) + turn)
        u = select(u > most, u - turn, u)
        u = select(u < most - turn, u + turn, u)
    width, height = load_f32(lens, PICTURE_WIDTH), load_f32(lens, PICTURE_HEIGHT)
    inside = (near > 0.0) & (u >= 0.0) & (v >= 0.0) & (u <= width) & (v <= height)
    return u, v, select(inside, (near - load_f32(lens, _OFFSET)) * load_f32(lens, _PER_STEP), OUTSIDE)


@inlined_late
def _weigh(lens: int, q: Floats, ex: Floats, ey: Floats, ez: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Weights of the view's clean and mixed texels. They grow with a small angle between the view's ray and the eye's
    (e), with fine sampling, and away from the border. If both rays are within a pixel of each other, the eye sees the
    same mixture, and a mixed texel counts like a clean one."""
    tx, ty, tz = load_f32(lens, _SHIFT_X), load_f32(lens, _SHIFT_Y), load_f32(lens, _SHIFT_Z)
    vx, vy, vz = ex + tx * q, ey + ty * q, ez + tz * q
    ee, vv = ex * ex + ey * ey + ez * ez, vx * vx + vy * vy + vz * vz
    # Both rays span the same plane as the eye's ray and the shift, whose product is exact even for nearly equal rays.
    cx, cy, cz = ey * tz - ez * ty, ez * tx - ex * tz, ex * ty - ey * tx
    both = ee * vv
    sine2 = q * q * (cx * cx + cy * cy + cz * cz)  # times both
    sine2 = select(ex * vx + ey * vy + ez * vz < 0.0, 2.0 * both - sine2, sine2)
    finer = minimum(vv, ee * load_f32(lens, _SHARPNESS2))  # times vv
    # A picture that wraps has no border.
    softest = np.float32(1.0) if load_f32(lens, PICTURE_WRAPS) > 0.0 else np.float32(0.02)
    width, height = load_f32(lens, PICTURE_WIDTH), load_f32(lens, PICTURE_HEIGHT)
    border = minimum(minimum(u, width - u), minimum(v, height - v)) * np.float32(1.0 / _BORDER_PX)
    border = minimum(maximum(border, softest), 1.0)
    same = load_f32(lens, _PIXEL2) * both
    apart, beside = 3e-5 * both + sine2, same * same + sine2 * sine2
    inverse = 1.0 / maximum(apart * beside, 1e-37)
    weight = border * (0.1 * vv + finer) * ee * beside * inverse
    return weight, weight * (_MIXED + (1.0 - _MIXED) * same * same * apart * inverse)


@inlined_late
def aim(
    lens: int, q: Floats, dx: Floats, dy: Floats, dz: Floats, blends: bool
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Projects pixels of disparity q in directions d from the eye into a view: u, v and depth code, which is OUTSIDE if
    there is no image; and, if the view `blends` with others, the weights of its clean and its mixed texels there.

    lens: address of the view's lens."""
    ex = load_f32(lens, _XX) * dx + load_f32(lens, _XY) * dy + load_f32(lens, _XZ) * dz
    ey = load_f32(lens, _YX) * dx + load_f32(lens, _YY) * dy + load_f32(lens, _YZ) * dz
    ez = load_f32(lens, _ZX) * dx + load_f32(lens, _ZY) * dy + load_f32(lens, _ZZ) * dz
    x = ex + load_f32(lens, _SHIFT_X) * q
    y = ey + load_f32(lens, _SHIFT_Y) * q
    z = ez + load_f32(lens, _SHIFT_Z) * q
    u, v, code = _project(lens, q, x, y, z)
    clean, mixed = spread(1.0), spread(1.0)
    if blends:
        clean, mixed = _weigh(lens, q, ex, ey, ez, u, v)
    return u, v, code, clean, mixed

"""Meshes that are added to a scene, drawn into a shaded picture: nearer surfaces hide them, and they hide farther ones.

A triangle is tested against the rays of pixels by the planes through its sides and the eye (Olano and Greer 1997), so
nothing has to be clipped at the eye, and any projection of the eye works. With corners A, B, C in the eye's axes, the
ray with direction d (of depth 1) meets the triangle where d . (B x C), d . (C x A) and d . (A x B) have the sign of the
volume A . (B x C); they are the weights of the corners, and their sum divided by the volume is the disparity. Triangles
with a common side compute the same numbers for it, so no pixel is left out between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F32, F64, I32, U16
from ...support.packed import (
    CX,
    CY,
    FX,
    FY,
    KIND,
    PERSPECTIVE,
    PHI_MAX,
    RADIANS_A_COLUMN,
    RADIANS_A_ROW,
    THETA_MAX,
    WRAPS,
)
from ..base.jit import inlined, parallel, serial
from ..base.project import point_in_camera
from .records import DepthBuffer, Planes

__all__ = ["ADDED", "ColouredTriangles", "draw"]

ADDED = 255  # the winner's number of pixels that show an added mesh
_BANDS = 64
_TURN = 2.0 * math.pi
_NEAR_POLE = 1.5  # radians of elevation beyond which a triangle may lie in all columns


class ColouredTriangles(NamedTuple):
    """Triangles whose colours lie in a picture."""

    points: F64  # [n, 3], relative to the scene's origin, metres
    triangles: I32  # [m, 3]
    uv: F32  # [n, 2], places in the picture, pixels (centres at +0.5)
    y: U16  # [h, w], 10-bit codes
    cb: U16  # [(h + 1) // 2, (w + 1) // 2]
    cr: U16


@inlined
def _within(value: float, least: int, most: int) -> int:
    """A number as an integer from least to most; what is no number becomes least."""
    return int(min(max(value, float(least)), float(most))) if value > least else least


@serial
def _perspective_box(corners: F64, camera: F64, near: float, size: tuple[int, int], box: I32) -> None:
    """box [4]: first and last column, first and last row of the pixels that a triangle may cover."""
    w, h = size
    before = 0
    u0, v0, u1, v1 = math.inf, math.inf, -math.inf, -math.inf
    for k in range(3):
        depth = corners[k, 0]
        if depth >= near:
            before += 1
            u, v = camera[CX] - camera[FX] * corners[k, 1] / depth, camera[CY] - camera[FY] * corners[k, 2] / depth
            u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
    if before == 3:
        box[0], box[1] = _within(u0 - 1.0, 0, w), _within(u1 + 1.0, -1, w - 1)
        box[2], box[3] = _within(v0 - 1.0, 0, h), _within(v1 + 1.0, -1, h - 1)
    elif before > 0:
        box[0], box[1], box[2], box[3] = 0, w - 1, 0, h - 1
    else:
        box[0], box[1], box[2], box[3] = 0, -1, 0, -1


@serial
def _spherical_box(corners: F64, camera: F64, size: tuple[int, int], box: I32) -> None:
    """As `_perspective_box`; columns may lie beyond the picture, by whole turns."""
    w, h = size
    middle, units = np.zeros(3), np.empty((3, 3))
    for k in range(3):
        x, y, z = corners[k, 0], corners[k, 1], corners[k, 2]
        length = max(math.sqrt(x * x + y * y + z * z), 1e-30)
        for axis in range(3):
            units[k, axis] = corners[k, axis] / length
            middle[axis] += units[k, axis]
    length = math.sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2])
    closest = 1.0
    for k in range(3):
        dot = units[k, 0] * middle[0] + units[k, 1] * middle[1] + units[k, 2] * middle[2]
        closest = min(closest, dot / max(length, 1e-30))
    if not closest > 0.1:
        box[0], box[1], box[2], box[3] = 0, w - 1, 0, h - 1
        return
    radius, theta = math.acos(min(closest, 1.0)), math.asin(min(max(middle[2] / length, -1.0), 1.0))
    top = (camera[THETA_MAX] - theta - radius) / camera[RADIANS_A_ROW]
    bottom = (camera[THETA_MAX] - theta + radius) / camera[RADIANS_A_ROW]
    box[2], box[3] = _within(top - 1.0, 0, h), _within(bottom + 1.0, -1, h - 1)
    if abs(theta) + radius > _NEAR_POLE:
        box[0], box[1] = 0, w - 1
        return
    half = math.asin(min(math.sin(radius) / math.cos(theta), 1.0)) / camera[RADIANS_A_COLUMN]
    turn = _TURN / camera[RADIANS_A_COLUMN]
    u = (camera[PHI_MAX] - math.atan2(middle[1], middle[0])) / camera[RADIANS_A_COLUMN]
    u -= turn * math.floor((u - 0.5 * w) / turn + 0.5)
    box[0], box[1] = _within(u - half - 1.0, -w, 2 * w), _within(u + half + 1.0, -w - 1, 2 * w - 1)


@parallel
def _place(mesh: ColouredTriangles, camera: F64, near: float, size: tuple[int, int], corners: F64, boxes: I32) -> None:
    """corners [m, 3, 3] of the triangles in the eye's axes, and their boxes [m, 4]."""
    for number in numba.prange(mesh.triangles.shape[0]):
        m = np.int64(number)
        for k in range(3):
            p = mesh.triangles[m, k]
            x, y, z = point_in_camera(camera, mesh.points[p, 0], mesh.points[p, 1], mesh.points[p, 2])
            corners[m, k, 0], corners[m, k, 1], corners[m, k, 2] = x, y, z
        if camera[KIND] == PERSPECTIVE:
            _perspective_box(corners[m], camera, near, size, boxes[m])
        else:
            _spherical_box(corners[m], camera, size, boxes[m])


@inlined
def _cross(a: F64, b: F64) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@serial
def _at(plane: U16, u: float, v: float) -> float:
    """Bilinear sample of a plane at (u, v), pixels; the border goes on."""
    h, w = plane.shape
    x = min(max(u - 0.5, 0.0), w - 1.0) if u > 0.5 else 0.0
    y = min(max(v - 0.5, 0.0), h - 1.0) if v > 0.5 else 0.0
    left, top = int(x), int(y)
    right, below = min(left + 1, w - 1), min(top + 1, h - 1)
    fx, fy = x - left, y - top
    upper = (1.0 - fx) * plane[top, left] + fx * plane[top, right]
    lower = (1.0 - fx) * plane[below, left] + fx * plane[below, right]
    return (1.0 - fy) * upper + fy * lower


@serial
def _colour(
    mesh: ColouredTriangles, m: int, weights: tuple[float, float, float], planes: Planes, y: int, x: int
) -> None:
    """Colour a pixel where it meets triangle m; weights of the corners, which add up to 1."""
    a, b, c = mesh.triangles[m, 0], mesh.triangles[m, 1], mesh.triangles[m, 2]
    wa, wb, wc = weights
    u = wa * mesh.uv[a, 0] + wb * mesh.uv[b, 0] + wc * mesh.uv[c, 0]
    v = wa * mesh.uv[a, 1] + wb * mesh.uv[b, 1] + wc * mesh.uv[c, 1]
    planes.luma[y, x] = _at(mesh.y, u, v)
    planes.chroma_b[y, x] = _at(mesh.cb, 0.5 * u, 0.5 * v)
    planes.chroma_r[y, x] = _at(mesh.cr, 0.5 * u, 0.5 * v)


@serial
def _draw_row(
    mesh: ColouredTriangles, m: int, sides: F64, camera: F64, nearest: float, columns: tuple[int, int], y: int,
    buffer: DepthBuffer, planes: Planes,
) -> None:  # fmt: skip
    """Draw a row of a triangle; sides [4, 3]: see `_set_up`. nearest: the largest disparity that is drawn."""
    w = buffer.disparity.shape[1]
    wraps, spherical = camera[WRAPS] > 0.0, camera[KIND] != PERSPECTIVE
    dx, dz, planar = 1.0, 0.0, 1.0
    if spherical:
        theta = camera[THETA_MAX] - (y + 0.5) * camera[RADIANS_A_ROW]
        planar, dz = math.cos(theta), math.sin(theta)
    else:
        dz = (camera[CY] - (y + 0.5)) / camera[FY]
    for column in range(columns[0], columns[1] + 1):
        x = np.int64(column)
        if x < 0 or x >= w:
            if not wraps:
                continue
            x = x + w if x < 0 else x - w
        if spherical:
            phi = camera[PHI_MAX] - (x + 0.5) * camera[RADIANS_A_COLUMN]
            dx, dy = planar * math.cos(phi), planar * math.sin(phi)
        else:
            dy = (camera[CX] - (x + 0.5)) / camera[FX]
        a = sides[0, 0] * dx + sides[0, 1] * dy + sides[0, 2] * dz
        b = sides[1, 0] * dx + sides[1, 1] * dy + sides[1, 2] * dz
        c = sides[2, 0] * dx + sides[2, 1] * dy + sides[2, 2] * dz
        whole = a + b + c
        q = whole * sides[3, 0]
        if a >= 0.0 and b >= 0.0 and c >= 0.0 and q > buffer.disparity[y, x] and q <= nearest:
            buffer.disparity[y, x] = q
            buffer.winner[y, x] = ADDED
            _colour(mesh, m, (a / whole, b / whole, c / whole), planes, y, x)


@serial
def _set_up(corners: F64, sides: F64) -> bool:
    """sides [4, 3] of a triangle: the normals of the planes through the eye and its sides, inwards, and 1 / volume.
    False: the eye lies in its plane."""
    a, b, c = corners[0], corners[1], corners[2]
    x, y, z = _cross(b, c)
    volume = a[0] * x + a[1] * y + a[2] * z
    if not (abs(volume) > 0.0 and math.isfinite(1.0 / volume)):
        return False
    sides[0, 0], sides[0, 1], sides[0, 2] = x, y, z
    sides[1, 0], sides[1, 1], sides[1, 2] = _cross(c, a)
    sides[2, 0], sides[2, 1], sides[2, 2] = _cross(a, b)
    if volume < 0.0:
        for k in range(3):
            for i in range(3):
                sides[k, i] = -sides[k, i]
    sides[3, 0] = 1.0 / abs(volume)
    return True


@serial
def _draw_band(
    mesh: ColouredTriangles, corners: F64, boxes: I32, camera: F64, near: float, rows: tuple[int, int],
    buffer: DepthBuffer, planes: Planes,
) -> None:  # fmt: skip
    """Draw what lies in the rows `rows`, the first and the last."""
    sides = np.empty((4, 3))
    for m in range(boxes.shape[0]):
        first, last = max(int(boxes[m, 2]), rows[0]), min(int(boxes[m, 3]), rows[1])
        if first > last or boxes[m, 0] > boxes[m, 1] or not _set_up(corners[m], sides):
            continue
        columns = int(boxes[m, 0]), int(boxes[m, 1])
        for y in range(first, last + 1):
            _draw_row(mesh, m, sides, camera, 1.0 / near, columns, y, buffer, planes)


@parallel
def _draw_bands(
    mesh: ColouredTriangles, corners: F64, boxes: I32, camera: F64, near: float, buffer: DepthBuffer, planes: Planes
) -> None:
    h = buffer.disparity.shape[0]
    bands = min(h, _BANDS)
    for band in numba.prange(bands):
        b = np.int64(band)
        _draw_band(mesh, corners, boxes, camera, near, (b * h // bands, (b + 1) * h // bands - 1), buffer, planes)


@serial
def draw(mesh: ColouredTriangles, camera: F64, near: float, buffer: DepthBuffer, planes: Planes) -> None:
    """Draw a mesh, from both sides of its triangles, where it is nearer than what was drawn before. `near`: nothing
    nearer to the eye is drawn, metres. Winners become ADDED."""
    m = mesh.triangles.shape[0]
    corners, boxes = np.empty((m, 3, 3)), np.empty((m, 4), np.int32)
    size = buffer.disparity.shape[1], buffer.disparity.shape[0]
    _place(mesh, camera, near, size, corners, boxes)
    _draw_bands(mesh, corners, boxes, camera, near, buffer, planes)

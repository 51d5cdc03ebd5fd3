"""Directions round a camera, in cells of equal solid angle, with the distance of changed geometry in each cell.

A direction's row is computed from its z, its column from a substitute for its angle about z that needs no trigonometry.
The cells of a cone of directions may be too many, but never too few.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U64
from ..base.jit import inlined, parallel
from ..base.tolerance import Delta, delta_at
from .lines import from_camera
from .surfaces import Triangles

__all__ = ["COLUMNS", "ROWS", "forget_marks", "note_directions"]

ROWS, COLUMNS = 128, 256
# Arcs with a sine up to _NARROW are bounded by _ARC times their sine; a cone with a cosine up to _NARROW counts as all
# directions.
_NARROW = 0.5
_ARC = 1.05
_ROOM = 2e-3  # for the rounding of float32 rays: an angle, and a share of distances


@inlined
def _direction(camera: F64, points: F32, i: int) -> tuple[float, float, float, float]:
    """The unit direction of a point from a camera (packed), nan where they coincide, and its distance."""
    x, y, z = from_camera(camera, points[i, 0], points[i, 1], points[i, 2])
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length, length


@inlined
def _cells(camera: F64, points: F32, a: int, b: int, c: int) -> tuple[int, int, int, int, float, float]:
    """First row, last row, first column and number of columns of the cells in which a triangle is seen; then the least
    and the largest distance of it."""
    ax, ay, az, ad = _direction(camera, points, a)
    bx, by, bz, bd = _direction(camera, points, b)
    cx, cy, cz, cd = _direction(camera, points, c)
    far = max(ad, bd, cd)
    x, y, z = ax + bx + cx, ay + by + cy, az + bz + cz
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    # The cone round the middle that contains all three corners contains the triangle.
    ac, bc, cc = x * ax + y * ay + z * az, x * bx + y * by + z * bz, x * cx + y * cy + z * cz
    cosine = min(ac, bc, cc)
    if not cosine > _NARROW:
        return 0, ROWS - 1, 0, COLUMNS, 0.0, far
    near = min(ad * ac, bd * bc, cd * cc)  # along the middle direction, no point is nearer than the nearest corner
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0)) + _ROOM
    flat = math.sqrt(x * x + y * y)
    low, high = z * cosine - flat * sine - _ROOM, z * cosine + flat * sine + _ROOM
    if flat <= sine:  # the cone contains a pole
        low, high = (low, 1.0) if z > 0.0 else (-1.0, high)
    first = max(int((low + 1.0) * (0.5 * ROWS)), 0)
    last = min(int((high + 1.0) * (0.5 * ROWS)), ROWS - 1)
    if sine > _NARROW * flat:
        return first, last, 0, COLUMNS, near, far
    angle = y / (abs(x) + abs(y))  # grows with the true angle, and no faster; 4 is a full turn
    angle = angle + 1.0 if x >= 0.0 else 3.0 - angle
    half = _ARC * sine / flat
    left = math.floor((angle - half) * (0.25 * COLUMNS))
    columns = min(math.floor((angle + half) * (0.25 * COLUMNS)) - left + 1, COLUMNS)
    return first, last, left, columns, near, far


@parallel
def note_directions(cameras: F64, mesh: Triangles, which: I64, cells: F32) -> None:
    """Raises cells [cameras, ROWS, COLUMNS] to the distance at which the cameras (packed) see triangles `which` [n]."""
    for k in numba.prange(cameras.shape[0]):
        points, triangles = mesh.points, mesh.triangles
        for i in which:
            first, last, left, count, _near, far = _cells(
                cameras[k], points, triangles[i, 0], triangles[i, 1], triangles[i, 2]
            )
            distance = np.float32(far * (1.0 + _ROOM))
            for row in range(first, last + 1):
                for column in range(left, left + count):
                    cells[k, row, column % COLUMNS] = max(cells[k, row, column % COLUMNS], distance)


@parallel
def forget_marks(
    camera: F64, mesh: Triangles, cells: F32, delta: Delta, marks: U64, word: int, bit: np.uint64
) -> None:
    """Clears a camera's bit in marks [m, words] of the triangles that are nearer, by more than delta / 2, than the
    changed geometry in one of the cells [ROWS, COLUMNS] in which the camera sees them."""
    for i in numba.prange(marks.shape[0]):
        points, triangles = mesh.points, mesh.triangles
        if marks[i, word] & bit == 0:
            continue
        first, last, left, count, near, _far = _cells(
            camera, points, triangles[i, 0], triangles[i, 1], triangles[i, 2]
        )
        farthest = np.float32(0.0)
        for row in range(first, last + 1):
            for column in range(left, left + count):
                farthest = max(farthest, cells[row, column % COLUMNS])
        if farthest > near + 0.5 * delta_at(delta, near):
            marks[i, word] &= ~bit

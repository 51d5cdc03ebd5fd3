"""Blocks of meshes: those that a picture may show, and the projection of their points."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8
from ...support.packed import CX, CY, FX, FY, HEIGHT, KIND, PERSPECTIVE, WIDTH
from ..base.jit import inlined, inlined_late, parallel, serial
from ..base.memory import gather_floats, store_byte_where
from ..base.project import point_in_camera
from ..base.records import gather_records
from ..base.simd import LANES, Mask, lane_numbers, to_integers
from .tiles import TILE

__all__ = ["bound_blocks", "place_points", "visible_blocks"]


@serial
def bound_blocks(points: F32, starts: I64, which: U8, spheres: F32) -> None:
    """spheres [b, 4]: centre and radius of a sphere round each block's points; a negative radius for an empty block.
    Those of blocks with which [b] = 0 stay."""
    for b in range(spheres.shape[0]):
        if which[b] == 0:
            continue
        low, high = np.empty(3, np.float32), np.empty(3, np.float32)
        for axis in range(3):
            low[axis], high[axis] = np.inf, -np.inf
        for i in range(starts[b, 0], starts[b + 1, 0]):
            for axis in range(3):
                low[axis] = min(low[axis], points[i, axis])
                high[axis] = max(high[axis], points[i, axis])
        if low[0] > high[0]:
            spheres[b, 0], spheres[b, 1], spheres[b, 2], spheres[b, 3] = 0.0, 0.0, 0.0, -1.0
            continue
        radius2 = 0.0
        for axis in range(3):
            spheres[b, axis] = 0.5 * (low[axis] + high[axis])
            radius2 += (0.5 * (float(high[axis]) - float(low[axis]))) ** 2
        spheres[b, 3] = math.sqrt(radius2) * (1.0 + 1e-5)


@inlined
def _sphere_touches_hole(camera: F64, tiles: U8, x: float, y: float, z: float, r: float) -> bool:
    """Whether the bounding box of a sphere's image touches a marked tile; the sphere is in front of the eye."""
    width, height = int(camera[WIDTH]), int(camera[HEIGHT])
    u_low, u_high, v_low, v_high = math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        inverse = 1.0 / (x - r if k & 1 else x + r)
        side = -r if k & 2 else r
        u, v = camera[CX] - camera[FX] * (y + side) * inverse, camera[CY] - camera[FY] * (z + side) * inverse
        u_low, u_high = min(u_low, u), max(u_high, u)
        v_low, v_high = min(v_low, v), max(v_high, v)
    if u_high < 0.0 or v_high < 0.0 or u_low > width or v_low > height:
        return False
    i0, i1 = int(max(u_low - 1.0, 0.0)) // TILE, int(min(u_high + 1.0, width - 1.0)) // TILE
    j0, j1 = int(max(v_low - 1.0, 0.0)) // TILE, int(min(v_high + 1.0, height - 1.0)) // TILE
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if tiles[j, i]:
                return True
    return False


@serial
def visible_blocks(spheres: F32, camera: F64, near: float, tiles: U8, visible: I64) -> int:
    """List the blocks that a perspective picture may show (all, for another projection); returns their number.

    Unless `tiles` is empty, only blocks that touch a marked tile are listed.
    """
    count = 0
    perspective = camera[KIND] == PERSPECTIVE
    fx, fy, cx, cy = camera[FX], camera[FY], camera[CX], camera[CY]
    for b in range(spheres.shape[0]):
        r = float(spheres[b, 3])
        if r < 0.0:
            continue
        if perspective:
            x, y, z = point_in_camera(camera, spheres[b, 0], spheres[b, 1], spheres[b, 2])
            if x + r < near:
                continue
            # Distances to the planes u = 0, u = w, v = 0, v = h, positive inside.
            left = (cx * x - fx * y) / math.hypot(cx, fx)
            right = ((camera[WIDTH] - cx) * x + fx * y) / math.hypot(camera[WIDTH] - cx, fx)
            top = (cy * x - fy * z) / math.hypot(cy, fy)
            bottom = ((camera[HEIGHT] - cy) * x + fy * z) / math.hypot(camera[HEIGHT] - cy, fy)
            if min(min(left, right), min(top, bottom)) < -r:
                continue
            if tiles.size > 0 and x - r > near and not _sphere_touches_hole(camera, tiles, x, y, z, r):
                continue
        visible[count] = b
        count += 1
    return count


@serial(fastmath={"contract"})
def _transform(points: F32, first: int, last: int, camera: F64, screen: F32) -> None:
    """Points first to before last -> screen, see `place_points`."""
    perspective = camera[KIND] == PERSPECTIVE
    for i in range(first, last):
        x, y, z = point_in_camera(camera, points[i, 0], points[i, 1], points[i, 2])
        if perspective:
            # A point on the plane of the eye cannot be projected. It is moved a little; clipping reverses that.
            x = x if abs(x) > 1e-20 else 1e-20
            inverse = 1.0 / x
            screen[i, 0] = camera[CX] - camera[FX] * y * inverse
            screen[i, 1] = camera[CY] - camera[FY] * z * inverse
            screen[i, 2] = inverse
            screen[i, 3] = x
        else:
            screen[i, 0], screen[i, 1], screen[i, 2], screen[i, 3] = x, y, z, 0.0


@inlined_late
def _is_nearer(screen: int, i: int, among: Mask, disparity: int, width: int, height: int, margin: float) -> Mask:
    """Which of sixteen points from i on are nearer, see `place_points`."""
    u, v, q, _ = gather_records(screen, to_integers(lane_numbers()) + i, among)
    inside = among & (u >= 0.0) & (v >= 0.0) & (u < np.float32(width)) & (v < np.float32(height))
    pixel = to_integers(v) * width + to_integers(u)
    drawn = gather_floats(disparity, pixel, inside)
    return ~inside | (drawn <= 0.0) | (q > drawn + np.float32(margin))


@serial
def _mark_nearer(screen: F32, first: int, last: int, disparity: F32, margin: float, nearer: U8) -> None:
    """Points first to before last: see `place_points`."""
    h, w = disparity.shape
    for i in range(first, last, LANES):
        among = lane_numbers() < np.float32(last - i)
        found = _is_nearer(screen.ctypes.data, i, among, disparity.ctypes.data, w, h, margin)
        store_byte_where(nearer.ctypes.data, i, 1, among & found)
        store_byte_where(nearer.ctypes.data, i, 0, among & ~found)


@parallel
def place_points(
    points: F32, starts: I64, visible: I64, camera: F64, disparity: F32, margin: float, screen: F32, nearer: U8
) -> None:
    """Points of visible blocks -> screen [n, 4]: u, v, disparity, and the depth along the view axis.

    The depth is negative behind the eye. For an equirectangular target, screen holds the direction in camera axes
    instead (x, y, z, unused). Unless `disparity` is empty, nearer [n] is 1 for points that are nearer by `margin` than
    the surface drawn in their pixel, or outside the picture. This is computed per point, not per triangle, because a
    point belongs to six triangles and the work is bound by memory.
    """
    for k in numba.prange(visible.shape[0]):
        first, last = starts[visible[k], 0], starts[visible[k] + 1, 0]
        _transform(points, first, last, camera, screen)
        if disparity.size > 0:
            _mark_nearer(screen, first, last, disparity, margin, nearer)

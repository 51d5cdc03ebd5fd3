"""Scenes made of boxes, ellipsoids, capsules and cylinders: which of them a ray meets first, and where.

A part is a row of PART_SIZE numbers: its bounding sphere, its kind, its pose, its size (half edges of a box; half axes
of an ellipsoid; radius, radius and half length of the axis of a capsule or cylinder along z), and its material. A group
is a bounding sphere of consecutive parts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...support.array_types import F64
from ..base.jit import serial

__all__ = [
    "BOX",
    "CAPSULE",
    "CYLINDER",
    "ELLIPSOID",
    "END",
    "FIRST",
    "GROUP_SIZE",
    "PART_SIZE",
    "IndexArray",
    "Solids",
    "Vector",
    "candidates",
    "hit_normal",
    "material_of",
    "meets",
    "nearest",
]

X, Y, Z, RADIUS = range(4)  # of parts and of groups: a bounding sphere
KIND = 4  # of a part
XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ = range(5, 14)  # rotation, world from part, 3 x 3 and row-major
SIZE_X, SIZE_Y, SIZE_Z, MATERIAL = 14, 15, 16, 17
PART_SIZE = 18
FIRST, END = 4, 5  # of a group: its first part and the one past the last
GROUP_SIZE = 6
BOX, ELLIPSOID, CAPSULE, CYLINDER = range(4)

IndexArray = npt.NDArray[np.int64]
Vector = tuple[float, float, float]


class Solids(NamedTuple):
    """The parts [n, PART_SIZE] of a scene and their groups [m, GROUP_SIZE]."""

    parts: F64
    groups: F64


@serial
def _to_part(parts: F64, i: int, x: float, y: float, z: float) -> Vector:
    return (
        parts[i, XX] * x + parts[i, YX] * y + parts[i, ZX] * z,
        parts[i, XY] * x + parts[i, YY] * y + parts[i, ZY] * z,
        parts[i, XZ] * x + parts[i, YZ] * y + parts[i, ZZ] * z,
    )


@serial
def _hit_box(o: Vector, d: Vector, size: Vector) -> float:
    near, far = 0.0, math.inf
    for axis in range(3):
        if d[axis] == 0.0:
            if abs(o[axis]) > size[axis]:
                return math.inf
            continue
        a, b = (-size[axis] - o[axis]) / d[axis], (size[axis] - o[axis]) / d[axis]
        near, far = max(near, min(a, b)), min(far, max(a, b))
    return near if 0.0 < near <= far else math.inf


@serial
def _first_root(a: float, b: float, c: float) -> float:
    """Smaller root of a t^2 + 2 b t + c, where a surface is entered from outside; inf if none is ahead."""
    discriminant = b * b - a * c
    if discriminant < 0.0 or a <= 0.0:
        return math.inf
    t = (-b - math.sqrt(discriminant)) / a
    return t if t > 0.0 else math.inf


@serial
def _hit_ellipsoid(o: Vector, d: Vector, size: Vector) -> float:
    ox, oy, oz = o[0] / size[0], o[1] / size[1], o[2] / size[2]
    dx, dy, dz = d[0] / size[0], d[1] / size[1], d[2] / size[2]
    return _first_root(
        dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + oz * dz, ox * ox + oy * oy + oz * oz - 1.0
    )


@serial
def _hit_round(o: Vector, d: Vector, size: Vector, flat: bool) -> float:
    """A cylinder about z, closed by discs where `flat`, else by half spheres."""
    radius, half = size[0], size[2]
    planar = ox_dx = o[0] * d[0] + o[1] * d[1]
    inside = o[0] * o[0] + o[1] * o[1] - radius * radius
    t = _first_root(d[0] * d[0] + d[1] * d[1], planar, inside)
    if t < math.inf and abs(o[2] + t * d[2]) <= half:
        return t
    best = math.inf
    for sign in (-1.0, 1.0):
        if flat:
            t = (sign * half - o[2]) / d[2]
            x, y = o[0] + t * d[0], o[1] + t * d[1]
            if t > 0.0 and x * x + y * y <= radius * radius:
                best = min(best, t)
        else:
            z = o[2] - sign * half
            t = _first_root(d[0] * d[0] + d[1] * d[1] + d[2] * d[2], ox_dx + z * d[2], inside + z * z)
            if t < math.inf and sign * (z + t * d[2]) >= 0.0:
                best = min(best, t)
    return best


@serial
def _hit_part(parts: F64, i: int, o: Vector, d: Vector) -> float:
    local_o = _to_part(parts, i, o[0] - parts[i, X], o[1] - parts[i, Y], o[2] - parts[i, Z])
    local_d = _to_part(parts, i, d[0], d[1], d[2])
    size = (parts[i, SIZE_X], parts[i, SIZE_Y], parts[i, SIZE_Z])
    kind = int(parts[i, KIND])
    if kind == BOX:
        return _hit_box(local_o, local_d, size)
    if kind == ELLIPSOID:
        return _hit_ellipsoid(local_o, local_d, size)
    return _hit_round(local_o, local_d, size, kind == CYLINDER)


@serial
def meets(spheres: F64, i: int, o: Vector, d: Vector, spread: float, limit: float) -> bool:
    """Whether a ray within `spread` radians of d may meet sphere i before `limit`."""
    x, y, z = spheres[i, X] - o[0], spheres[i, Y] - o[1], spheres[i, Z] - o[2]
    squared = x * x + y * y + z * z
    radius = spheres[i, RADIUS] + spread * math.sqrt(squared)
    if squared <= radius * radius:
        return True
    length = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    along = x * d[0] + y * d[1] + z * d[2]
    if along <= 0.0 or squared - along * along / length > radius * radius:
        return False
    return bool(along / length - radius / math.sqrt(length) < limit)


@serial
def candidates(solids: Solids, first: int, o: Vector, d: Vector, spread: float) -> IndexArray:
    """Parts of the groups from `first` on that rays within `spread` of d may meet; those of the nearest group first."""
    parts, groups = solids
    order = np.empty(groups.shape[0] - first, np.int64)
    starts = np.empty(groups.shape[0] - first)
    count = total = 0
    for g in range(first, groups.shape[0]):
        if meets(groups, g, o, d, spread, math.inf):
            x, y, z = groups[g, X] - o[0], groups[g, Y] - o[1], groups[g, Z] - o[2]
            start = math.sqrt(x * x + y * y + z * z) - groups[g, RADIUS]
            k = count
            while k > 0 and starts[k - 1] > start:
                order[k], starts[k] = order[k - 1], starts[k - 1]
                k -= 1
            order[k], starts[k] = g, start
            count += 1
            total += int(groups[g, END] - groups[g, FIRST])
    found = np.empty(total, np.int64)
    total = 0
    for k in range(count):
        for i in range(int(groups[order[k], FIRST]), int(groups[order[k], END])):
            if meets(parts, i, o, d, spread, math.inf):
                found[total] = i
                total += 1
    return found[:total]


@serial
def nearest(parts: F64, among: IndexArray, o: Vector, d: Vector) -> tuple[float, int]:
    """Nearest hit among the parts `among`: (t, part), or (inf, -1) if there is none."""
    best, best_part = math.inf, -1
    for k in range(among.shape[0]):
        i = among[k]
        if meets(parts, i, o, d, 0.0, best):
            t = _hit_part(parts, i, o, d)
            if t < best:
                best, best_part = t, i
    return best, best_part


@serial
def _surface(parts: F64, i: int, p: Vector) -> tuple[Vector, float, float, float, float]:
    """At a point of part i, in its axes: (outward normal, u, v and their half ranges in metres)."""
    kind = int(parts[i, KIND])
    a, b, c = parts[i, SIZE_X], parts[i, SIZE_Y], parts[i, SIZE_Z]
    if kind == BOX:
        x, y, z = abs(p[0]) / a, abs(p[1]) / b, abs(p[2]) / c
        if x >= y and x >= z:
            sign = math.copysign(1.0, p[0])
            return (sign, 0.0, 0.0), sign * p[1], p[2], b, c
        if y >= z:
            sign = math.copysign(1.0, p[1])
            return (0.0, sign, 0.0), -sign * p[0], p[2], a, c
        return (0.0, 0.0, math.copysign(1.0, p[2])), p[0], p[1], a, b
    around = math.atan2(p[1], p[0]) * a
    if kind == ELLIPSOID:
        n = (p[0] / (a * a), p[1] / (b * b), p[2] / (c * c))
    elif kind == CAPSULE:
        n = (p[0], p[1], p[2] - min(max(p[2], -c), c))
    elif abs(p[2]) >= c * (1.0 - 1e-9):
        return (0.0, 0.0, math.copysign(1.0, p[2])), p[0], p[1], a, a
    else:
        n = (p[0], p[1], 0.0)
    length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    return (n[0] / length, n[1] / length, n[2] / length), around, p[2], math.pi * a, c


@serial
def hit_normal(parts: F64, i: int, point: Vector) -> tuple[Vector, Vector, tuple[float, float, float, float]]:
    """At a point of part i: the outward normal, the point in the part's axes, and (u, v and their half ranges in
    metres)."""
    p = _to_part(parts, i, point[0] - parts[i, X], point[1] - parts[i, Y], point[2] - parts[i, Z])
    local, u, v, half_u, half_v = _surface(parts, i, p)
    n = (
        parts[i, XX] * local[0] + parts[i, XY] * local[1] + parts[i, XZ] * local[2],
        parts[i, YX] * local[0] + parts[i, YY] * local[1] + parts[i, YZ] * local[2],
        parts[i, ZX] * local[0] + parts[i, ZY] * local[1] + parts[i, ZZ] * local[2],
    )
    return n, p, (u, v, half_u, half_v)


@serial
def material_of(parts: F64, i: int) -> int:
    """The number of a part's material."""
    return int(parts[i, MATERIAL])

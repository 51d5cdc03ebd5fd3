"""Ray tracing of scenes made of boxes, ellipsoids, capsules and cylinders.

A part is a row of PART_SIZE numbers: [0:3] centre, [3] radius of the sphere about it that holds the part,
[4] kind, [5:14] rotation world from part (row-major), [14:17] size: half edges of a box, half axes of an
ellipsoid, (radius, radius, half length of the axis) of a capsule or cylinder along z, [17] material.
A group is a bounding sphere over consecutive parts: [0:3] centre, [3] radius, [4:6] first part and one past
the last. A lamp: [0:3] position, [3] strength, [4] reach in metres.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from ...support.array_types import F64
from ...support.packed import FX, FY, KIND, PERSPECTIVE, RADIANS_A_COLUMN, RADIANS_A_ROW, Coding
from ..base.jit import parallel, serial
from ..base.project import position, unproject_point
from .patterns import pattern_colour

__all__ = ["BOX", "CAPSULE", "CYLINDER", "ELLIPSOID", "PART_SIZE", "trace_picture"]

PART_SIZE = 18
BOX, ELLIPSOID, CAPSULE, CYLINDER = range(4)
AMBIENT = 0.38
TILE = 16  # pixels; the groups that a tile may see are sought once for all its rays

CodeArray = npt.NDArray[np.uint16]
IndexArray = npt.NDArray[np.int64]
Vector = tuple[float, float, float]


@serial
def _to_part(parts: F64, i: int, x: float, y: float, z: float) -> Vector:
    return (
        parts[i, 5] * x + parts[i, 8] * y + parts[i, 11] * z,
        parts[i, 6] * x + parts[i, 9] * y + parts[i, 12] * z,
        parts[i, 7] * x + parts[i, 10] * y + parts[i, 13] * z,
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
    local_o = _to_part(parts, i, o[0] - parts[i, 0], o[1] - parts[i, 1], o[2] - parts[i, 2])
    local_d = _to_part(parts, i, d[0], d[1], d[2])
    size = (parts[i, 14], parts[i, 15], parts[i, 16])
    kind = int(parts[i, 4])
    if kind == BOX:
        return _hit_box(local_o, local_d, size)
    if kind == ELLIPSOID:
        return _hit_ellipsoid(local_o, local_d, size)
    return _hit_round(local_o, local_d, size, kind == CYLINDER)


@serial
def _meets(spheres: F64, i: int, o: Vector, d: Vector, spread: float, limit: float) -> bool:
    """Whether a ray within `spread` radians of d may meet sphere i before `limit`."""
    x, y, z = spheres[i, 0] - o[0], spheres[i, 1] - o[1], spheres[i, 2] - o[2]
    squared = x * x + y * y + z * z
    radius = spheres[i, 3] + spread * math.sqrt(squared)
    if squared <= radius * radius:
        return True
    length = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    along = x * d[0] + y * d[1] + z * d[2]
    if along <= 0.0 or squared - along * along / length > radius * radius:
        return False
    return bool(along / length - radius / math.sqrt(length) < limit)


@serial
def _candidates(groups: F64, first: int, o: Vector, d: Vector, spread: float) -> IndexArray:
    """Groups from `first` on that rays within `spread` of d may meet, nearest first."""
    found = np.empty(groups.shape[0] - first, np.int64)
    starts = np.empty(groups.shape[0] - first)
    count = 0
    for g in range(first, groups.shape[0]):
        if _meets(groups, g, o, d, spread, math.inf):
            x, y, z = groups[g, 0] - o[0], groups[g, 1] - o[1], groups[g, 2] - o[2]
            start = math.sqrt(x * x + y * y + z * z) - groups[g, 3]
            k = count
            while k > 0 and starts[k - 1] > start:
                found[k], starts[k] = found[k - 1], starts[k - 1]
                k -= 1
            found[k], starts[k] = g, start
            count += 1
    return found[:count]


@serial
def _nearest(
    parts: F64, groups: F64, candidates: IndexArray, o: Vector, d: Vector
) -> tuple[float, int]:
    """Nearest hit among the candidate groups: (t, part), (inf, -1) where there is none."""
    best, best_part = math.inf, -1
    for k in range(candidates.shape[0]):
        g = candidates[k]
        if _meets(groups, g, o, d, 0.0, best):
            for i in range(int(groups[g, 4]), int(groups[g, 5])):
                if _meets(parts, i, o, d, 0.0, best):
                    t = _hit_part(parts, i, o, d)
                    if t < best:
                        best, best_part = t, i
    return best, best_part


@serial
def _surface(parts: F64, i: int, p: Vector) -> tuple[Vector, float, float, float, float]:
    """At a point of part i, in its axes: (outward normal, u, v and their half ranges in metres)."""
    kind = int(parts[i, 4])
    a, b, c = parts[i, 14], parts[i, 15], parts[i, 16]
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
def _light(lamps: F64, p: Vector, n: Vector) -> float:
    """Diffuse light without shadows, so that what stands still keeps its colour whoever walks past."""
    total: float = AMBIENT * (0.85 + 0.15 * n[2])
    for k in range(lamps.shape[0]):
        x, y, z = lamps[k, 0] - p[0], lamps[k, 1] - p[1], lamps[k, 2] - p[2]
        squared = x * x + y * y + z * z
        soft = 0.5 + 0.5 * (x * n[0] + y * n[1] + z * n[2]) / math.sqrt(squared)
        total += lamps[k, 3] * soft * soft / (1.0 + squared / (lamps[k, 4] * lamps[k, 4]))
    return total


@serial
def _shade(
    parts: F64,
    materials: F64,
    lamps: F64,
    i: int,
    o: Vector,
    d: Vector,
    t: float,
    pixel_rad: float,
) -> Vector:
    if i < 0:
        return 0.0, 0.0, 0.0
    world = (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
    p = _to_part(parts, i, world[0] - parts[i, 0], world[1] - parts[i, 1], world[2] - parts[i, 2])
    local_n, u, v, half_u, half_v = _surface(parts, i, p)
    n = (
        parts[i, 5] * local_n[0] + parts[i, 6] * local_n[1] + parts[i, 7] * local_n[2],
        parts[i, 8] * local_n[0] + parts[i, 9] * local_n[1] + parts[i, 10] * local_n[2],
        parts[i, 11] * local_n[0] + parts[i, 12] * local_n[1] + parts[i, 13] * local_n[2],
    )
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    cosine = abs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) / length
    footprint = max(pixel_rad * t * length / max(cosine, 0.1), 1e-6)
    r, g, b = pattern_colour(materials, int(parts[i, 17]), p[0], p[1], p[2], u, v, half_u, half_v, footprint)
    light = _light(lamps, world, n)
    return r * light, g * light, b * light


@serial
def _ray(camera: F64, u: float, v: float) -> Vector:
    """Direction through a pixel coordinate, as long as one unit of the camera's depth."""
    x, y, z = unproject_point(camera, u, v, 1.0)
    cx, cy, cz = position(camera)
    return x - cx, y - cy, z - cz


@serial
def _pixel_rad(camera: F64) -> float:
    if camera[KIND] == PERSPECTIVE:
        return float(1.0 / min(abs(camera[FX]), abs(camera[FY])))
    return float(max(camera[RADIANS_A_COLUMN], camera[RADIANS_A_ROW]))


@serial
def _block_meets(
    camera: F64,
    parts: F64,
    groups: F64,
    candidates: IndexArray,
    row: int,
    column: int,
    samples: int,
    spread: float,
) -> bool:
    """Whether any ray of a block of 2 x 2 pixels meets the candidate groups, hidden or not."""
    o = position(camera)
    d = _ray(camera, column + 1.0, row + 1.0)
    near = False
    for k in range(candidates.shape[0]):
        g = candidates[k]
        if not near and _meets(groups, g, o, d, spread, math.inf):
            for i in range(int(groups[g, 4]), int(groups[g, 5])):
                near = near or _meets(parts, i, o, d, spread, math.inf)
    if not near:
        return False
    for y in range(row, row + 2):
        for x in range(column, column + 2):
            d = _ray(camera, x + 0.5, y + 0.5)
            if _nearest(parts, groups, candidates, o, d)[1] >= 0:
                return True
            for s in range(samples * samples):
                d = _ray(camera, x + (s % samples + 0.5) / samples, y + (s // samples + 0.5) / samples)
                if _nearest(parts, groups, candidates, o, d)[1] >= 0:
                    return True
    return False


@serial
def _pixel_colour(
    camera: F64,
    parts: F64,
    groups: F64,
    candidates: IndexArray,
    materials: F64,
    lamps: F64,
    x: int,
    y: int,
    samples: int,
    pixel_rad: float,
) -> Vector:
    """Mean linear colour of samples x samples rays, gamma 2, as Y' in [0, 1], Cb, Cr in [-.5, .5]."""
    o = position(camera)
    r = g = b = 0.0
    for s in range(samples * samples):
        d = _ray(camera, x + (s % samples + 0.5) / samples, y + (s // samples + 0.5) / samples)
        t, part = _nearest(parts, groups, candidates, o, d)
        colour = _shade(parts, materials, lamps, part, o, d, t, pixel_rad)
        r, g, b = r + colour[0], g + colour[1], b + colour[2]
    weight = 1.0 / (samples * samples)
    r = math.sqrt(min(max(r * weight, 0.0), 1.0))
    g = math.sqrt(min(max(g * weight, 0.0), 1.0))
    b = math.sqrt(min(max(b * weight, 0.0), 1.0))
    luma = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return luma, (b - luma) / 1.8556, (r - luma) / 1.5748


@serial
def _trace_block(
    camera: F64,
    coding: Coding,
    parts: F64,
    groups: F64,
    candidates: IndexArray,
    materials: F64,
    lamps: F64,
    samples: int,
    row: int,
    column: int,
    luma: CodeArray,
    cb: CodeArray,
    cr: CodeArray,
    codes: CodeArray,
) -> None:
    height, width = luma.shape
    o, pixel_rad = position(camera), _pixel_rad(camera)
    blue = red = 0.0
    for k in range(4):
        y, x = min(row + k // 2, height - 1), min(column + k % 2, width - 1)
        bright, b, r = _pixel_colour(
            camera, parts, groups, candidates, materials, lamps, x, y, samples, pixel_rad
        )
        luma[y, x] = np.uint16(np.rint(64.0 + 876.0 * bright))
        blue, red = blue + b, red + r
        depth, _ = _nearest(parts, groups, candidates, o, _ray(camera, x + 0.5, y + 0.5))
        code = np.rint((1.0 / depth - coding.offset) / coding.step)
        codes[y, x] = np.uint16(min(max(code, coding.min_code), coding.max_code))
    cb[row // 2, column // 2] = np.uint16(np.rint(512.0 + 224.0 * blue))
    cr[row // 2, column // 2] = np.uint16(np.rint(512.0 + 224.0 * red))


@parallel
def trace_picture(
    camera: F64,  # packed
    coding: Coding,
    parts: F64,  # [n, PART_SIZE]
    groups: F64,  # [m, 6]
    first: int,
    materials: F64,  # [k, MATERIAL_SIZE]
    lamps: F64,  # [l, 5]
    samples: int,
    luma: CodeArray,  # [h, w]
    cb: CodeArray,  # [(h + 1) // 2, (w + 1) // 2]
    cr: CodeArray,
    codes: CodeArray,  # [h, w]
) -> None:
    """Write a picture (10-bit limited-range BT.709, 4:2:0) and its depth codes in place.

    Blocks of 2 x 2 pixels that no ray of theirs meets a group from `first` on keep what they hold: with the
    picture of the groups before `first` in the arrays, the result is that of tracing everything. first = 0
    traces every block. Colour takes samples x samples rays a pixel, depth the one through its centre.
    """
    height, width = luma.shape
    o, pixel_rad = position(camera), _pixel_rad(camera)
    across = (width + TILE - 1) // TILE
    for tile in numba.prange(across * ((height + TILE - 1) // TILE)):
        top, left = TILE * (tile // across), TILE * (tile % across)
        d = _ray(camera, left + 0.5 * TILE, top + 0.5 * TILE)
        movers = _candidates(groups, first, o, d, TILE * pixel_rad)
        if first > 0 and movers.shape[0] == 0:
            continue
        candidates = _candidates(groups, 0, o, d, TILE * pixel_rad)
        for row in range(top, min(top + TILE, height), 2):
            for column in range(left, min(left + TILE, width), 2):
                if first > 0 and not _block_meets(
                    camera, parts, groups, movers, row, column, samples, 2.0 * pixel_rad
                ):
                    continue
                _trace_block(
                    camera,
                    coding,
                    parts,
                    groups,
                    candidates,
                    materials,
                    lamps,
                    samples,
                    row,
                    column,
                    luma,
                    cb,
                    cr,
                    codes,
                )

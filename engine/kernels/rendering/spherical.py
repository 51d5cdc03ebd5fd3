"""Triangles on an equirectangular picture: sorted into bands and drawn one at a time, by the directions of pixels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from ...support.array_types import F32, F64, I32, I64
from ...support.packed import HEIGHT, PHI_MAX, RADIANS_A_COLUMN, RADIANS_A_ROW, THETA_MAX
from ..base.jit import inlined, parallel, serial
from .records import Bands, DepthBuffer, Rows, VisibleBlocks
from .strips import SIDE_PX

__all__ = ["Directions", "azimuths", "draw_bands", "elevations", "sort_into_bands"]

Direction = tuple[float, float, float]

_HALF_TURN = 3.0  # radians: less than pi, where a side could go round either way


@inlined
def _direction(screen: F32, i: int) -> tuple[float, float, float]:
    return float(screen[i, 0]), float(screen[i, 1]), float(screen[i, 2])


@inlined
def _cross(p: Direction, r: Direction) -> Direction:
    return p[1] * r[2] - p[2] * r[1], p[2] * r[0] - p[0] * r[2], p[0] * r[1] - p[1] * r[0]


@inlined
def _dot(p: Direction, r: Direction) -> float:
    return p[0] * r[0] + p[1] * r[1] + p[2] * r[2]


@inlined
def _normal(a: Direction, b: Direction, c: Direction) -> Direction:
    """Normal of the plane of three corners, towards the viewer who sees them counterclockwise."""
    return _cross((b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]))


@inlined
def _turn(p: Direction, r: Direction) -> float:
    """The angle from one direction's azimuth to another's, the shorter way round: -pi to pi."""
    return math.atan2(p[0] * r[1] - p[1] * r[0], p[0] * r[0] + p[1] * r[1])


@inlined
def azimuths(a: Direction, b: Direction, c: Direction) -> tuple[float, float]:
    """The least and the largest azimuth of a triangle on the sphere, not wrapped. They are more than half a turn apart
    if the triangle has a pole inside, or might have one within rounding.

    Sides are arcs of great circles, along which azimuths only rise or only fall.
    """
    ab, bc, ca = _turn(a, b), _turn(b, c), _turn(c, a)
    if abs(ab + bc + ca) > math.pi:  # a whole turn, round a pole
        return -math.pi, math.pi
    first = math.atan2(a[1], a[0])
    return first + min(0.0, min(ab, ab + bc)), first + max(0.0, max(ab, ab + bc))


@inlined
def elevations(a: Direction, b: Direction, c: Direction, width: float) -> tuple[float, float]:
    """Bounds of the elevations of a triangle on the sphere; `width`: its width in azimuth, see `azimuths`.

    Along a great circle, the tangent of the elevation is A cos(azimuth - azimuth of the highest point). If an arc
    contains the highest point, that is in the half towards the arc's higher end, where the tangent is not less than
    A cos(width / 2).
    """
    ta = a[2] / math.hypot(a[0], a[1])
    tb = b[2] / math.hypot(b[0], b[1])
    tc = c[2] / math.hypot(c[0], c[1])
    low, high = min(ta, min(tb, tc)), max(ta, max(tb, tc))
    if width > _HALF_TURN:
        return math.atan(low) if low > 0.0 else -0.5 * math.pi, math.atan(high) if high < 0.0 else 0.5 * math.pi
    bulge = 1.0 / math.cos(0.5 * width)
    return math.atan(low * bulge if low < 0.0 else low), math.atan(high * bulge if high > 0.0 else high)


@inlined
def _rows(a: Direction, b: Direction, c: Direction, camera: F64) -> tuple[int, int]:
    """First and last row that a triangle may touch; an empty range if it is seen from behind."""
    if _dot(_normal(a, b, c), a) >= 0.0:
        return 1, 0
    left, right = azimuths(a, b, c)
    low, high = elevations(a, b, c, right - left)
    first = math.ceil((camera[THETA_MAX] - high) / camera[RADIANS_A_ROW] - 0.5 - SIDE_PX)
    last = math.floor((camera[THETA_MAX] - low) / camera[RADIANS_A_ROW] - 0.5 + SIDE_PX)
    return max(0, int(first)), min(int(camera[HEIGHT]) - 1, int(last))


@inlined
def _side(p: Direction, r: Direction, camera: F64) -> tuple[float, float, float, float]:
    """The plane through the eye and a side: a direction is inside if its product with the first three numbers is not
    less than the last one."""
    x, y, z = _cross(r, p)
    return x, y, z, -SIDE_PX * camera[RADIANS_A_ROW] * math.sqrt(x * x + y * y + z * z)


class Directions(NamedTuple):
    """Cosines and sines of a picture's azimuths [w, 2] and elevations [h, 2]."""

    columns: F32
    rows: F32


@serial
def _draw_triangle(
    a: Direction, b: Direction, c: Direction, camera: F64, directions: Directions, limits: Rows, view: int,
    margin: float, buffer: DepthBuffer,
) -> None:  # fmt: skip
    """Draw the rows `limits` of a triangle: a pixel is inside if its direction is on the inner side of three planes."""
    (columns, rows), (first, last), (disparity, winner) = directions, limits, buffer
    width = disparity.shape[1]
    top, bottom = _rows(a, b, c, camera)
    ab, bc, ca = _side(a, b, camera), _side(b, c, camera), _side(c, a, camera)
    nx, ny, nz = _normal(a, b, c)
    inverse = 1.0 / _dot((nx, ny, nz), a)
    left, right = azimuths(a, b, c)
    if right - left > _HALF_TURN:
        x0, x1 = 0, width - 1
    else:  # one column more on each side, for sides along columns
        x0 = math.ceil((camera[PHI_MAX] - right) / camera[RADIANS_A_COLUMN] - 1.5)
        x1 = math.floor((camera[PHI_MAX] - left) / camera[RADIANS_A_COLUMN] + 0.5)
    period = round(2.0 * math.pi / camera[RADIANS_A_COLUMN])
    for y in range(max(first, top), min(last, bottom) + 1):
        planar, z = rows[y, 0], rows[y, 1]
        # The picture recurs with each whole turn. Only columns inside it are walked through: if it shows a small part
        # of a turn, a triangle may cover billions of others.
        for turn in range(x0 // period, x1 // period + 1):
            for x in range(max(x0 - turn * period, 0), min(x1 - turn * period, width - 1) + 1):
                dx, dy = planar * columns[x, 0], planar * columns[x, 1]
                if (
                    ab[0] * dx + ab[1] * dy + ab[2] * z >= ab[3]
                    and bc[0] * dx + bc[1] * dy + bc[2] * z >= bc[3]
                    and ca[0] * dx + ca[1] * dy + ca[2] * z >= ca[3]
                ):
                    q = (nx * dx + ny * dy + nz * z) * inverse
                    if q > disparity[y, x] + (margin if disparity[y, x] > 0.0 else 0.0):
                        disparity[y, x] = q
                        winner[y, x] = view


@parallel
def sort_into_bands(
    screen: F32, triangles: I32, blocks: VisibleBlocks, camera: F64, bands: Bands, drawn: I64
) -> None:
    """As `sorting.sort_into_bands`; it culls triangles that are outside the picture or seen from behind."""
    starts, visible, shares = blocks
    band_rows, counts, lists = bands
    for chunk in numba.prange(counts.shape[0]):
        drawn[chunk] = 0
        for band in range(counts.shape[1]):
            counts[chunk, band] = 0
        for k in range(shares[chunk], shares[chunk + 1]):
            block = visible[k]
            for t in range(starts[block, 1], starts[block + 1, 1]):
                a, b, c = triangles[t]
                first, last = _rows(_direction(screen, a), _direction(screen, b), _direction(screen, c), camera)
                drawn[chunk] += last >= first
                for band in range(first // band_rows, last // band_rows + 1 if last >= first else 0):
                    lists[chunk, band, counts[chunk, band]] = t
                    counts[chunk, band] += 1


@parallel
def draw_bands(
    screen: F32, triangles: I32, camera: F64, directions: Directions, bands: Bands, view: int, margin: float,
    buffer: DepthBuffer,
) -> None:  # fmt: skip
    """As `rasterise.draw_bands`."""
    height = buffer.disparity.shape[0]
    for band in numba.prange(bands.counts.shape[1]):
        limits = (band * bands.rows, min((band + 1) * bands.rows, height) - 1)
        for chunk in range(bands.counts.shape[0]):
            for k in range(bands.counts[chunk, band]):
                a, b, c = triangles[bands.lists[chunk, band, k]]
                _draw_triangle(
                    _direction(screen, a), _direction(screen, b), _direction(screen, c), camera, directions, limits,
                    view, margin, buffer,
                )  # fmt: skip

"""The probable background image: the model seen from a camera, with colours (section 3.4.1)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, I64, U8, U16
from ...support.packed import Coding
from ..base.interleave import interleaved
from ..base.jit import inlined, parallel, serial
from ..base.project import unproject_point
from ..base.tolerance import Delta
from .captures import REACH, SCATTERED, WIDTH, chroma_at, luma_at
from .picture import Picture
from .rays import Tracer, farthest_hit
from .standing import Present, standing_hit
from .surfaces import CAPTURE
from .triangles import corners_of, place_in_picture, point_of
from .uncovered import CELL

__all__ = ["Tables", "render_pbi"]


# Columns of a hit.
_DISPARITY, _U, _V, _CAPTURE, _GEOMETRY, _PRIMITIVE, _DISTANCE = range(7)
_HIT_SIZE = 7
_STRIDE = 8  # rows; see `interleaved`
_FLAT = 5e-4  # a hit counts as on a plane if it is off by less than this share of its distance


class Tables(NamedTuple):
    """The tables of the model's surfaces (see `surfaces`) and captures (see `captures`)."""

    surfaces: I64
    captures: I64


@serial
def _cast(
    tracer: Tracer, camera: F64, surfaces: I64, present: Present, delta: Delta, x: int, y: int, hits: F64, k: int
) -> int:
    """Writes the surface shown at a pixel's centre to hits[k] [_HIT_SIZE]: disparity (0: nothing), place in its
    capture's picture, capture, geometry, primitive, distance; returns the number of rays."""
    u, v, rays = x + 0.5, y + 0.5, 1
    if present.table.shape[0] == 0:
        distance, hu, hv, geometry, primitive, length = farthest_hit(tracer, camera, u, v)
    else:
        distance, hu, hv, geometry, primitive, length, rays = standing_hit(
            tracer, camera, u, v, surfaces, present, delta
        )
    if not distance > 0.0:
        hits[k, _DISPARITY], hits[k, _CAPTURE] = 0.0, -1.0
        return rays
    hits[k, _DISPARITY], hits[k, _DISTANCE] = length / distance, distance
    hits[k, _U], hits[k, _V] = place_in_picture(surfaces[geometry], primitive, hu, hv)
    hits[k, _CAPTURE], hits[k, _GEOMETRY], hits[k, _PRIMITIVE] = surfaces[geometry, CAPTURE], geometry, primitive
    return rays


@inlined
def _beside(captures: I64, hits: F64, a: int, b: int) -> bool:
    """Whether two hits of one capture lie in one part of its picture, and not on both sides of a seam."""
    capture = int(hits[a, _CAPTURE])
    across, down = abs(hits[a, _U] - hits[b, _U]), abs(hits[a, _V] - hits[b, _V])
    reach = captures[capture, REACH]
    if reach > 0:
        return across < reach and down < reach
    return not across > 0.5 * captures[capture, WIDTH]


@serial
def _on_plane(tables: Tables, camera: F64, hits: F64, a: int, b: int, x: int, y: int) -> bool:
    """Whether hits[b], of pixel (x, y), lies on the plane of hits[a]'s triangle, and both have nearby colours."""
    if hits[a, _CAPTURE] != hits[b, _CAPTURE] or hits[a, _CAPTURE] < 0.0:
        return False
    same = hits[a, _PRIMITIVE] == hits[b, _PRIMITIVE] and hits[a, _GEOMETRY] == hits[b, _GEOMETRY]
    whole = tables.captures[int(hits[a, _CAPTURE]), REACH] == 0
    if (whole or not same) and not _beside(tables.captures, hits, a, b):
        return False
    if same:
        return True
    if tables.captures[int(hits[a, _CAPTURE]), SCATTERED] != 0:
        return False
    surface = tables.surfaces[int(hits[a, _GEOMETRY])]
    p, q, r = corners_of(surface, int(hits[a, _PRIMITIVE]))
    px, py, pz = point_of(surface, p)
    qx, qy, qz = point_of(surface, q)
    rx, ry, rz = point_of(surface, r)
    ex, ey, ez, fx, fy, fz = qx - px, qy - py, qz - pz, rx - px, ry - py, rz - pz
    nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    bx, by, bz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / hits[b, _DISPARITY])
    off = abs(nx * (bx - px) + ny * (by - py) + nz * (bz - pz))
    return off <= _FLAT * hits[b, _DISTANCE] * math.sqrt(nx * nx + ny * ny + nz * nz)


@serial
def _colour(captures: I64, hits: F64, y: U16, pair: int, column: int) -> tuple[float, float]:
    """Writes the luma of the 2x2 pixels with the hits [4, _HIT_SIZE]; returns their chroma."""
    h, w = y.shape
    u, v, blue, red, count = 0.0, 0.0, 0.0, 0.0, 0
    one = True  # capture
    for k in range(4):
        row, x = 2 * pair + (k >> 1), 2 * column + (k & 1)
        if row >= h or x >= w:
            continue
        if hits[k, _CAPTURE] < 0.0:
            y[row, x] = 0
            continue
        y[row, x] = int(luma_at(captures[int(hits[k, _CAPTURE])], hits[k, _U], hits[k, _V]) + 0.5)
        u, v, count = u + hits[k, _U], v + hits[k, _V], count + 1
        one &= hits[k, _CAPTURE] == hits[0, _CAPTURE] and _beside(captures, hits, k, 0)
        one &= captures[int(hits[k, _CAPTURE]), SCATTERED] == 0
    if count == 0:
        return 512.0, 512.0
    if one:
        return chroma_at(captures[int(hits[0, _CAPTURE])], u / count, v / count)
    for k in range(4):
        if 2 * pair + (k >> 1) < h and 2 * column + (k & 1) < w and hits[k, _CAPTURE] >= 0.0:
            own_blue, own_red = chroma_at(captures[int(hits[k, _CAPTURE])], hits[k, _U], hits[k, _V])
            blue, red = blue + own_blue, red + own_red
    return blue / count, red / count


@serial
def _mean(hits: F64, k: int, grid: F64, a: int, b: int) -> None:
    """Writes the middle of two hits on one plane to hits[k]."""
    hits[k, _CAPTURE] = grid[a, _CAPTURE]
    for i in (_DISPARITY, _U, _V):
        hits[k, i] = 0.5 * (grid[a, i] + grid[b, i])


@inlined
def _is_wanted(wanted: U8, pair: int, column: int, before: int) -> bool:
    """Whether 2x2 pixels, or others up to `before` such steps to the left or above, are in a wanted cell."""
    if wanted.size == 0:
        return True
    y, x = 2 * pair // CELL, 2 * column // CELL
    top, left = 2 * max(pair - before, 0) // CELL, 2 * max(column - before, 0) // CELL
    return (wanted[y, x] | wanted[top, x] | wanted[y, left] | wanted[top, left]) != 0


@parallel
def _cast_grid(
    tracer: Tracer, camera: F64, surfaces: I64, present: Present, delta: Delta, wanted: U8, columns: int, grid: F64
) -> int:
    """Casts rays through every second pixel in both directions, into grid [rows * columns, _HIT_SIZE]; returns the
    number of rays."""
    rays, rows = 0, grid.shape[0] // columns
    for index in numba.prange(rows):
        pair = interleaved(np.int64(index), rows, _STRIDE)
        for column in range(columns):
            if _is_wanted(wanted, pair, column, 1):
                k = pair * columns + column
                rays += _cast(tracer, camera, surfaces, present, delta, 2 * column, 2 * pair, grid, k)
    return rays


@serial
def _complete(
    tracer: Tracer, camera: F64, tables: Tables, present: Present, delta: Delta, grid: F64, sparse: bool,
    pixel: tuple[int, int], size: tuple[int, int], hits: F64,
) -> int:  # fmt: skip
    """Fills hits [4, _HIT_SIZE] of the 2x2 pixels from `pixel` (row, column; even) on; returns the number of rays."""
    # Hits are given by their numbers in an array: views would be reference-counted, and threads would contend for that.
    (row, x), (h, w) = pixel, size
    rows, columns, rays = (h + 1) // 2, (w + 1) // 2, 0
    centre = row // 2 * columns + x // 2
    right, below = centre + 1, centre + columns
    inside = sparse and row // 2 + 1 < rows and x // 2 + 1 < columns
    for i in range(_HIT_SIZE):
        hits[0, i] = grid[centre, i]
    flat_right = inside and _on_plane(tables, camera, grid, centre, right, x + 2, row)
    flat_below = inside and _on_plane(tables, camera, grid, centre, below, x, row + 2)
    if flat_right:
        _mean(hits, 1, grid, centre, right)
    elif x + 1 < w:
        rays += _cast(tracer, camera, tables.surfaces, present, delta, x + 1, row, hits, 1)
    if flat_below:
        _mean(hits, 2, grid, centre, below)
    elif row + 1 < h:
        rays += _cast(tracer, camera, tables.surfaces, present, delta, x, row + 1, hits, 2)
    if flat_right and flat_below and _on_plane(tables, camera, grid, centre, below + 1, x + 2, row + 2):
        _mean(hits, 3, grid, centre, below + 1)
    elif x + 1 < w and row + 1 < h:
        rays += _cast(tracer, camera, tables.surfaces, present, delta, x + 1, row + 1, hits, 3)
    return rays


@serial
def _write(hits: F64, captures: I64, coding: Coding, pair: int, column: int, picture: Picture) -> None:
    """Writes codes and colours of the 2x2 pixels with the hits [4, _HIT_SIZE]."""
    codes = picture.codes
    h, w = codes.shape
    for k in range(4):
        row, x = 2 * pair + (k >> 1), 2 * column + (k & 1)
        if row < h and x < w:
            code = math.floor((hits[k, _DISPARITY] - coding.offset) / coding.step + 0.5)
            limited = int(min(max(code, 1.0), float(coding.max_code)))
            codes[row, x] = limited if hits[k, _CAPTURE] >= 0.0 else 0
    blue, red = _colour(captures, hits, picture.y, pair, column)
    picture.cb[pair, column], picture.cr[pair, column] = int(blue + 0.5), int(red + 0.5)


@serial
def _clear(pair: int, picture: Picture) -> None:
    """Makes a pair of rows of pixels holes."""
    for row in range(2 * pair, min(2 * pair + 2, picture.codes.shape[0])):
        for column in range(picture.codes.shape[1]):
            picture.codes[row, column] = picture.y[row, column] = 0
    for half in range(picture.cb.shape[1]):
        picture.cb[pair, half] = picture.cr[pair, half] = 512


@parallel
def _finish(
    tracer: Tracer, camera: F64, coding: Coding, tables: Tables, present: Present,
    delta: Delta, sparse: bool, wanted: U8, grid: F64, picture: Picture,
) -> int:  # fmt: skip
    """The rest of `render_pbi` after the grid of every second pixel is done; returns the number of rays."""
    rays = 0
    rows, columns = picture.cb.shape
    for index in numba.prange(rows):
        pair, hits = interleaved(np.int64(index), rows, _STRIDE), np.empty((4, _HIT_SIZE))
        _clear(pair, picture)
        for column in range(columns):
            if not _is_wanted(wanted, pair, column, 0):
                continue
            pixel = 2 * pair, 2 * column
            size = picture.codes.shape
            rays += _complete(tracer, camera, tables, present, delta, grid, sparse, pixel, size, hits)
            _write(hits, tables.captures, coding, pair, column, picture)
    return rays


@serial
def render_pbi(
    tracer: Tracer, camera: F64, coding: Coding, tables: Tables, present: Present,
    delta: Delta, sparse: bool, wanted: U8, picture: Picture,
) -> int:  # fmt: skip
    """Fills a view of the background, with code 0 in holes; returns the number of rays (section 3.4.1).

    It shows the farthest hit (as in the paper) if `present` has no rows, else the nearest hit that stands
    (`standing_hit`). With `sparse`, rays are cast through every second pixel in both directions, and through the pixels
    between only where those rays do not meet one plane. Chroma is the mean over the pixels of a 2x2 that are not holes.
    Cells that are not `wanted` (see `uncovered`; empty: all are) stay holes.
    """
    rows, columns = picture.cb.shape
    grid = np.empty((rows * columns, _HIT_SIZE))
    rays = _cast_grid(tracer, camera, tables.surfaces, present, delta, wanted, columns, grid)
    return rays + _finish(tracer, camera, coding, tables, present, delta, sparse, wanted, grid, picture)

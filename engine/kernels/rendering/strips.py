"""Drawing of triangles in strips of sixteen columns, one row of a strip at a time in vector registers.

A pixel is inside a triangle if three functions of its place, one per side, are not negative. These functions and the
disparity are linear in a pixel's column and row. No branch depends on the triangle's shape, so a small triangle costs
little more than its rows. Strips begin at every sixteenth column and are written whole, because the next triangle often
reads the same strip: after a partial write it would have to wait for the memory.

The coefficients of triangles are computed for sixteen triangles at once (`set_up`). Sums in float32 have errors of 1e-4
pixels for a triangle as large as the picture, and less for smaller ones.
"""

from __future__ import annotations

import numpy as np

from ...support.array_types import F32, U8
from ..base.jit import inlined, inlined_late, serial
from ..base.memory import (
    gather_integers,
    load,
    load_f32,
    load_where,
    store,
    store_byte_where,
    store_larger,
    store_where,
)
from ..base.records import gather_records, load_triples
from ..base.simd import (
    LANES,
    Floats,
    Integers,
    Mask,
    lane_numbers,
    maximum,
    minimum,
    round_down,
    round_up,
    select,
    spread,
    to_integers,
)
from .records import Rows

__all__ = [
    "CLIPPED",
    "SET_UP_SIZE",
    "SIDE_PX",
    "SPECKS_SIZE",
    "Corners",
    "corners",
    "corners_side_by_side",
    "draw_speck",
    "draw_triangle",
    "extent",
    "find_specks",
    "pixels_of",
    "prepared",
    "row_count",
    "set_up",
]

# A triangle's sides are moved outwards by this many pixels, so that rounding opens no cracks between neighbours.
SIDE_PX = 1e-3
CLIPPED = -1  # instead of a number of rows: the triangle crosses the plane of the eye
# Fields of a triangle: its first pixel, and the numbers of columns and rows from there; for each side, the value at
# that pixel and its change per column and per row; the same for disparity, and its least and largest value.
_COLUMN, _ROW, _COLUMNS, _ROWS, _SIDES, _PLANE, _FIELDS = 0, 1, 2, 3, 4, 13, 18
SET_UP_SIZE = _FIELDS * LANES
SPECKS_SIZE = 5 * LANES

Corners = tuple[Integers, Integers, Integers]


@inlined_late
def corners(triangles: int, number: Integers, second: int, among: Mask) -> Corners:
    """Points of the triangles with these numbers; `triangles`: address of int32 [n, 3]; `second`: 2 if triangles wind
    the other way, else 1."""
    first = number * 3
    b, c = gather_integers(triangles, first + second, among), gather_integers(triangles, first + (3 - second), among)
    return gather_integers(triangles, first, among), b, c


@inlined_late
def corners_side_by_side(triangles: int, first: int, second: int) -> Corners:
    """As `corners` of sixteen triangles from number `first` on."""
    a, b, c = load_triples(triangles, first)
    if second == 2:
        b, c = c, b
    return a, b, c


@inlined_late
def extent(a: Floats, b: Floats, c: Floats, size: int) -> tuple[Floats, Floats]:
    """The first and the last pixel with a centre that triangles may cover, along an axis of `size` pixels."""
    low, high = minimum(a, minimum(b, c)), maximum(a, maximum(b, c))
    first = round_up(maximum(low, -1.0) - np.float32(0.5 + SIDE_PX))
    last = round_down(minimum(high, np.float32(size + 1)) - np.float32(0.5 - SIDE_PX))
    return maximum(first, 0.0), minimum(last, np.float32(size - 1))


@inlined_late
def _put(out: int, field: int, values: Floats) -> None:
    store(out, field * LANES, values)


@inlined_late
def _absolute(x: Floats) -> Floats:
    return maximum(x, -x)


@inlined_late
def _put_side(out: int, side: int, rise: Floats, run: Floats, across: Floats, down: Floats) -> None:
    """Write a side through a point that is `across` and `down` before the first pixel: rise * across - run * down is 0
    or more inside."""
    slack = np.float32(SIDE_PX) * (_absolute(rise) + _absolute(run))
    _put(out, _SIDES + 3 * side, rise * across - run * down + slack)
    _put(out, _SIDES + 3 * side + 1, rise)
    _put(out, _SIDES + 3 * side + 2, -run)


@serial
def set_up(
    screen: int, triangles: int, listed: int, count: int, second: int, near: float, rows: Rows, size: tuple[int, int],
    out: int,
) -> None:  # fmt: skip
    """Prepare up to sixteen triangles, the first `count` of the numbers (int32) at `listed`, for `draw_triangle`.

    Addresses: screen [n, 4], see `blocks.place_points`; triangles int32 [m, 3], see `corners`; out float32
    [SET_UP_SIZE]. Only the rows `rows` of a picture of a size (columns, rows) are drawn.
    """
    (first, last), (width, height) = rows, size
    among = lane_numbers() < np.float32(count)
    points = corners(triangles, gather_integers(listed, to_integers(lane_numbers()), among), second, among)
    ua, va, qa, xa = gather_records(screen, points[0], among)
    ub, vb, qb, xb = gather_records(screen, points[1], among)
    uc, vc, qc, xc = gather_records(screen, points[2], among)
    behind = minimum(xa, minimum(xb, xc)) < np.float32(near)
    rise_a, rise_b, rise_c = vb - va, vc - vb, va - vc
    run_a, run_b, run_c = ub - ua, uc - ub, ua - uc
    area = run_c * rise_a - run_a * rise_c  # twice the area; negative if the eye sees the front
    left, right = extent(ua, ub, uc, width)
    top, bottom = extent(va, vb, vc, height)
    top, bottom = maximum(top, np.float32(first)), minimum(bottom, np.float32(last))
    count_of_rows = select(area < 0.0, bottom - top + 1.0, 0.0)
    _put(out, _COLUMN, left)
    _put(out, _ROW, top)
    _put(out, _COLUMNS, right - left + 1.0)
    _put(out, _ROWS, select(behind, spread(CLIPPED), count_of_rows))
    u, v = left + 0.5, top + 0.5
    _put_side(out, 0, rise_a, run_a, u - ua, v - va)
    _put_side(out, 1, rise_b, run_b, u - ub, v - vb)
    _put_side(out, 2, rise_c, run_c, u - uc, v - vc)
    inverse = -1.0 / area
    q_du = ((qb - qa) * rise_c + (qc - qa) * rise_a) * inverse
    q_dv = -((qb - qa) * run_c + (qc - qa) * run_a) * inverse
    _put(out, _PLANE + 1, q_du)
    _put(out, _PLANE + 2, q_dv)
    _put(out, _PLANE + 3, minimum(qa, minimum(qb, qc)))
    _put(out, _PLANE + 4, maximum(qa, maximum(qb, qc)))
    # Relative to the farthest corner: a difference of large disparities would lose most of its digits.
    farther = qb < qa
    ua, va, qa = select(farther, ub, ua), select(farther, vb, va), select(farther, qb, qa)
    farther = qc < qa
    ua, va, qa = select(farther, uc, ua), select(farther, vc, va), select(farther, qc, qa)
    _put(out, _PLANE, qa + q_du * (u - ua) + q_dv * (v - va))


@serial
def find_specks(ready: int, specks: int) -> None:
    """Which pixels the sixteen triangles cover that `set_up` prepared at `ready`, of those that can cover no more than
    2 x 2: specks, as most triangles are at depth edges.

    specks: address of float32 [SPECKS_SIZE]: for each triangle, bits of the pixels that it covers in reading order, or
    -1: it is no speck; then the disparities at these four pixels. They are those of `draw_triangle`.
    """
    columns, rows = load(ready, _COLUMNS * LANES), load(ready, _ROWS * LANES)
    small = (columns <= 2.0) & (rows <= 2.0) & (rows >= 0.0)
    hits = spread(0.0)
    for pixel in range(4):
        x, y = np.float32(pixel & 1), np.float32(pixel >> 1)
        inside = small & (columns > x) & (rows > y)
        for side in range(3):
            at = (_SIDES + 3 * side) * LANES
            first = load(ready, at + LANES) * x + load(ready, at)
            inside &= load(ready, at + 2 * LANES) * y + first >= 0.0
        first = load(ready, (_PLANE + 1) * LANES) * x + load(ready, _PLANE * LANES)
        q = load(ready, (_PLANE + 2) * LANES) * y + first
        q = minimum(maximum(q, load(ready, (_PLANE + 3) * LANES)), load(ready, (_PLANE + 4) * LANES))
        store(specks, (1 + pixel) * LANES, q)
        hits += select(inside, spread(np.float32(1 << pixel)), 0.0)
    store(specks, 0, select(small, hits, -1.0))


@inlined_late
def pixels_of(specks: int, lane: int) -> int:
    """The bits of the pixels that triangle `lane` covers; -1: it is no speck. See `find_specks`."""
    return int(load_f32(specks, lane))


@inlined
def draw_speck(
    triangle: int, specks: int, lane: int, disparity: F32, winner: U8, margin: float, view: int
) -> None:
    """As `draw_triangle` of a speck that covers a pixel; `triangle` is its `prepared` address."""
    left, top, hits = int(_get(triangle, _COLUMN)), int(_get(triangle, _ROW)), pixels_of(specks, lane)
    for pixel in range(4):
        if hits & (1 << pixel):
            x, y = left + (pixel & 1), top + (pixel >> 1)
            q, before = load_f32(specks, (1 + pixel) * LANES + lane), disparity[y, x]
            if q > (before + margin if before > np.float32(0.0) else np.float32(0.0)):
                disparity[y, x] = q
                winner[y, x] = view


@inlined_late
def prepared(ready: int, lane: int) -> int:
    """The address of triangle `lane` of those that `set_up` prepared at the address `ready`."""
    return ready + 4 * lane


@inlined_late
def _get(triangle: int, field: int) -> float:
    return load_f32(triangle, field * LANES)


@inlined_late
def row_count(triangle: int) -> int:
    """Number of rows of a `prepared` triangle; CLIPPED if it crosses the plane of the eye."""
    return int(_get(triangle, _ROWS))


@inlined_late
def _draw_strip(
    disparity: int, winner: int, width: int, column: Floats, within: Mask, whole: bool, rows: int, triangle: int,
    margin: float, view: int,
) -> None:  # fmt: skip
    """Draw rows of a strip; disparity and winner: addresses of its first pixel; column: the columns relative to the
    triangle's first one; within: which of them belong to the triangle; whole: the strip has all sixteen columns."""
    first_a = _get(triangle, _SIDES + 1) * column + _get(triangle, _SIDES)
    first_b = _get(triangle, _SIDES + 4) * column + _get(triangle, _SIDES + 3)
    first_c = _get(triangle, _SIDES + 7) * column + _get(triangle, _SIDES + 6)
    first_q = _get(triangle, _PLANE + 1) * column + _get(triangle, _PLANE)
    down_a, down_b = spread(_get(triangle, _SIDES + 2)), spread(_get(triangle, _SIDES + 5))
    down_c, down_q = spread(_get(triangle, _SIDES + 8)), spread(_get(triangle, _PLANE + 2))
    least, most = spread(_get(triangle, _PLANE + 3)), spread(_get(triangle, _PLANE + 4))
    y, start = spread(0.0), 0  # a vector, as a number would be spread again for each product
    for _ in range(rows):
        q = minimum(maximum(down_q * y + first_q, least), most)
        inside = within & (down_a * y + first_a >= 0.0) & (down_b * y + first_b >= 0.0) & (down_c * y + first_c >= 0.0)
        before = load(disparity, start) if whole else load_where(disparity, start, inside)
        wins = inside & (q > select(before > 0.0, before + margin, 0.0))
        if whole:
            store_larger(disparity, start, before, select(wins, q, 0.0))
        else:
            store_where(disparity, start, q, wins)
        store_byte_where(winner, start, view, wins)
        y += 1.0
        start += width


@serial
def draw_triangle(
    triangle: int, disparity: int, winner: int, width: int, margin: float, view: int
) -> None:
    """Draw a `prepared` triangle into a picture `width` columns wide.

    disparity, winner: addresses of C-contiguous [h, w] arrays: disparity (float32, 0 where nothing was drawn) and the
    number of the view that won (uint8). The triangle wins a pixel if it is nearer by `margin`.
    """
    x0, y, rows = int(_get(triangle, _COLUMN)), int(_get(triangle, _ROW)), row_count(triangle)
    columns = _get(triangle, _COLUMNS)
    for x in range(x0 & ~(LANES - 1), x0 + int(columns), LANES):
        column = lane_numbers() + np.float32(x - x0)
        within = (column >= 0.0) & (column < np.float32(columns))
        first = y * width + x
        _draw_strip(
            disparity + 4 * first, winner + first, width, column, within, x + LANES <= width, rows, triangle,
            margin, view,
        )  # fmt: skip
